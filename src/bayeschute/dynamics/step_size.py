"""Runge-Kutta steps per sample, and their method, from the stability limit that stiff risers set."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from itertools import count

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.compiler.derivative import Jacobian
from bayeschute.compiler.graph import SHARED
from bayeschute.compiler.programs import initial, kind_of, opening
from bayeschute.compiler.runge_kutta import CLASSICAL, EXTENDED, RungeKutta, Stepping
from bayeschute.compiler.trace import Traced, trace
from bayeschute.dynamics.cluster import state_rate
from bayeschute.dynamics.cluster_flight import ClusterFlight, air_between

_MARGIN = 0.85
_LEAST = 3, 2  # classical and extended steps per sample that accuracy wants anyway
_LONGEST = 0.1  # [s] of a sample that extended steps go through: two steps, of which longer ones err where risers jolt
_ROUNDING = 1e-9
_REACH = 9.0  # no method is stable farther from zero
_known: dict[Hashable, tuple[Traced, Jacobian]] = {}  # first state, and slope of the rate by the state, by kind


def _rate(flight: ClusterFlight, theta: jax.Array, x: jax.Array) -> jax.Array:
    """In the air of the first sample."""
    now = jax.tree.map(lambda a: a[0], flight.record)
    zero = jnp.zeros(3)
    air = air_between(now, now, zero, zero, 0.0, flight.dt)
    return state_rate(x, flight.numbers(theta), flight.structure, air)


def poles(flight: ClusterFlight, thetas: Sequence[np.ndarray], deviations: int) -> NDArray[np.complex128]:
    """Poles at the start of a flight [1/s].

    Args:
        flight: The flight.
        thetas: Parameters in working coordinates (P,), all together of interest.
        deviations: Number of initial deviations, all zero here.
    """
    begun, still = opening(flight), np.zeros(deviations)
    kind = kind_of(begun), len(thetas[0]), deviations
    if kind not in _known:
        first = trace(initial, (begun, thetas[0], still), (SHARED, "theta", "start"))
        rate = trace(_rate, (begun, thetas[0], np.zeros(len(first.result))), (SHARED, "theta", "x"))
        _known[kind] = first, Jacobian(rate, "x")
    first, slope = _known[kind]
    found = [slope.at(begun, theta, first.value(begun, theta, still)) for theta in thetas]
    return np.concatenate([np.linalg.eigvals(one) for one in found]).astype(complex)


def enough(method: RungeKutta, found: NDArray[np.complex128], dt: float, least: int = 1) -> int:
    """The fewest steps per sample that keep all modes stable that decay, with a margin of 15 %.

    A mode is looked at all the way from rest to its pole: where a riser is half taut it is slower.

    Args:
        method: Of the steps.
        found: Poles expected [1/s] (N,), priors' upper tails included.
        dt: Sample interval [s].
        least: Steps that accuracy wants anyway.

    Raises:
        ValueError: If a pole is not finite.
    """
    if not np.isfinite(found).all():
        raise ValueError("a flight whose poles are not finite has no stable step")
    decaying = found[found.real <= 0.0] * dt / _MARGIN
    way = np.linspace(0.0, 1.0, 101)[1:, None] * decaying
    first = max(least, int(np.max(np.abs(decaying), initial=0.0) / _REACH))

    def stable(substeps: int) -> bool:
        return bool((np.abs(np.polyval(method.growth[::-1], way / substeps)) <= 1.0 + _ROUNDING).all())

    return next(substeps for substeps in count(first) if stable(substeps))


def steps(found: NDArray[np.complex128], dt: float) -> Stepping:
    """The method and its steps per sample with the fewest stages that are `enough`.

    Extended steps are stable at lengths at which they are wrong where gusts jolt a riser: touchdowns were off by
    0.7 m/s in steps of 0.1 s. Even in steps of 0.05 s a fit to a poor record of 5 Hz (set U) missed checks that it had
    passed in classical steps. So samples longer than 0.1 s are gone through in these.

    Args:
        found: Poles expected [1/s] (N,).
        dt: Sample interval [s].

    Raises:
        ValueError: If a pole is not finite.
    """
    classical = enough(CLASSICAL, found, dt, _LEAST[0])
    choices = [Stepping(classical, CLASSICAL, classical)]
    if dt <= _LONGEST * (1.0 + _ROUNDING):
        choices.append(Stepping(enough(EXTENDED, found, dt, _LEAST[1]), EXTENDED, classical))
    return min(choices, key=lambda one: one.stages)
