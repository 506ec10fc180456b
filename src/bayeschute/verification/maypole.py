"""Check case 8: two canopies orbit the vertical, an exact relative equilibrium (report 6.3.2-14..26)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bayeschute.dynamics import forces
from bayeschute.verification.case_results import Result, single, unturned
from bayeschute.verification.flying import MEMBERS, Weather, begin, fly, leaning
from bayeschute.verification.sets import FOOT, ParameterSet

RADIUS, PERIOD = 50.0 * FOOT, 35.0


class Maypole(NamedTuple):
    """The orbit of a parameter set.

    Attributes:
        lean: Phi = asin(R/L) [rad].
        spin: Omega [rad/s].
        load: Dynamic pressure times area of one canopy [N].
        normal: C_N towards the axis (6.3.2-22).
        sink: Descent rate [m/s].
        turn: Angle by which the orbital speed turns the wind frame about the canopy axis [rad].
    """

    lean: float
    spin: float
    load: float
    normal: float
    sink: float
    turn: float


def maypole(s: ParameterSet) -> Maypole:
    """Radius and period make the forces: those across the riser and, with 6.3.2-25, the weight."""
    lean, spin = float(np.arcsin(RADIUS / s.length)), 2.0 * np.pi / PERIOD
    across = s.canopy_mass * RADIUS * spin**2 * np.cos(lean) + s.dry_weight * np.sin(lean)
    load = (s.weight / 2.0 - across * np.sin(lean)) / (s.C_A * np.cos(lean))
    speed = np.sqrt(2.0 * load / (s.density * s.area))
    sink = np.sqrt(speed**2 - (spin * RADIUS) ** 2)
    turn = np.arctan2(spin * RADIUS, sink * np.sin(lean))
    return Maypole(lean, spin, float(load), float(across / load), float(sink), float(turn))


def orbit() -> list[Result]:
    """Case 8: one period, seen from a frame that sinks along, its origin half-way down the risers.

    So coordinates stay small, and with them rounding; steps of 1 ms do the same for truncation.
    """
    starts, models, air = [], [], []
    for s, stiffer in MEMBERS:
        m = maypole(s)
        out = leaning(m.lean, (0.0, np.pi))
        turning = m.spin * np.sin(m.lean) * np.array([[0.0, 0.0], [1.0, -1.0], [0.0, 0.0]])
        starts.append(begin(s, out, turning, (0.0, 0.0, 0.0), -s.length / 2.0))
        polar = (-m.normal * np.sin(m.turn), m.normal * np.cos(m.turn))
        models.append(s.cluster((s.C_A,), polar, s.capsule_mass * s.gravity / (2.0 * np.cos(m.lean)), stiffer))
        air.append(Weather(s.density, down=-m.sink))
    flown = fly(forces.constant_polar, starts, models, air, int(PERIOD * 40), 0.025)
    off = []
    for b, (s, _) in enumerate(MEMBERS):
        time, state = flown.member(b)
        phase = maypole(s).spin * time
        circle = np.stack([RADIUS * np.cos(phase), RADIUS * np.sin(phase), np.full_like(phase, -s.length / 2.0)])
        places = np.asarray(state.canopy_position.stack())  # (3, canopy, T)
        off.append(places - np.stack([circle, circle * np.array([[-1.0], [-1.0], [1.0]])], axis=1))
    bounds = [1e-11 if stiffer == 1.0 else 2e-10 for _, stiffer in MEMBERS]
    name = "canopy positions over one period"
    lines = [single("8", b, name, "circle", "ft", off[b], bounds[b]) for b in range(len(off))]
    return [*lines, unturned("8", flown)]
