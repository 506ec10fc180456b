"""Check case 10: two canopies swing apart and together while they may orbit (report 6.3.2-1, sign corrected)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from bayeschute.verification.case_results import SLACK, Result, elastic, unturned
from bayeschute.verification.flying import MEMBERS, Weather, begin, fly, leaning
from bayeschute.verification.glide import riser_lean
from bayeschute.verification.prescribed import spring
from bayeschute.verification.sets import DEGREE, Array, ParameterSet

SLOPE, TRIM = 1.25, 0.15  # C_N = SLOPE (theta - TRIM), [1/rad] and [rad]
AWAY = 4.0 * DEGREE  # the flight begins this far from equilibrium


class Flyout(NamedTuple):
    """Two canopies that lean symmetrically to opposite sides, on rigid risers.

    Attributes:
        set: The parameter set.
        momentum: p = sin^2(theta) phi', constant [rad/s].
        lean: theta_s of the relative equilibrium [rad].
        load: Dynamic pressure times area of one canopy, held [N].
    """

    set: ParameterSet
    momentum: float
    lean: float
    load: float

    def rates(self, theta: float, theta_rate: float) -> tuple[float, float]:
        """Acceleration of the capsule downwards [m/s^2] and theta'' [rad/s^2]."""
        s = self.set
        sin, cos = np.sin(theta), np.cos(theta)
        m, L, D = s.canopy_mass, s.length, s.capsule_mass + 2.0 * s.canopy_mass
        C_N = SLOPE * (theta - TRIM)
        turning = m * L**2 * sin * cos * self.momentum**2 / sin**4
        matrix = [[D, 2.0 * m * L * sin], [m * L * sin, m * L**2]]
        down = s.weight - 2.0 * self.load * (s.C_A * cos + C_N * sin) - 2.0 * m * L * cos * theta_rate**2
        return tuple(np.linalg.solve(matrix, [down, L * (s.dry_weight * sin - self.load * C_N) + turning]))


def flyout(s: ParameterSet, spin: float) -> Flyout:
    """The relative equilibrium at a rate of turn [rad/s]: forces across the riser, and weight, in balance."""

    def residual(y: Array) -> list[float]:
        theta, load = y[0], y[1] * s.load
        sin, cos, C_N = np.sin(theta), np.cos(theta), SLOPE * (theta - TRIM)
        across = s.dry_weight * sin - load * C_N + s.canopy_mass * s.length * spin**2 * sin * cos
        return [across / s.load, (s.weight - 2.0 * load * (s.C_A * cos + C_N * sin)) / s.weight]

    theta, load = root(residual, [0.16, 1.0], tol=1e-15).x
    return Flyout(s, float(np.sin(theta) ** 2 * spin), float(theta), float(load * s.load))


def reduced(f: Flyout, time: Array, lean: float) -> Array:
    """Theta [rad], sink rate of the capsule [m/s] and azimuth [rad] from rest at a lean, (3, T)."""

    def rate(_: float, y: Array) -> list[float]:
        sink_rate, theta_rate_rate = f.rates(y[0], y[1])
        return [y[1], theta_rate_rate, sink_rate, f.momentum / np.sin(y[0]) ** 2]

    first = [lean, 0.0, 0.0, 0.0]
    y = solve_ivp(rate, (time[0], time[-1]), first, "DOP853", time, rtol=1e-12, atol=1e-12).y
    return np.asarray(y[[0, 2, 3]])


def initial_tension(f: Flyout, lean: float) -> float:
    """Of each rigid riser, from rest at a lean [N]: what the capsule's acceleration leaves of its weight."""
    sink_rate, _ = f.rates(lean, 0.0)
    return float(f.set.capsule_mass * (f.set.gravity - sink_rate) / (2.0 * np.cos(lean)))


def _flown(case: str, spin: float) -> list[Result]:
    starts, models, modes = [], [], []
    for s, stiffer in MEMBERS:
        f = flyout(s, spin)
        lean = f.lean + AWAY
        turning = f.momentum / np.sin(lean) * np.array([[0.0, 0.0], [1.0, -1.0], [0.0, 0.0]])
        starts.append(begin(s, leaning(lean, (0.0, np.pi)), turning, (0.0, 0.0, 0.0)))
        models.append(s.cluster((f.load, s.C_A), (SLOPE, TRIM, 0.0), initial_tension(f, lean), stiffer))
        modes.append(f)
    flown = fly(spring, starts, models, [Weather(s.density) for s, _ in MEMBERS], 450)
    leans, sinks, azimuths = [], [], []
    for b, f in enumerate(modes):
        time, state = flown.member(b)
        want = reduced(f, time, f.lean + AWAY)
        theta, phi = riser_lean(flown, b)
        leans.append(theta - want[0])
        sinks.append(np.asarray(state.velocity.z) - want[1])
        azimuths.append(phi - want[2])
    lines = elastic(case, "lean of the riser", "reduced ODE", "deg", leans, SLACK * 2.6e-4)
    lines += elastic(case, "sink rate of the capsule", "reduced ODE", "ft/s", sinks, SLACK * 1e-3)
    if spin:
        lines += elastic(case, "azimuth of the riser", "reduced ODE", "deg", azimuths, SLACK * 4e-3)
    return [*lines, unturned(case, flown)]


def planar() -> list[Result]:
    """Case 10p: without orbit."""
    return _flown("10p", 0.0)


def orbiting() -> list[Result]:
    """Case 10n: with an orbit of 0.18 rad/s."""
    return _flown("10n", 0.18)
