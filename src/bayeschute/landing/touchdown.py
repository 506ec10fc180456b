"""What a landing is: speeds, angles, velocity in the capsule's axes, tensions and drift, one row each."""

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
IDS = ("draw", "wind", "start", "gust", "canopies")
"""What a landing is made of: numbers by which its parameters, its wind and so on are drawn again."""

MEASURES = {
    "time": ("s", "from the start to touchdown"),
    "vertical_speed": ("m/s", "of the capsule, downwards"),
    "horizontal_speed": ("m/s", "of the capsule over the ground"),
    "sea_level_vertical_speed": ("m/s", "vertical speed times the root of the density over that at sea level"),
    "swing_angle": ("rad", "of the risers' mean direction off the vertical"),
    "swing_amplitude": ("rad", "of the swing in the last seconds: root two times its rms"),
    "swing_phase": ("rad", "of the swing: 0 at its side, pi/2 on the way back through the middle, -pi/2 on the way out"),
    "flyout_angle": ("rad", "half of the angle between two risers, mean over pairs"),
    "hang_angle": ("rad", "of the capsule's axis off the vertical"),
    "incidence": ("rad", "between the capsule's velocity over the ground and its axis, 0: heat shield first"),
    "incidence_direction": ("rad", "about the axis, from body z towards body y: where that velocity comes to"),
    "velocity_x": ("m/s", "over the ground along body x, towards the risers"),
    "velocity_y": ("m/s", "over the ground along body y"),
    "velocity_z": ("m/s", "over the ground along body z"),
    "riser_tension": ("N", "greatest of the risers' tensions"),
    "riser_tension_sum": ("N", "of all risers"),
    "drift_north": ("m", "from the start to touchdown"),
    "drift_east": ("m", "from the start to touchdown"),
    "surface_wind_north": ("m/s", "at touchdown, gusts included"),
    "surface_wind_east": ("m/s", "at touchdown, gusts included"),
    "wind_shear": ("m/s", "greatest change of the horizontal wind over 100 m of altitude on the way down, gusts aside"),
    "start_altitude": ("m", "of the capsule above the sea"),
    "start_swing": ("rad", "swing angle at the start"),
    "turning": ("rad/s", "mean rate of turn of the canopies about each other in the last seconds"),
    "glide_angle": ("rad", "of the mean path of the canopies through the air off the vertical in the last seconds"),
}
"""Unit and meaning of every number of a landing."""

ROW = np.dtype(
    [(name, np.int64) for name in IDS]
    + [("outcome", np.int8), ("label", np.int8)]
    + [(name, np.float64) for name in MEASURES]
)
"""A row of landings; numbers of a landing that failed are NaN, its label is -1."""
OUTCOMES = ("ok", "diverged", "not down in time")


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
