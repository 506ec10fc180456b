"""Check cases 1 to 3: vertical descent with drag alone, against closed forms of one variable."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import expi

from bayeschute.core.vectors import Vec3
from bayeschute.dynamics import forces
from bayeschute.dynamics.parameters import Cluster
from bayeschute.dynamics.state import ClusterState
from bayeschute.verification.case_results import SLACK, Result, all_members, elastic, unturned
from bayeschute.verification.flying import MEMBERS, Flown, Weather, begin, fly, leaning
from bayeschute.verification.sets import FOOT, Array, ParameterSet

UP = leaning(0.0)
SCALE_HEIGHT = 30000.0 * FOOT
STEP_WIND, STEP_AT = -10.0 * FOOT, 300.0 * FOOT
RAMP = 1.0 * FOOT
SHEAR = 0.02


def centre_velocity(s: ParameterSet, state: ClusterState) -> Vec3:
    """Velocity of the centre of mass of everything [m/s]."""
    canopies = state.canopy_velocity.map(lambda c: np.asarray(c).sum(axis=0))
    return (state.velocity * s.capsule_mass + canopies * s.canopy_mass) / s.mass


def riccati(time: Array, start: float, fall: float, kappa: float) -> Array:
    """Speed of V' = fall - kappa V^2 from `start`, both above and below the terminal speed."""
    terminal = np.sqrt(fall / kappa)
    share = time * fall / terminal
    if start == terminal:
        return np.full_like(time, terminal)
    if start > terminal:
        return terminal / np.tanh(share + np.arctanh(terminal / start))
    return terminal * np.tanh(share + np.arctanh(start / terminal))


def _calm(s: ParameterSet) -> Weather:
    return Weather(s.density)


def falling(factor: float = 1.0) -> tuple[list[Array], list[Cluster]]:
    """Starts of the four members at so many times the terminal speed; their clusters, risers under its tension."""
    starts, models = [], []
    for s, stiffer in MEMBERS:
        starts.append(begin(s, UP, 0.0 * UP, (0.0, 0.0, factor * s.terminal_speed)))
        models.append(s.cluster((s.C_A,), (), s.tension(0.0, 0.0, s.load * s.C_A * factor**2), stiffer))
    return starts, models


def drop(samples: int, factor: float = 1.0, weather: Callable[[ParameterSet], Weather] = _calm) -> Flown:
    """Fly the four members from so many times the terminal speed."""
    return fly(forces.drag, *falling(factor), [weather(s) for s, _ in MEMBERS], samples)


def _differences(flown: Flown, want: Callable[[ParameterSet, Array, ClusterState], Array]) -> list[Array]:
    """CM descent rate less the reference's, for every member [m/s]."""
    found = []
    for b, (s, _) in enumerate(MEMBERS):
        time, state = flown.member(b)
        found.append(np.asarray(centre_velocity(s, state).z) - want(s, time, state))
    return found


def _ends(differences: Sequence[Array]) -> list[Array]:
    return [d[-1:] for d in differences]


def constant_density() -> list[Result]:
    """Case 1: to the terminal speed from above, from below, and at it."""
    lines = []
    for factor, bound, end in ((1.5, 0.096, 1.2e-8), (0.5, 0.042, 1.2e-8)):

        def want(s: ParameterSet, time: Array, _: ClusterState, factor: float = factor) -> Array:
            return riccati(time, factor * s.terminal_speed, s.fall, s.kappa)

        off = _differences(drop(200, factor), want)
        words = f"CM speed from {factor:g} V_t"
        lines += elastic("1", words, "coth" if factor > 1 else "tanh", "ft/s", off, SLACK * bound)
        lines += all_members("1", f"{words}, at 20 s", "coth" if factor > 1 else "tanh", "ft/s", _ends(off), end)
    flown = drop(200)
    steady = _differences(flown, lambda s, time, _: np.full_like(time, s.terminal_speed))
    lines += all_members("1", "CM speed from V_t", "constant", "ft/s", steady, 1e-11)
    return [*lines, unturned("1", flown)]


def scaled_exponential_integral(s: Array) -> Array:
    """exp(-s) Ei(s) for s > 0, by its asymptotic series where exp(s) would overflow."""
    near = np.minimum(s, 50.0)
    series = sum((float(np.prod(np.arange(1.0, k + 1.0))) / s ** (k + 1) for k in range(25)), np.zeros_like(s))
    return np.where(s > 50.0, series, np.exp(-near) * expi(near))


