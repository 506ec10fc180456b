"""Check cases 4 and 5: steady flights that must not change, a glide and a descent through a horizontal shear."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

from bayeschute.dynamics import forces
from bayeschute.verification.case_results import Result, all_members, single, unturned
from bayeschute.verification.flying import MEMBERS, Flown, Weather, begin, fly, leaning
from bayeschute.verification.sets import Array, ParameterSet

# Table 7.1-2: C_A0, C_Aalpha [1/rad], alpha_0 [rad]; C_Nalpha [1/rad], C_Nalphadot [s/rad].
AXIAL = (0.927, -0.329, 0.189)
NORMAL, NORMAL_RATE = 0.1901, -0.988
SHEAR = 0.05  # [1/s]


def riser_lean(flown: Flown, member: int) -> tuple[Array, Array]:
    """Lean of the first riser off the vertical and its azimuth from north, both (T,) [rad]."""
    _, state = flown.member(member)
    line = state.canopy_position - state.position
    x, y, z = (np.asarray(c[0]) for c in (line.x, line.y, line.z))
    return np.arctan2(np.hypot(x, y), -z), np.unwrap(np.arctan2(y, x))


def swing(flown: Flown, member: int) -> Array:
    """Lean of the first riser in the north-down plane, with sign (T,) [rad]."""
    _, state = flown.member(member)
    line = state.canopy_position - state.position
    return np.arctan2(np.asarray(line.x[0]), -np.asarray(line.z[0]))


def steady_glide() -> list[Result]:
    """Case 4: a glide at the trim angle of attack under vertical risers, C_A and C_N by Table 7.1-2.

    It is seen from a frame that glides along: coordinates, and with them rounding, stay small.
    """
    starts, models, air = [], [], []
    for s, stiffer in MEMBERS:
        starts.append(begin(s, leaning(0.0), np.zeros((3, 2)), (0.0, 0.0, 0.0)))
        models.append(s.cluster(AXIAL, (NORMAL, 0.0), s.capsule_mass * s.gravity / 2.0, stiffer))
        north, down = glide_velocity(s)
        air.append(Weather(s.density, north=-north, down=-down))
    flown = fly(forces.pitch_plane, starts, models, air, 600)
    velocity, leans, pulls = [], [], []
    for b, (s, _) in enumerate(MEMBERS):
        _, state = flown.member(b)
        velocity.append(np.asarray(state.canopy_velocity.stack()))
        leans.append(swing(flown, b))
        pulls.append(flown.tension(b, models[b]) - s.capsule_mass * s.gravity / 2.0)
    lines = all_members("4", "canopy velocity off the glide", "constant", "ft/s", velocity, 8e-13)
    lines += all_members("4", "lean of the riser", "vertical", "deg", leans, 8e-13)
    lines += all_members("4", "tension of the riser", "W_L/2", "lbf", pulls, 1e-7)
    return [*lines, unturned("4", flown)]


def glide_velocity(s: ParameterSet) -> tuple[float, float]:
    """Case 4: north and down velocity [m/s] at which 2 q S C_A0 carries the weight at the trim angle."""
    speed = np.sqrt(s.weight / (s.density * s.area * AXIAL[0]))
    return float(speed * np.sin(AXIAL[2])), float(speed * np.cos(AXIAL[2]))


def shear_flight(s: ParameterSet) -> tuple[float, float, float]:
    """Case 5: sink rate and north velocity through the air [m/s], and lean of the risers [rad], all constant."""

    def excess(v_z: float) -> float:
        return s.kappa * v_z**2 * np.sqrt(1.0 + (SHEAR * v_z / s.fall) ** 2) - s.fall

    v_z = brentq(excess, 0.1 * s.terminal_speed, 2.0 * s.terminal_speed, xtol=1e-15, rtol=4.0 * np.finfo(float).eps)
    return v_z, -SHEAR * v_z**2 / s.fall, float(np.arctan(SHEAR * v_z / s.gravity))


def horizontal_shear() -> list[Result]:
    """Case 5: through a horizontal wind that grows with depth, all bodies have the same acceleration.

    It is seen from a frame that sinks along and moves north at the mean speed, so that coordinates stay small. Rounding
    adds up by the step, and risers ten times as stiff want steps a tenth as long: their bound is ten times as wide.
    """
    duration = 60.0
    starts, models, air = [], [], []
    for s, stiffer in MEMBERS:
        v_z, behind, lean = shear_flight(s)
        mean = SHEAR * v_z * duration / 2.0
        starts.append(begin(s, leaning(lean), np.zeros((3, 2)), (behind - mean, 0.0, 0.0)))
        models.append(s.cluster((s.C_A,), (), s.capsule_mass * s.gravity / (2.0 * np.cos(lean)), stiffer))
        air.append(Weather(s.density, north_shear=SHEAR, north=-mean, north_ramp=SHEAR * v_z, down=-v_z))
    flown = fly(forces.drag, starts, models, air, 600, [1.0 / stiffer for _, stiffer in MEMBERS])
    lines = []
    for b, (s, stiffer) in enumerate(MEMBERS):
        v_z, behind, lean = shear_flight(s)
        time, state = flown.member(b, duration)
        wind = air[b].north + air[b].north_ramp * time + SHEAR * np.asarray(state.canopy_position.z)
        north, down = np.asarray(state.canopy_velocity.x) - wind - behind, np.asarray(state.canopy_velocity.z)
        velocity, leans = np.concatenate([north, down]), swing(flown, b)[: len(time)] - lean
        pull = flown.tension(b, models[b])[:, : len(time)] - s.capsule_mass * s.gravity / (2.0 * np.cos(lean))
        name = "canopy velocity through the air"
        lines.append(single("5", b, name, "cubic in v_z^2", "ft/s", velocity, 2e-13 * stiffer))
        lines.append(single("5", b, "lean of the riser", "atan(a v_z/g)", "rad", leans, 2e-13))
        lines.append(single("5", b, "tension of the riser", "W_L/(2 cos)", "lbf", pull, 1e-7))
    return [*lines, unturned("5", flown)]
