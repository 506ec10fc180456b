"""Simulation-based calibration: truths from the prior, data from the model itself, and the rank of every truth.

Parameters, noise parameters, initial state, latent disturbances and residual noise of a replicate are drawn from the
priors and models that the identification assumes; then the replicate is identified, and the true values are ranked
among its draws (Talts et al. 2018). Errors of the intervals that approximate inference causes show in the ranks.

The prior is often far wider than the region of a study's records. The true values may be drawn from the posterior of a
fit to the template's own record instead. Record and replicate are then fitted together with the original priors: a draw
from p(theta | y), with its own data y', is ranked among draws of p(theta | y, y'), and ranks are uniform again if the
inference is correct (Saeilynoja et al. 2025, posterior simulation-based calibration).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.calibration.ranks import EcdfTest, rank, uniform
from bayeschute.core.random import stream
from bayeschute.likelihood.joint import (
    FlightData,
    LatentPath,
    NoiseParameters,
    Unknowns,
    latent_path_of,
    residuals,
    states,
)
from bayeschute.likelihood.noise import colour
from bayeschute.likelihood.priors import Prior, factor, working
from bayeschute.likelihood.simulation_smoother import normals
from bayeschute.posterior.fit.laplace_fit import LaplaceFit, find
from bayeschute.posterior.marginal import draw_flights
from bayeschute.posterior.noise_evidence import NoisePrior, from_vector, to_vector
from bayeschute.posterior.noise_uncertainty import widened
from bayeschute.posterior.sampler import sample

Array = NDArray[np.float64]
Row = dict[str, Any]
Quantities = Callable[[FlightData, Array], dict[str, Array]]
_TRIES = 50
_GROUP = 16


@dataclass(frozen=True)
class Template:
    """Settings that all replicates share.

    Attributes:
        flight: Inputs, sample times and gaps; its data are replaced.
        priors: Priors of the parameters.
        noise: Priors of the noise parameters.
        quantities: From states (T, X, B) to derived quantities by name (B,).
        most_swing: A drawn flight that is not finite, or whose outputs exceed this many times the template's own
            greatest (outputs whose record is all zero don't count), is drawn anew.
    """

    flight: FlightData
    priors: tuple[Prior, ...]
    noise: NoisePrior
    quantities: Quantities
    most_swing: float = 5.0


@dataclass(frozen=True)
class Believed:
    """The posterior of a fit to the template's own record, from which truths may be drawn.

    Attributes:
        found: The fit.
        xi: Draws of the parameters given fixed noise parameters, standard coordinates (S, P).
    """

    found: LaplaceFit
    xi: Array


def believe(template: Template, seed: int, chains: int = 4, draws: int = 250) -> Believed:
    """Fit the template's own record.

    Args:
        template: The template; its flight has the record's data.
        seed: Seed.
        chains: Chains of the sampler.
        draws: Draws of each.
    """
    found = find([template.flight], template.priors, template.noise)
    xi = sample(found.marginal, "nuts", chains, 200, draws, seed).xi
    return Believed(found, xi.reshape(-1, len(template.priors)))


@dataclass(frozen=True)
class Drawn:
    """A replicate: data, and the truths behind them.

    Attributes:
        flight: With its data.
        theta: Parameters, working coordinates (P,).
        hyper: Noise parameters.
        latent_path: Start and disturbances.
        redrawn: How many draws were thrown away before.
    """

    flight: FlightData
    theta: Array
    hyper: NoiseParameters
    latent_path: LatentPath
    redrawn: int


def _truth(template: Template, believed: Believed | None, rng: np.random.Generator) -> tuple[Array, NoiseParameters]:
    """Parameters and noise parameters, drawn together: from their priors, or from a posterior."""
    if believed is None:
        centre = working(template.priors)[0]
        middle = to_vector(template.noise.median)
        theta = centre + factor(template.priors) @ rng.standard_normal(centre.size)
        log_noise = middle + template.noise.log_sd * rng.standard_normal(middle.size)
        return theta, from_vector(log_noise, template.noise.median)
    found = believed.found
    root = np.linalg.cholesky(found.noise_parameter_covariance)
    moved = root @ rng.standard_normal(len(root))
    xi = found.noise_effect.carried(believed.xi[rng.integers(len(believed.xi))], moved)
    theta = np.asarray(found.marginal.centre) + np.asarray(found.marginal.scale) @ xi
    return theta, from_vector(to_vector(found.hyper) + moved, found.hyper)


def draw(template: Template, seed: int, believed: Believed | None = None) -> Drawn:
    """Draw truths and data of a replicate.

    Args:
        template: The template.
        seed: Seed.
        believed: Where truths come from; the priors where None.

    Raises:
        FloatingPointError: If simulations of nearly all draws fail.
    """
    rng, flight = stream(seed, "truth and data of a replicate"), template.flight
    blank = replace(
        flight, observed=np.zeros(np.shape(flight.observed)), present=np.ones(np.shape(flight.present), bool)
    )
    largest = template.most_swing * np.nanmax(np.abs(np.where(flight.present, flight.observed, np.nan)), axis=0)
    largest[largest == 0.0] = np.inf  # attitude is relative to the recorded one: its record is zero
    redrawn = 0
    while redrawn < _TRIES:
        theta, hyper = _truth(template, believed, rng)
        still = flight.still()
        unknowns = Unknowns(*(rng.standard_normal(np.shape(a)) for a in still))
        latent_path = latent_path_of(flight, hyper, unknowns)
        y = -np.asarray(residuals(blank, theta, latent_path))
        if np.isfinite(y).all() and (np.abs(y).max(axis=0) <= largest).all():
            break
        redrawn += 1
    else:
        of = "prior" if believed is None else "posterior"
        raise FloatingPointError(f"{_TRIES} draws of the {of} in a row did not fly")
    noise = colour(hyper.outputs(flight), flight.dt, *(jnp.asarray(rng.standard_normal(y.shape)) for _ in range(2)))
    return Drawn(replace(flight, observed=y + np.asarray(noise)), theta, hyper, latent_path, redrawn)


def derived(template: Template, found: LaplaceFit, xi: Array, seed: int) -> dict[str, Array]:
    """Draws of the derived quantities of the last flight (B,).

    Every group of draws has its own noise parameters, and parameters conditional on them.

    Args:
        template: The template.
        found: The fit.
        xi: Draws of the parameters given fixed noise parameters, standard coordinates (B, P).
        seed: Seed.
    """
    marginal, rng = found.marginal, stream(seed, "derived quantities")
    flight, at = marginal.flights[-1], to_vector(found.hyper)
    root, parts = np.linalg.cholesky(found.noise_parameter_covariance), []
    for start in range(0, len(xi), _GROUP):
        pick = np.minimum(np.arange(start, start + _GROUP), len(xi) - 1)
        moved = root @ rng.standard_normal(at.size)
        noise_parameters = from_vector(at + moved, found.hyper)
        shifted = found.noise_effect.carried(xi[pick], moved).T
        numbers = tuple(normals(f, _GROUP, rng) for f in marginal.flights)
        x = np.asarray(draw_flights(marginal, shifted, numbers, noise_parameters)[-1].path)
        parts.append({k: v[: len(xi) - start] for k, v in template.quantities(flight, x).items()})
    return {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}


def ranked(
    seed: int,
    template: Template,
    levels: int = 99,
    chains: int = 4,
    draws: int = 250,
    shift: float = 0.3,
    believed: Believed | None = None,
) -> Row:
    """Draw, identify and rank one replicate, and rank its parameters among draws that were spoiled on purpose.

    Args:
        seed: Of everything.
        template: The template.
        levels: Ranks go from 0 to this.
        chains: Chains of the sampler.
        draws: Draws of each.
        shift: Spoiled draws are moved by this many posterior standard deviations along every axis.
        believed: Truths come from this posterior, and the template's record is fitted together with the replicate's;
            from the priors, the replicate's alone, where None.

    Returns:
        A row for a campaign: ranks by name, those among spoiled draws (parameters only), and how many truths were
        drawn anew.

    Raises:
        FloatingPointError: If simulations fail, or the fit says that it has not converged.
    """
    made = draw(template, seed, believed)
    flights = [made.flight] if believed is None else [template.flight, made.flight]
    found = find(flights, template.priors, template.noise)
    if not found.optimum.converged:
        raise FloatingPointError("the fit did not converge, and says so")
    held = sample(found.marginal, "nuts", chains, 200, draws, seed).xi.reshape(-1, len(template.priors))
    centre, scale = np.asarray(found.marginal.centre), np.asarray(found.marginal.scale)
    wide = widened(held, found.noise_effect, found.noise_parameter_covariance, seed)

    def ranks_among(xi: Array) -> dict[str, int]:
        theta = centre + xi @ scale.T
        return {p.name: rank(theta[:, i], float(made.theta[i]), levels) for i, p in enumerate(template.priors)}

    ranks, spoiled = ranks_among(wide), ranks_among(wide + shift)
    few = held[np.linspace(0, len(held) - 1, levels).astype(int)]
    truth = template.quantities(made.flight, np.asarray(states(made.flight, made.theta, made.latent_path))[..., None])
    for name, values in derived(template, found, few, seed).items():
        ranks[name] = rank(np.where(np.isfinite(values), values, np.inf), float(truth[name][0]), levels)
    return {"ok": True, "ranks": ranks, "spoiled": spoiled, "redrawn": made.redrawn}


def tested(
    rows: Sequence[Row], levels: int = 99, probability: float = 0.95, which: str = "ranks"
) -> dict[str, EcdfTest]:
    """Whether ranks are uniform, by quantity, in bands that hold for all quantities together.

    Args:
        rows: Rows of `ranked` that are ok.
        levels: As given to `ranked`.
        probability: Of all curves of a right inference being inside.
        which: ``"ranks"`` or ``"spoiled"``.
    """
    names = list(rows[0][which])
    return {
        name: uniform(np.array([row[which][name] for row in rows]), levels, probability, len(names)) for name in names
    }


def swing_quantities(swing: Array, descent: Array, dt: float) -> dict[str, Array]:
    """Derived quantities of a flight: of its swing angle [rad] and descent rate [m/s], each (T, B).

    Returns:
        Swing amplitude (root two times the rms about its mean over the last half) [rad], frequency (rms rate over rms
        angle) [Hz], mean descent rate and that at the last sample [m/s].
    """
    late = swing[len(swing) // 2 :]
    late = late - late.mean(axis=0)
    size = late.std(axis=0)
    rate = np.gradient(late, dt, axis=0).std(axis=0)
    return {
        "swing amplitude": np.sqrt(2.0) * size,
        "swing frequency": rate / size / (2.0 * np.pi),
        "mean descent rate": descent.mean(axis=0),
        "descent rate at the end": descent[-1],
    }
