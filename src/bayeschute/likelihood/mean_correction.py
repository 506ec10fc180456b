"""Second-order (curvature) correction of the predicted mean of a linearised flight (second-order filter).

Given the parameters, initial state and disturbances are uncertain over a range in which the flight is not quite linear.
The expected states and outputs over that range differ from those on the most probable trajectory by half the curvature
times the covariance; a marginal density without this correction biases parameters by up to half a standard deviation.
It is the term by which a second-order filter differs from an extended Kalman filter (Jazwinski 1970, section 9.3).
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from bayeschute.core.random import stream
from bayeschute.core.vectors import Component
from bayeschute.likelihood.joint import Course, FlightData, Linear, NoiseParameters, as_seen, course, moved, stepped
from bayeschute.likelihood.kalman import Gains, MeanCorrection, Seen, innovations
from bayeschute.likelihood.simulation_smoother import drawn, normals

_PAIRS, _FEW = 32, 8  # of paths: for the gap itself, and for its change from place to place
_SHARES = (1.0, 0.5, 0.25, 0.125)  # of the conditional law's width at which pairs are tried


def mean(
    flight: FlightData, hyper: NoiseParameters, made: Gains, theta: Component, driven: Course, rough: bool = False
) -> tuple[MeanCorrection, int]:
    """Mean displacement of steps and outputs over the conditional law of path, start and disturbances.

    Draws come in pairs about the optimum, so that all that is linear cancels exactly. A pair is left out, and counted,
    where a step fails, or leads farther off than any state of the draws lies, as beyond an edge of what the model can
    fly. Where fewer than half of them are left, pairs are drawn together; what is left of them is of second order, so
    it is divided by the square of how much they were.

    Args:
        flight: The record.
        hyper: Noise parameters.
        made: The filter of the flight linearised along the path.
        theta: Parameters (P,).
        driven: The conditional optimum, with its path.
        rough: Few pairs, close together: for the change from place to place, which these tell as well.

    Returns:
        The gap, and how many pairs were left out at their full width.

    Raises:
        FloatingPointError: If fewer than half are left at every width.
    """
    pairs, shares = (_FEW, _SHARES[2:]) if rough else (_PAIRS, _SHARES)
    (samples, states), outputs = np.shape(driven.path), np.shape(flight.observed)[1]
    blank = Seen(jnp.zeros((samples, outputs, pairs)), jnp.zeros((samples, states, pairs)))
    z = normals(flight, pairs, stream(0, "pairs of the mean flight"))
    off = drawn(flight, hyper, made, blank, z)
    by = course(flight, hyper, off.unknowns)
    wide, lost = jnp.repeat(jnp.asarray(theta)[:, None], 2 * pairs, axis=1), 0
    path = jnp.repeat(jnp.asarray(driven.path)[..., None], 2 * pairs, axis=2)
    still = [np.asarray(a)[..., None] for a in stepped(flight, jnp.asarray(theta), driven)]
    for share in shares:
        start, error = (
            jnp.concatenate([m[..., None] + share * d, m[..., None] - share * d], axis=-1)
            for m, d in zip(driven[:2], by[:2], strict=True)
        )
        away = share * jnp.concatenate([off.states, -off.states], axis=-1)
        residual, defects = stepped(flight, wide, Course(start, error, moved(flight, path, away)))
        both = [np.asarray(a) - b for a, b in zip((residual, defects), still, strict=True)]
        by_pair = [0.5 * (a[..., :pairs] + a[..., pairs:]) for a in both]
        farthest = np.max(np.abs(np.asarray(away)), axis=(0, 2))[:, None]
        good = np.isfinite(by_pair[0]).all(axis=(0, 1)) & (np.abs(by_pair[1]) <= farthest + 1e-9).all(axis=(0, 1))
        lost = lost or int((~good).sum())
        if 2 * good.sum() >= pairs:
            less, more = (jnp.asarray(a[..., good].mean(axis=-1) / share**2) for a in by_pair)
            return MeanCorrection(-less, more), lost
    raise FloatingPointError("steps under most drawn disturbances about the optimum fail")


@jax.jit
def slope(linear: Linear, made: Gains, gap: MeanCorrection) -> jax.Array:
    """What a gap adds to the slope of minus the log density by theta (P,), where the flight was linearised."""
    seen = as_seen(linear)
    alone = Seen(*(part.at[..., 0].set(0.0) for part in seen)).less(gap)
    unit = innovations(made, *alone)
    unit = unit.reshape(-1, unit.shape[2])
    return -unit[:, 1:].T @ unit[:, 0]
