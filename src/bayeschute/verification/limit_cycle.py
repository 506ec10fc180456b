"""Check case 14: the pendulum of Table 7.1-2 and its limit cycle, against the planar dumbbell (report 6.3.1-5..12)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from bayeschute.dynamics import forces
from bayeschute.verification.case_results import Result, all_members, elastic, single, unturned
from bayeschute.verification.flying import MEMBERS, Weather, begin, fly, leaning
from bayeschute.verification.glide import AXIAL, NORMAL, NORMAL_RATE, swing
from bayeschute.verification.sets import FOOT, T71, Array, ParameterSet
from bayeschute.verification.vertical_descent import centre_velocity

LEAN = 0.3  # initial swing angle [rad]
EARLY, SETTLED = 30.0, 150.0  # [s]


class Cycle(NamedTuple):
    """A limit cycle: amplitude of the swing [rad], frequency [Hz], mean sink rate [m/s]."""

    amplitude: float
    frequency: float
    sink: float


INDEPENDENT = Cycle(
    0.380, 0.0698, 33.7 * FOOT
)  # of set T71, by another simulation; the report: 0.4 rad, 0.068-0.070 Hz
ALLOWED = Cycle(0.005, 0.0005, 0.2 * FOOT)


def dumbbell_rate(s: ParameterSet, y: Array) -> list[float]:
    """Rates of swing, its rate, and the centre of mass' velocity, north and down, of a rigid dumbbell.

    The swing is that of the canopies off the vertical to the north; forces as in 6.3.1-8..12.
    """
    lean, lean_rate, north, down = y
    m_C, L, (C_A0, C_Aalpha, alpha_0) = 2.0 * s.canopy_mass, s.length, AXIAL
    along = np.array([-np.sin(lean), np.cos(lean)])  # from the canopies to the capsule, (north, down)
    across = np.array([np.cos(lean), np.sin(lean)])  # the way the canopies go when the lean grows
    velocity = np.array([north, down]) + s.capsule_mass / s.mass * L * lean_rate * across
    u, w = velocity @ along, velocity @ across
    alpha = np.arctan2(w, u)
    C_A = C_A0 + 0.5 * C_Aalpha * alpha_0 * (alpha**2 / alpha_0**2 - 1.0)
    C_N = NORMAL / (2.0 * alpha_0**2) * (alpha**3 - alpha_0**2 * alpha) + NORMAL_RATE * lean_rate
    q_area = s.density * (u**2 + w**2) * s.area  # of both canopies
    force = -q_area * (C_A * along + C_N * across) + np.array([0.0, s.weight])
    moment = (m_C * s.gravity - 2.0 * s.dry_weight) * np.sin(lean) + q_area * C_N
    return [lean_rate, -moment / (m_C * L), *(force / s.mass)]


def dumbbell(s: ParameterSet, time: Array) -> Array:
    """Swing [rad], its rate, and the centre of mass' velocity from rest at `LEAN` and the terminal speed, (4, T)."""
    first = [LEAN, 0.0, 0.0, s.terminal_speed]
    solved = solve_ivp(
        lambda _, y: dumbbell_rate(s, y), (time[0], time[-1]), first, "DOP853", time, rtol=1e-11, atol=1e-11
    )
    return np.asarray(solved.y)


def cycle(time: Array, lean: Array, sink: Array) -> Cycle:
    """The limit cycle of a swing that has settled, from its whole periods; NaN if there is none."""
    rising = np.flatnonzero((lean[:-1] < 0.0) & (lean[1:] >= 0.0))
    if len(rising) < 2:  # it diverged, or came to rest
        return Cycle(np.nan, np.nan, np.nan)
    share = -lean[rising] / (lean[rising + 1] - lean[rising])
    crossings = time[rising] + share * (time[rising + 1] - time[rising])
    whole = slice(rising[0], rising[-1])
    peaks = np.flatnonzero((lean[1:-1] > lean[:-2]) & (lean[1:-1] >= lean[2:])) + 1
    low, top, high = lean[peaks - 1], lean[peaks], lean[peaks + 1]
    heights = top + (high - low) ** 2 / (8.0 * (2.0 * top - low - high))  # of parabolas through three samples
    frequency = (len(crossings) - 1) / (crossings[-1] - crossings[0])
    return Cycle(float(np.mean(heights)), float(frequency), float(np.mean(sink[whole])))


def pendulum_limit_cycle() -> list[Result]:
    """Case 14: a planar swing with the published set grows or decays into its limit cycle."""
    starts, models = [], []
    for s, stiffer in MEMBERS:
        starts.append(begin(s, leaning(LEAN), np.zeros((3, 2)), (0.0, 0.0, s.terminal_speed)))
        tension = s.capsule_mass * s.gravity / 2.0 * np.cos(LEAN)
        models.append(s.cluster(AXIAL, (NORMAL, NORMAL_RATE), tension, stiffer))
    flown = fly(forces.pitch_plane, starts, models, [Weather(s.density) for s, _ in MEMBERS], 3000)
    early: list[Array] = []
    late: list[tuple[Cycle, Cycle]] = []
    for b, (s, _) in enumerate(MEMBERS):
        time, state = flown.member(b)
        lean, sink = swing(flown, b), np.asarray(centre_velocity(s, state).z)
        reference = dumbbell(s, time)
        early.append((lean - reference[0])[time <= EARLY])
        k = time >= SETTLED
        late.append((cycle(time[k], lean[k], sink[k]), cycle(time[k], reference[0, k], reference[3, k])))
    lines = elastic("14", "swing over 30 s", "dumbbell ODE", "deg", early, 0.1)
    words = "of the limit cycle"
    for i, (name, unit, bound) in enumerate(
        (("amplitude", "rad", 3e-4), ("frequency", "Hz", 3e-5), ("mean sink rate", "ft/s", 4e-4))
    ):
        off = [np.asarray(got[i] - want[i]) for got, want in late]
        judge = all_members if name == "mean sink rate" else elastic  # the mean rate hardly feels the elasticity
        lines += judge("14", f"{name} {words}", "dumbbell ODE", unit, off, bound)
        allowed = ALLOWED[i] / FOOT if unit == "ft/s" else ALLOWED[i]
        for b, (s, _) in enumerate(MEMBERS):
            if s is T71:
                difference = late[b][0][i] - INDEPENDENT[i]
                lines.append(single("14", b, f"{name} {words}", "independent run", unit, difference, allowed))
    return [*lines, unturned("14", flown)]
