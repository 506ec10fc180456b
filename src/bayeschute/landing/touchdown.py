"""Measures of a landing that follow from its state at touchdown."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster import geometry, tension
from bayeschute.dynamics.cluster_flight import quantity
from bayeschute.dynamics.state import unpack
from bayeschute.landing.landing_model import LandingFlight

Array = NDArray[np.float64]


def at_ground(model: LandingFlight, theta: Array, x: Array) -> dict[str, Array]:
    """Numbers that follow from the states (X, B) at touchdown."""
    made: dict[str, Any] = _at_ground(model, theta, x)
    return {name: np.asarray(values) for name, values in made.items()}


@jax.jit
def _at_ground(model: LandingFlight, theta: jax.Array, x: jax.Array) -> dict[str, jax.Array]:
    n, numbers = model.structure.canopies, model.numbers(theta)
    state, density = unpack(x, n), model.density_at(-x[2])
    v_b = state.attitude.to_body(state.velocity)
    one, none = jnp.ones_like(x[0]), jnp.zeros_like(x[0])
    up = state.attitude.to_ned(Vec3(one, none, none))
    pull = tension(geometry(state, numbers.capsule), numbers.risers)
    attach = numbers.capsule.attach_b
    return {
        "vertical_speed": x[5],
        "horizontal_speed": jnp.hypot(x[3], x[4]),
        "sea_level_vertical_speed": quantity("sea_level_descent_rate", x, density, attach, n),
        "swing_angle": quantity("swing_angle", x, density, attach, n),
        "flyout_angle": quantity("flyout_angle", x, density, attach, n),
        "hang_angle": jnp.arctan2(jnp.hypot(up.x, up.y), -up.z),
        "incidence": jnp.arctan2(jnp.hypot(v_b.y, v_b.z), -v_b.x),
        "incidence_direction": jnp.arctan2(v_b.y, v_b.z),
        "velocity_x": v_b.x,
        "velocity_y": v_b.y,
        "velocity_z": v_b.z,
        "riser_tension": pull.max(axis=0),
        "riser_tension_sum": pull.sum(axis=0),
        "drift_north": x[0],
        "drift_east": x[1],
    }
