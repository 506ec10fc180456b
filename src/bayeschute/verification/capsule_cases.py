"""Check cases 11 and 12: the capsule's attitude, free of torque and hanging from its risers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from bayeschute.core.vectors import Vec3
from bayeschute.dynamics import forces
from bayeschute.dynamics.parameters import Capsule, Cluster
from bayeschute.verification.case_results import Result, all_members
from bayeschute.verification.flying import MEMBERS, Flown, Weather, begin, fly, leaning
from bayeschute.verification.sets import Array, ParameterSet

AXIAL_INERTIA, LATERAL_INERTIA = 20e3, 25e3  # [kg m^2]
SPIN = np.array([0.5, 0.3, -0.2])  # initial body rate [rad/s]
ATTACH_B = np.array([1.9, 0.10, 0.05])  # [m]
DAMPING = -30.0  # C_mq = C_lp: swings of the hanging capsule die out within seconds


def _symmetric(s: ParameterSet, damping: float) -> Capsule:
    inertia = Vec3(AXIAL_INERTIA, LATERAL_INERTIA, LATERAL_INERTIA)
    attach = Vec3(*(float(a) for a in ATTACH_B))
    return replace(s.particle(), inertia=inertia, attach_b=attach, roll_damping=damping, pitch_damping=damping)


def top(time: Array) -> tuple[Array, Rotation]:
    """Body rate (T, 3) [rad/s] and attitude, body to NED, of a torque-free symmetric body (Euler).

    Its rate is the sum of a turn about the fixed angular momentum and one about its own axis.
    """
    drift = (AXIAL_INERTIA - LATERAL_INERTIA) / LATERAL_INERTIA * SPIN[0]
    across = (SPIN[1] + 1j * SPIN[2]) * np.exp(1j * drift * time)
    rate = np.stack([np.full_like(time, SPIN[0]), across.real, across.imag], axis=1)
    momentum = np.array([AXIAL_INERTIA, LATERAL_INERTIA, LATERAL_INERTIA]) * SPIN
    about_momentum = Rotation.from_rotvec(time[:, None] * momentum / LATERAL_INERTIA)
    about_axis = Rotation.from_rotvec(-drift * time[:, None] * np.array([1.0, 0.0, 0.0]))
    return rate, about_momentum * about_axis


def _attitude(flown: Flown, b: int) -> Rotation:
    return Rotation.from_quat(flown.states[:, 6:10, b], scalar_first=True)


def torque_free() -> list[Result]:
    """Case 11: a symmetric top in free fall with slack risers, whose attach point is off its centre of mass."""
    starts, models = [], []
    for s, stiffer in MEMBERS:
        x = begin(s, leaning(0.0), np.zeros((3, 2)), (0.0, 0.0, 0.0))
        x[10:13] = SPIN
        slack = -10.0 * s.stiffness * stiffer  # risers 10 m too long
        model = s.cluster((0.0,), (), slack, stiffer, _symmetric(s, 0.0))
        starts.append(x)
        models.append(replace(model, canopies=replace(model.canopies, enclosed_volume=0.0)))  # falls like the capsule
    flown = fly(forces.drag, starts, models, [Weather(s.density) for s, _ in MEMBERS], 600)
    rates, turned, fallen = [], [], []
    for b, (s, _) in enumerate(MEMBERS):
        time = flown.time[:, b]
        rate, attitude = top(time)
        rates.append(flown.states[:, 10:13, b] - rate)
        turned.append((attitude.inv() * _attitude(flown, b)).magnitude())
        fallen.append(flown.states[:, 5, b] - s.gravity * time)
    lines = all_members("11", "body rate, rad/s", "Euler's top", "", rates, 1e-11)
    lines += all_members("11", "attitude", "Euler's top", "deg", turned, 1e-9)
    return lines + all_members("11", "capsule speed", "free fall", "ft/s", fallen, 5e-9)


def hang_angle() -> float:
    """Equilibrium angle of the capsule's axis off the vertical [rad]: the attach point is above the centre of mass."""
    return float(np.arctan2(np.hypot(ATTACH_B[1], ATTACH_B[2]), ATTACH_B[0]))


def _hanging(s: ParameterSet, stiffer: float, attitude: Rotation) -> tuple[Array, Cluster]:
    """A non-rotating capsule at an attitude under vertical risers, at the terminal speed of the system."""
    x = begin(s, leaning(0.0), np.zeros((3, 2)), (0.0, 0.0, s.terminal_speed))
    x[6:10] = attitude.as_quat(scalar_first=True)
    x[13:19] = (x[13:19].reshape(3, 2) + attitude.apply(ATTACH_B)[:, None]).ravel()
    return x, s.cluster((s.C_A,), (), s.capsule_mass * s.gravity / 2.0, stiffer, _symmetric(s, DAMPING))


def _leans(attitude: Rotation, samples: int) -> list[Array]:
    """Angle of the capsule's axis off the vertical in the last samples, less the hang angle, for every member."""
    starts, models = zip(*[_hanging(s, stiffer, attitude) for s, stiffer in MEMBERS], strict=True)
    flown, leans = fly(forces.drag, starts, models, [Weather(s.density) for s, _ in MEMBERS], 1200), []
    for b in range(len(MEMBERS)):
        axis = _attitude(flown, b).apply(np.array([1.0, 0.0, 0.0]))[-samples:]
        leans.append(np.arctan2(np.hypot(axis[:, 0], axis[:, 1]), -axis[:, 2]) - hang_angle())
    return leans


def hanging() -> list[Result]:
    """Case 12: tan of the hang angle is lateral over axial offset; a capsule keeps it, one let go upright finds it."""
    upright = Rotation.from_rotvec([0.0, np.pi / 2.0, 0.0])  # body x axis up
    hung, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [ATTACH_B])
    reference = "atan(lateral/axial)"
    lines = all_members("12", "lean of a capsule that hangs", reference, "deg", _leans(hung, 1201), 1e-10)
    settled = _leans(upright, 100)
    return lines + all_members("12", "lean of one let go upright, at 120 s", reference, "deg", settled, 2e-4)
