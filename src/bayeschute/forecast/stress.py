"""Does a model survive its prior? Flights of prior draws: what fails, where, and how far the steps can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.dynamics.integrate import FlightModel, jacobian_compiled
from bayeschute.dynamics.kernel import flight as kernel
from bayeschute.dynamics.outcome import Outcome, simulate
from bayeschute.inference.priors import Prior, factor, working
from bayeschute.inference.target import FlightData

Array = NDArray[np.float64]
_BATCH = 32  # flights per compiled call; the last batch is filled up


class StressTest(NamedTuple):
    """Flights of N prior draws.

    Attributes:
        names: Parameters, in order.
        standard: Draws in units of the prior's standard deviation from its centre (N, P).
        start: Initial deviations (N, D).
        outcome: `Outcome` (N,).
        failed_at: Sample at which it began (N,), -1 where ok.
        gradient: Whether all derivatives of a flight that is ok are finite (N,); False where it is not ok.
        step_error: Largest error of each state due to the steps (N, X).
    """

    names: tuple[str, ...]
    standard: Array
    start: Array
    outcome: NDArray[np.int64]
    failed_at: NDArray[np.int64]
    gradient: NDArray[np.bool_]
    step_error: Array

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Which flights are ok (N,)."""
        return self.outcome == Outcome.OK

    def shares(self) -> dict[str, float]:
        """Share of every outcome, and among flights that are ok, of derivatives that are not finite."""
        shares = {kind.words: float(np.mean(self.outcome == kind)) for kind in Outcome}
        lost = float(np.mean(~self.gradient[self.ok])) if self.ok.any() else 0.0
        return shares | {"derivatives that are not finite": lost}

    def place(self) -> dict[str, tuple[float, float]]:
        """Where failures lie: by parameter, mean standard coordinate of flights that fail and its standard error.

        A parameter that has nothing to do with failures has a mean within a few standard errors of zero. Empty where
        nothing fails.
        """
        failed = self.standard[~(self.ok & self.gradient)]
        if not len(failed):
            return {}
        se = 1.0 / np.sqrt(len(failed))
        return {name: (float(mean), se) for name, mean in zip(self.names, failed.mean(axis=0), strict=True)}

    def worst_step_error(self, share: float = 1.0) -> Array:
        """Quantile over flights that are ok of the error of every state due to the steps (X,); NaN where none is ok."""
        if not self.ok.any():
            return np.full(self.step_error.shape[1], np.nan)
        return np.asarray(np.quantile(self.step_error[self.ok], share, axis=0))


def stress_test(
    model: FlightModel, priors: Sequence[Prior], n: int, start_scale: Array, rows: int = 3, seed: int = 0
) -> StressTest:
    """Fly a model with parameters and initial deviations drawn from their priors.

    Args:
        model: The flight.
        priors: Of its parameters, in order.
        n: Number of draws.
        start_scale: Standard deviations of the initial deviations (D,); zeros keep the reference start.
        rows: Rows of the latent disturbances, which stay zero.
        seed: Of the draws.
    """
    rng = np.random.default_rng(seed)
    centre = working(priors)[0]
    standard = rng.standard_normal((n, centre.size))
    start = rng.standard_normal((n, np.size(start_scale))) * start_scale
    theta = centre + standard @ factor(priors).T
    samples = jnp.shape(jax.tree.leaves(model.inputs())[0])[0]
    outcome, failed_at, step_error = [], [], []
    for first in range(0, n, _BATCH):
        chosen = np.minimum(np.arange(first, first + _BATCH), n - 1)
        flown = simulate(model, theta[chosen].T, start[chosen].T, np.zeros((samples, rows, _BATCH)))
        kept = min(_BATCH, n - first)
        outcome.append(np.asarray(flown.outcome)[:kept])
        failed_at.append(np.asarray(flown.failed_at)[:kept])
        step_error.append(np.asarray(flown.step_error).T[:kept])
    ended = np.concatenate(outcome)
    still, knot = np.zeros((samples, rows)), np.ones((samples, 1))
    gradient = np.zeros(n, bool)
    for i in np.flatnonzero(ended == Outcome.OK):
        given = model, theta[i], start[i], still, knot
        outputs, slopes = kernel.jacobian(*given) or jacobian_compiled(*given)
        gradient[i] = bool(jnp.isfinite(outputs).all() & jnp.isfinite(slopes).all())
    names = tuple(prior.name for prior in priors)
    return StressTest(names, standard, start, ended, np.concatenate(failed_at), gradient, np.concatenate(step_error))


def stress_flight(data: FlightData, priors: Sequence[Prior], n: int, seed: int = 0) -> StressTest:
    """`stress_test` of a record that is ready to be fitted, initial deviations from their prior.

    Args:
        data: The record with its model.
        priors: Of the model's parameters, in order.
        n: Number of draws.
        seed: Of the draws.
    """
    return stress_test(data.model, priors, n, np.asarray(data.start_scale), data.latent.rows, seed)


def lines(tried: StressTest) -> list[str]:
    """A stress test in words: shares of outcomes, when flights fail, for which parameters, and the steps' errors."""
    told = [f"{len(tried.outcome)} flights of prior draws"]
    told += [f"{words}: {100.0 * share:.1f} %" for words, share in tried.shares().items() if share or words == "ok"]
    if not tried.ok.all():
        told.append(f"first failure at sample {tried.failed_at[~tried.ok].min()}")
    for name, (mean, se) in tried.place().items():
        if abs(mean) > 2.0 * se:
            told.append(f"failures at {name}: {mean:+.1f} +- {se:.1f} standard deviations of its prior")
    if tried.ok.any():
        worst = tried.worst_step_error().max()
        told.append(f"largest error of any state due to steps, in flights that are ok: {worst:.1g}")
    return told
