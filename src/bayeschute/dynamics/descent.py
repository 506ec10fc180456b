"""A point mass falling under drag, for dropsondes, rockets and descent-rate studies."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp

from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY
from bayeschute.compiler.runge_kutta import Stepping, advanced
from bayeschute.core.vectors import Component
from bayeschute.dynamics.parameters import STANDARD_GRAVITY


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DensityProfile:
    """Air density by altitude: logarithms on an even grid, linear between, continued beyond the ends.

    Attributes:
        lowest: Altitude of the first node [m].
        spacing: Distance of the nodes [m].
        log_density: Logarithm of the density [kg/m^3] at the nodes (H,).
    """

    lowest: Component
    spacing: Component
    log_density: Component

    def density(self, altitude: Component) -> Component:
        """Density at an altitude [kg/m^3]."""
        place = (altitude - self.lowest) / self.spacing
        nodes = jnp.asarray(self.log_density)
        below = jnp.clip(jnp.floor(place).astype(int), 0, nodes.shape[0] - 2)
        low, high = nodes[below], nodes[below + 1]
        return jnp.exp(low + (high - low) * (place - below))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DescentInputs:
    """Recorded vertical wind, positive down, at each sample (T,) [m/s]."""

    wind: Component


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class DescentFlight:
    """Vertical descent of a point mass (a `FlightModel`); state: altitude [m], descent rate [m/s].

    The single parameter is the logarithm of C_D S/m [m^2/kg]; ``v' = g - rho/2 (C_D S/m) u abs(u)``, u = v - wind.

    Attributes:
        air: Density by altitude.
        record: Inputs at the samples.
        altitude: Altitude at the first sample [m].
        speed: Reference descent rate at the first sample [m/s].
        dt: Sample interval [s].
        stepping: How it goes through a sample.
    """

    air: DensityProfile
    record: DescentInputs
    altitude: Component
    speed: Component
    dt: Component
    names: tuple[str, ...] = field(default=("cds_over_mass",), metadata={"static": True})
    channels: tuple[str, ...] = field(default=("descent_rate",), metadata={"static": True})
    stepping: Stepping = field(default=Stepping(4), metadata={"static": True})

    def inputs(self) -> DescentInputs:
        """The record's inputs."""
        return self.record

    def numbers(self, theta: jax.Array) -> jax.Array:
        """Half of C_D S/m [m^2/kg]."""
        return 0.5 * jnp.exp(theta[0])

    def initial(self, numbers: jax.Array, start: jax.Array) -> jax.Array:
        """State at the first sample (2, ...)."""
        return jnp.stack([self.altitude + 0.0 * start[0], self.speed + start[0]])

    def advance(self, x: jax.Array, numbers: Any, now: Any, then: Any, error_now: Any, error_then: Any) -> jax.Array:
        """State one sample later."""
        given = numbers, now, then, error_now, error_then
        return advanced(self.stepping, lambda state, share: self.rate(state, *given, share), x, self.dt)

    def rate(
        self, x: jax.Array, numbers: Any, now: Any, then: Any, error_now: Any, error_then: Any, share: Component
    ) -> jax.Array:
        """Rate of the state when this share of the sample has passed."""
        w0, w1 = now.wind + error_now[0], then.wind + error_then[0]
        u = x[1] - (w0 + (w1 - w0) * share)
        return jnp.stack([-x[1], STANDARD_GRAVITY - numbers * self.air.density(x[0]) * u * jnp.abs(u)])

    def observe(self, x: jax.Array, numbers: Any, now: Any) -> jax.Array:
        """The descent rate (1, ...) [m/s]."""
        return x[1:2]


QUANTITIES = ("descent_rate", "sea_level_descent_rate")


def quantity(name: str, x: jax.Array, air: DensityProfile) -> jax.Array:
    """A reported quantity of a state (2, ...): a descent rate [m/s]."""
    if name == "descent_rate":
        return x[1]
    return x[1] * jnp.sqrt(air.density(x[0]) / SEA_LEVEL_DENSITY)
