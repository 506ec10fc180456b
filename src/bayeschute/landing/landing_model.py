"""Model of a cluster on its way to the ground: landings differ by disturbances, not by a record's inputs.

The winds of capsule and canopies, breathing, unexplained forces and roll enter as disturbances of every landing of a
batch; the density follows from the altitude of every body. So one compiled program flies landings of all winds at once.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.atmosphere.standard import standard_density
from bayeschute.compiler import compiled_model as kernel
from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.compiler.runge_kutta import Stepping, advanced
from bayeschute.core.vectors import Component, Vec3, vec3
from bayeschute.dynamics.cluster import Air, state_rate
from bayeschute.dynamics.cluster_flight import with_parameters
from bayeschute.dynamics.parameters import Cluster, Structure
from bayeschute.dynamics.state import unpack

Array = NDArray[np.float64]
_DEGREE = 5  # of the polynomial of the density's logarithm: relative error below 1e-6 over the troposphere


def rows(n: int) -> int:
    """Number of disturbances of a cluster of `n` canopies: two winds, axial factors, pushes north and east, roll."""
    return 7 + 3 * n


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LandingFlight:
    """A few samples of a descent (a `FlightModel`); the start is the whole state.

    Disturbances (7 + 3 n) are the wind at the capsule (3) and at the canopies (3), NED [m/s]; relative changes of the
    axial coefficients (n); transverse coefficients that no term explains, north (n) and east (n); unexplained roll.

    Attributes:
        base: Numbers that are not parameters.
        density: Coefficients of the logarithm of the density by `altitude` scaled to [-1, 1], from `density_law`.
        middle: Middle of those altitudes [m].
        half: Half of their range [m].
        clock: Times of the samples (T,) [s].
        dt: Sample interval [s].
        structure: Terms and options.
        names: Parameters, in the order of theta.
        stepping: How it goes through a sample.
    """

    base: Cluster
    density: Component
    middle: Component
    half: Component
    clock: Component
    dt: Component
    structure: Structure = field(metadata={"static": True})
    names: tuple[str, ...] = field(metadata={"static": True})
    stepping: Stepping = field(metadata={"static": True})

    def inputs(self) -> Component:
        """Times; nothing else is the same for all landings."""
        return self.clock

    def numbers(self, theta: jax.Array) -> Cluster:
        """The cluster with these parameters."""
        return with_parameters(self.base, self.structure, self.names, theta)

    def initial(self, numbers: Cluster, start: jax.Array) -> jax.Array:
        """The state that is given."""
        return 1.0 * start

    def density_at(self, altitude: Component) -> Component:
        """Air density [kg/m^3] at altitudes [m] of any shape."""
        s = (altitude - self.middle) / self.half
        total = self.density[_DEGREE]
        for i in reversed(range(_DEGREE)):
            total = total * s + self.density[i]
        return jnp.exp(total)

    def rate(
        self, x: jax.Array, numbers: Cluster, now: Any, then: Any, error_now: Any, error_then: Any, share: Component
    ) -> jax.Array:
        """Rate of the state when this share of the sample has passed."""
        return state_rate(x, numbers, self.structure, self.air(x, error_now, error_then, share))

    def air(self, x: jax.Array, error_now: Any, error_then: Any, share: Component) -> Air:
        """Air at capsule and canopies when this share of the sample has passed."""
        n = self.structure.canopies
        state = unpack(x, n)
        e, change = error_now + (error_then - error_now) * share, (error_then - error_now) / self.dt
        zero = jnp.zeros_like(e[0])
        still = Vec3(zero, zero, zero)
        factor, push = 1.0 + e[6 : 6 + n], (e[6 + n : 6 + 2 * n], e[6 + 2 * n : 6 + 3 * n])
        high = self.density_at(-state.canopy_position.z)
        aloft = Air(vec3(e[3:6]), vec3(change[3:6]), high, factor, still, push=push)
        low = self.density_at(-state.position.z)
        return Air(vec3(e[0:3]), vec3(change[0:3]), low, factor, still, aloft, roll=e[6 + 3 * n])

    def advance(
        self, x: jax.Array, numbers: Cluster, now: Any, then: Any, error_now: Any, error_then: Any
    ) -> jax.Array:
        """State one sample later."""
        given = numbers, now, then, error_now, error_then
        return advanced(self.stepping, lambda state, share: self.rate(state, *given, share), x, self.dt)

    def observe(self, x: jax.Array, numbers: Cluster, now: Any) -> jax.Array:
        """Altitude of the capsule [m]."""
        return -x[2:3]


def density_law(low: float, high: float) -> tuple[Array, float, float]:
    """Standard density between two altitudes [m] as a polynomial: coefficients of `LandingFlight`, middle, half."""
    middle, half = 0.5 * (low + high), 0.5 * max(high - low, 100.0)
    s = np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    law = np.polynomial.chebyshev.Chebyshev.fit(s, np.log(standard_density(middle + half * s)), _DEGREE, domain=(-1, 1))
    return np.asarray(law.convert(kind=np.polynomial.Polynomial).coef, float), middle, half


def flown(model: LandingFlight, theta: Array, x: Array, error: Array) -> Array:
    """States (T, X, B) from given ones (X, B) on, by machine code where there is some.

    Args:
        model: The samples.
        theta: Parameters (P, B), working coordinates.
        x: States (X, B).
        error: Disturbances (T, 7 + 3 n, B).
    """
    found = kernel.states(model, theta, x, error)
    return np.asarray(trajectory_compiled(model, theta, x, error) if found is None else found)