def exponential_speed(s: ParameterSet, z: Array) -> Array:
    """Descent rate by depth in air whose density grows as exp(z/H), from the terminal speed at z = 0 [m/s]."""
    s0 = 2.0 * s.kappa * SCALE_HEIGHT
    depth = np.asarray(s0 * np.exp(z / SCALE_HEIGHT))
    decay = np.exp(s0 - depth)
    inner = scaled_exponential_integral(depth) - decay * scaled_exponential_integral(np.array([s0]))
    return np.sqrt(s.terminal_speed**2 * decay + 2.0 * s.fall * SCALE_HEIGHT * inner)


def exponential_density() -> list[Result]:
    """Case 2: an exponential atmosphere, mass of the enclosed air held."""
    flown = drop(2500, weather=lambda s: Weather(s.density, SCALE_HEIGHT))
    off = _differences(flown, lambda s, _, state: exponential_speed(s, np.asarray(state.canopy_position.z[0])))
    lines = elastic("2", "CM speed by depth", "exponential integral", "ft/s", off, SLACK * 6.5e-5)
    # At the end the canopies: drag sets their speed; the CM's differs by the rate of stretch of the risers.
    ends = []
    for b, (s, _) in enumerate(MEMBERS):
        _, state = flown.member(b)
        z, v = (np.asarray(c[:, -1]) for c in (state.canopy_position.z, state.canopy_velocity.z))
        ends.append(v - exponential_speed(s, z))
    lines += all_members("2", "canopy speed, at 250 s", "exponential integral", "ft/s", ends, 4e-10)
    return [*lines, unturned("2", flown)]


def step_updraft() -> list[Result]:
    """Case 3a: an updraft that begins at a depth, met at the terminal speed."""
    starts, models = falling()
    calm, wind = [_calm(s) for s, _ in MEMBERS], [Weather(s.density, down=STEP_WIND) for s, _ in MEMBERS]
    # Two legs: a Runge-Kutta step across the edge of the updraft would see it in some of its stages only.
    until = [STEP_AT / s.terminal_speed for s, _ in MEMBERS]
    upper = fly(forces.drag, starts, models, calm, 100, [t / 100 for t in until])
    lower = fly(forces.drag, list(upper.states[-1].T), models, wind, 200)

    def want(s: ParameterSet, time: Array, _: ClusterState) -> Array:
        return riccati(time, s.terminal_speed - STEP_WIND, s.fall, s.kappa) + STEP_WIND

    off = _differences(lower, want)
    edge = [np.asarray(upper.member(b)[1].canopy_position.z[:, -1]) - STEP_AT for b in range(len(MEMBERS))]
    lines = all_members("3a", "depth where the updraft is met", "300 ft", "ft", edge, 1e-9)
    lines += elastic("3a", "CM speed in the updraft", "coth", "ft/s", off, SLACK * 0.048)
    lines += all_members("3a", "CM speed, 20 s after", "coth", "ft/s", _ends(off), 6e-9)
    return [*lines, unturned("3a", lower)]


def ramp_downdraft() -> list[Result]:
    """Case 3b: a downdraft that grows with time."""
    terminal = {s.name: s.terminal_speed for s, _ in MEMBERS}

    def want(s: ParameterSet, time: Array, _: ClusterState) -> Array:
        return riccati(time, terminal[s.name], s.fall - RAMP, s.kappa) + RAMP * time

    flown = drop(300, weather=lambda s: Weather(s.density, down_ramp=RAMP))
    off = _differences(flown, want)
    lines = elastic("3b", "CM speed in the ramp", "Riccati", "ft/s", off, SLACK * 3.8e-3)
    lines += all_members("3b", "CM speed, at 30 s", "Riccati", "ft/s", _ends(off), 1.2e-9)
    return [*lines, unturned("3b", flown)]


def shear_reference(s: ParameterSet, time: Array) -> Array:
    """Descent rate [m/s] of z'' = g' - kappa (z' - a z) |z' - a z| from the terminal speed."""

    def rate(_: float, y: Array) -> list[float]:
        relative = y[1] - SHEAR * y[0]
        return [y[1], s.fall - s.kappa * relative * abs(relative)]

    first = [0.0, s.terminal_speed]
    solution = solve_ivp(rate, (time[0], time[-1]), first, "DOP853", time, rtol=1e-12, atol=1e-12)
    return np.asarray(solution.y[1])


def depth_shear() -> list[Result]:
    """Case 3c: a downdraft that grows with depth."""
    flown = drop(300, weather=lambda s: Weather(s.density, down_shear=SHEAR))
    off = _differences(flown, lambda s, time, _: shear_reference(s, time))
    lines = elastic("3c", "CM speed in the shear", "ODE, rtol 1e-12", "ft/s", off, SLACK * 2.5e-3)
    return [*lines, unturned("3c", flown)]
