"""Check case 13: an undamped riser goes slack and taut again; energy is conserved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayeschute.dynamics import forces
from bayeschute.verification.case_results import Result, single, unturned
from bayeschute.verification.flying import MEMBERS, Flown, Weather, begin, fly, leaning
from bayeschute.verification.sets import Array, ParameterSet

SLACK_AT_START = 1.0  # [m]


def _relative(s: ParameterSet, stiffer: float) -> tuple[float, float, float]:
    """Reduced mass [kg], stiffness of both risers [N/m], acceleration apart while slack [m/s^2]."""
    canopies = 2.0 * s.canopy_mass
    reduced = s.capsule_mass * canopies / (s.capsule_mass + canopies)
    return reduced, 2.0 * s.stiffness * stiffer, s.gravity - s.dry_weight / s.canopy_mass


def stretch(s: ParameterSet, stiffer: float, time: Array) -> Array:
    """Stretch, negative while slack, from rest at `SLACK_AT_START` (T,) [m]: parabolas and half-swings in turn."""
    mass, stiffness, pull = _relative(s, stiffer)
    w, rest = np.sqrt(stiffness / mass), mass * pull / stiffness
    fall = np.sqrt(2.0 * SLACK_AT_START / pull)
    speed = pull * fall  # at which the riser becomes taut
    swing = 2.0 * (np.pi - np.arctan2(speed / w, rest)) / w  # how long it stays so
    phase = np.mod(time, 2.0 * fall + swing)
    taut = phase - fall
    loose = np.where(taut > swing, phase - 2.0 * fall - swing, phase)  # time from the nearest point of rest
    slack = -SLACK_AT_START + 0.5 * pull * loose**2
    return np.where(
        (taut > 0.0) & (taut < swing), rest * (1.0 - np.cos(w * taut)) + speed / w * np.sin(w * taut), slack
    )


def energy(s: ParameterSet, stiffer: float, flown: Flown, b: int, unstretched: float) -> Array:
    """Energy of everything (T,) [J]: motion, weight of what is dry, stretch."""
    _, state = flown.member(b)
    canopies = state.canopy_velocity
    squares = (np.asarray(c**2).sum(axis=0) for c in (canopies.x, canopies.y, canopies.z))
    motion = 0.5 * s.canopy_mass * sum(squares) + 0.5 * s.capsule_mass * np.asarray(state.velocity.z**2)
    height = -s.capsule_mass * s.gravity * np.asarray(state.position.z)
    height = height - s.dry_weight * np.asarray(state.canopy_position.z).sum(axis=0)
    taut = np.maximum(np.asarray(state.position.z - state.canopy_position.z) - unstretched, 0.0)
    return np.asarray(motion + height + 0.5 * s.stiffness * stiffer * (taut**2).sum(axis=0))


def bouncing() -> list[Result]:
    """Case 13: bounces in a vertical line without air force and damping; steps of 0.5 ms."""
    starts, models = [], []
    for s, stiffer in MEMBERS:
        starts.append(begin(s, leaning(0.0), np.zeros((3, 2)), (0.0, 0.0, 0.0)))
        model = s.cluster((0.0,), (), -SLACK_AT_START * s.stiffness * stiffer, stiffer)
        # The reference is linear from the first bit of stretch.
        models.append(replace(model, risers=replace(model.risers, damping=0.0, engagement=1e-9)))
    flown = fly(forces.drag, starts, models, [Weather(s.density) for s, _ in MEMBERS], 800, 0.0125)
    lost, off = [], []
    for b, (s, stiffer) in enumerate(MEMBERS):
        mass, _, pull = _relative(s, stiffer)
        unstretched = models[b].risers.length
        total = energy(s, stiffer, flown, b, unstretched)
        lost.append((total - total[0]) / (mass * pull * SLACK_AT_START))
        time, state = flown.member(b)
        apart = np.asarray(state.position.z - state.canopy_position.z[0]) - unstretched
        off.append(apart - stretch(s, stiffer, time))
    lines = []
    for b, (_, stiffer) in enumerate(MEMBERS):  # what a step across the edge of slack gets wrong grows with k
        lines.append(single("13", b, "energy over that of a bounce", "constant", "", lost[b], 1e-5 * stiffer))
        lines.append(single("13", b, "stretch over 10 s", "parabolas and sines", "ft", off[b], 4e-4 * stiffer))
    return [*lines, unturned("13", flown)]
