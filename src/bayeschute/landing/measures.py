"""Measures of a landing: speeds, angles, velocity in body axes, tensions and drift, one row each."""

from __future__ import annotations

import numpy as np

LABELS = ("steady", "glide", "pendulum", "cone", "flyout", "maypole")
"""What a cluster does in the last seconds before touchdown."""

IDS = ("draw", "wind", "start", "gust", "canopies", "surface")
"""What a landing is made of: numbers by which its parameters, its wind and so on are drawn again."""

MEASURES = {
    "time": ("s", "from the start to touchdown"),
    "vertical_speed": ("m/s", "of the capsule, downwards"),
    "horizontal_speed": ("m/s", "of the capsule over the ground"),
    "sea_level_vertical_speed": ("m/s", "vertical speed times the root of the density over that at sea level"),
    "swing_angle": ("rad", "of the risers' mean direction off the vertical"),
    "swing_amplitude": ("rad", "of the swing in the last seconds: root two times its rms"),
    "swing_phase": (
        "rad",
        "of the swing: 0 at its side, pi/2 on the way back through the middle, -pi/2 on the way out",
    ),
    "flyout_angle": ("rad", "half of the angle between two risers, mean over pairs"),
    "hang_angle": ("rad", "of the capsule's axis off the vertical"),
    "normal_speed": ("m/s", "of the capsule into the surface, along its normal, relative to the water if it is water"),
    "tangential_speed": ("m/s", "of the capsule along the surface, relative to the water if it is water"),
    "surface_angle": ("rad", "between the capsule's axis and the surface's normal, 0: heat shield flat on the surface"),
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
    "surface_slope": ("rad", "of the surface that is touched, along its steepest descent"),
    "surface_slope_direction": ("rad", "azimuth of that descent, 0 where it is level"),
    "surface_rise": ("m/s", "upwards, rate of the surface's height where it is touched"),
    "wind_shear": ("m/s", "greatest change of the horizontal wind over 100 m of altitude on the way down, gusts aside"),
    "start_altitude": ("m", "of the capsule above the sea"),
    "start_swing": ("rad", "swing angle at the start"),
    "turning": ("rad/s", "mean rate of turn of the canopies about each other in the last seconds"),
    "glide_angle": ("rad", "of the mean path of the canopies through the air off the vertical in the last seconds"),
}
"""Unit and meaning of every number of a landing."""

ON_LEVEL_GROUND = {
    "normal_speed": "vertical_speed",
    "tangential_speed": "horizontal_speed",
    "surface_angle": "hang_angle",
}
"""What measures against the surface are on level ground at rest."""

ROW = np.dtype(
    [(name, np.int64) for name in IDS]
    + [("outcome", np.int8), ("label", np.int8), ("profile", np.int16)]
    + [(name, np.float64) for name in MEASURES]
)
"""A row of landings; numbers of a landing that failed are NaN, its label is -1."""
OUTCOMES = ("ok", "diverged", "not down in time")
