"""Check cases 6, 7 and 9: pendulums in a plane and out of it, under coincident canopies with a prescribed force."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.special import ellipj, ellipk

from bayeschute.verification.case_results import SLACK, Result, all_members, elastic, unturned
from bayeschute.verification.flying import MEMBERS, Flown, Weather, begin, fly, leaning
from bayeschute.verification.glide import riser_lean, swing
from bayeschute.verification.prescribed import spring
from bayeschute.verification.sets import DEGREE, Array, ParameterSet

SLOPE = 0.1901  # C_Nalpha of Table 7.1-2 [1/rad]


class Pendulum(NamedTuple):
    """A pendulum's initial lean [rad], rate of azimuth [rad/s], C_Nalpha [1/rad] and total C_Nalphadot [s/rad]."""

    lean: float
    spin: float = 0.0
    slope: float = 0.0
    damping: float = 0.0

    def stiffness(self, s: ParameterSet) -> float:
        """Aerodynamic part of theta'' over theta [1/s^2]."""
        return s.weight * self.slope / (s.C_A * 2.0 * s.canopy_mass * s.length)

    def small_rate(self, s: ParameterSet) -> float:
        """Natural frequency of small swings (6.3.1-24) [rad/s]."""
        return float(np.sqrt(s.pendulum_rate**2 + self.stiffness(s)))

    def decay(self, s: ParameterSet) -> float:
        """Decay rate b of small swings (6.3.1-23) [1/s]."""
        return s.weight * self.damping / (4.0 * s.canopy_mass * s.length * s.C_A)

    def pivot(self, s: ParameterSet) -> float:
        """L_L, distance of the pivot point from the capsule (6.3.1-33) [m]."""
        return s.gravity / self.small_rate(s) ** 2


def _at_rest(s: ParameterSet) -> tuple[float, float, float]:
    return 0.0, 0.0, 0.0


def swinging(
    pendulum: Callable[[ParameterSet], Pendulum],
    samples: int = 600,
    dt: float = 0.1,
    velocity: Callable[[ParameterSet], tuple[float, float, float]] = _at_rest,
) -> Flown:
    """Fly the four members as pendulums of a given start; the velocity of the capsule [m/s] changes no angle."""
    starts, models = [], []
    for s, stiffer in MEMBERS:
        p = pendulum(s)
        turning = np.sin(p.lean) * p.spin
        east = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 0.0]])
        starts.append(begin(s, leaning(p.lean), turning * east, velocity(s)))
        tension = s.tension(p.lean, turning, s.weight / 2.0)
        models.append(s.cluster((s.load, s.C_A), (p.slope, 0.0, p.damping), tension, stiffer))
    return fly(spring, starts, models, [Weather(s.density) for s, _ in MEMBERS], samples, dt)


def plane_swing(s: ParameterSet, lean: float, time: Array) -> Array:
    """Swing from rest without aerodynamic stiffness, by Jacobi's functions [rad]."""
    k = np.sin(lean / 2.0)
    return 2.0 * np.arcsin(k * ellipj(ellipk(k**2) - s.pendulum_rate * time, k**2)[0])


def swing_period(s: ParameterSet, pendulum: Pendulum) -> float:
    """Period in a plane at any amplitude, by the energy integral [s]."""
    a, w2, stiff = pendulum.lean, s.pendulum_rate**2, pendulum.stiffness(s)

    def slowness(phase: float) -> float:  # theta = a sin(phase), d(theta)/d(theta')
        theta = a * np.sin(phase)
        half = np.sin((a + theta) / 2.0) * np.sin((a - theta) / 2.0)
        return a * np.cos(phase) / np.sqrt(4.0 * w2 * half + stiff * (a - theta) * (a + theta))

    return 4.0 * quad(slowness, 0.0, np.pi / 2.0, epsabs=1e-13, epsrel=1e-13)[0]


def pendulum_ode(s: ParameterSet, pendulum: Pendulum, time: Array) -> tuple[Array, Array]:
    """Lean and azimuth in a central field (planar without spin), by SciPy at a tight tolerance, both (T,) [rad]."""
    p = np.sin(pendulum.lean) ** 2 * pendulum.spin
    w2, stiff = s.pendulum_rate**2, pendulum.stiffness(s)

    def rate(_: float, y: Array) -> list[float]:
        theta, theta_rate, _ = y
        acceleration, turning = -w2 * np.sin(theta) - stiff * theta, 0.0
        if p != 0.0:
            acceleration += p**2 * np.cos(theta) / np.sin(theta) ** 3
            turning = p / np.sin(theta) ** 2
        return [theta_rate, acceleration, turning]

    y = solve_ivp(rate, (time[0], time[-1]), [pendulum.lean, 0.0, 0.0], "DOP853", time, rtol=1e-12, atol=1e-13).y
    return y[0], y[2]


def _swings(flown: Flown) -> list[Array]:
    return [swing(flown, b) for b in range(len(MEMBERS))]


def free_swing() -> list[Result]:
    """Case 6a: 24 deg in a plane without aerodynamic stiffness."""
    flown = swinging(lambda _: Pendulum(24.0 * DEGREE))
    wants = [plane_swing(s, 24.0 * DEGREE, flown.time[:, b]) for b, (s, _) in enumerate(MEMBERS)]
    off = [got - want for got, want in zip(_swings(flown), wants, strict=True)]
    lines = elastic("6a", "swing angle from 24 deg", "Jacobi's sn", "deg", off, SLACK * 0.100)
    return [*lines, unturned("6a", flown)]


def _off_cosine(flown: Flown, pendulum: Pendulum) -> list[Array]:
    """Swing over its amplitude less that of the linear pendulum (6.3.1-25), for every member."""
    off = []
    for b, (s, _) in enumerate(MEMBERS):
        time, rate, decay = flown.time[:, b], pendulum.small_rate(s), pendulum.decay(s)
        w_d = np.sqrt(rate**2 - decay**2)
        want = np.exp(-decay * time) * (np.cos(w_d * time) + decay / w_d * np.sin(w_d * time))
        off.append(swing(flown, b) / pendulum.lean - want)
    return off


def small_swing() -> list[Result]:
    """Case 6b: 1 deg with aerodynamic stiffness, and the pivot point that hardly moves sideways."""
    pendulum, half = Pendulum(1.0 * DEGREE, slope=SLOPE), Pendulum(0.5 * DEGREE, slope=SLOPE)
    flown = swinging(lambda _: pendulum)
    off, off_half = _off_cosine(flown, pendulum), _off_cosine(swinging(lambda _: half), half)
    lines = all_members("6b", "swing angle over 1 deg", "cosine", "", off, SLACK * 3.7e-4)
    falls = [np.abs(a).max() / np.abs(b).max() - 4.0 for a, b in zip(off, off_half, strict=True)]
    lines += all_members("6b", "ratio to the error at 0.5 deg", "4, as sin does", "", falls, 0.05)
    sideways = []
    for b, (s, _) in enumerate(MEMBERS):
        _, state = flown.member(b)
        share = pendulum.pivot(s) / s.length
        sideways.append(np.asarray(state.velocity.x * (1.0 - share) + state.canopy_velocity.x[0] * share))
    lines += all_members("6b", "lateral speed of the pivot point", "zero", "ft/s", sideways, SLACK * 4e-5)
    return [*lines, unturned("6b", flown)]


def stiff_swing() -> list[Result]:
    """Case 6c: 24 deg with aerodynamic stiffness."""
    pendulum = Pendulum(24.0 * DEGREE, slope=SLOPE)
    flown = swinging(lambda _: pendulum)
    off = [
        got - pendulum_ode(s, pendulum, flown.time[:, b])[0]
        for b, (got, (s, _)) in enumerate(zip(_swings(flown), MEMBERS, strict=True))
    ]
    back = []
    for s, _ in MEMBERS:
        period = np.array([0.0, swing_period(s, pendulum)])
        back.append(pendulum_ode(s, pendulum, period)[0][-1] - pendulum.lean)
    lines = elastic("6c", "swing angle from 24 deg", "ODE, rtol 1e-12", "deg", off, SLACK * 0.132)
    lines += all_members("6c", "the reference after one period", "energy integral", "deg", back, 1e-8)
    return [*lines, unturned("6c", flown)]


def _damped(case: str, damping: float, bound: float) -> list[Result]:
    pendulum = Pendulum(1.0 * DEGREE, slope=SLOPE, damping=damping)
    flown = swinging(lambda _: pendulum)
    words, off = f"swing angle over 1 deg, {damping:+g} s", _off_cosine(flown, pendulum)
    return [*all_members(case, words, "damped cosine", "", off, SLACK * bound), unturned(case, flown)]


def damped_swing() -> list[Result]:
    """Case 7a: 1 deg with aerodynamic stiffness and damping."""
    return _damped("7a", 0.5, 3.2e-5)


def growing_swing() -> list[Result]:
    """Case 7b: likewise with negative damping, a swing that grows 4.6 times."""
    return _damped("7b", -0.3, 1e-2)


def conical() -> list[Result]:
    """Case 9a: a conical pendulum of 15 deg; nothing but truncation and rounding disturbs it.

    So steps are short, and the frame is one in which the centre of mass stays near: it goes round in a circle, first
    up and then down.
    """

    def cone(s: ParameterSet) -> Pendulum:
        return Pendulum(15.0 * DEGREE, s.pendulum_rate / float(np.sqrt(np.cos(15.0 * DEGREE))))

    def velocity(s: ParameterSet) -> tuple[float, float, float]:
        p = cone(s)
        circling = -s.fall * np.sin(p.lean) / p.spin  # of the centre of mass, to the east
        canopies = 2.0 * s.canopy_mass / s.mass * s.length * np.sin(p.lean) * p.spin
        return 0.0, float(circling - canopies), float(-30.0 * s.fall * (1.0 - np.cos(p.lean)))

    flown = swinging(cone, 3000, 0.02, velocity)
    leans, azimuths = [], []
    for b, (s, _) in enumerate(MEMBERS):
        theta, phi = riser_lean(flown, b)
        leans.append(theta - cone(s).lean)
        azimuths.append(phi - cone(s).spin * flown.time[:, b])
    lines = all_members("9a", "lean of the riser", "15 deg", "deg", leans, 1.6e-11)
    lines += all_members("9a", "azimuth of the riser", "steady turn", "deg", azimuths, 1.6e-11)
    return [*lines, unturned("9a", flown)]


def nutation(s: ParameterSet, pendulum: Pendulum, time: Array) -> tuple[Array, float]:
    """Lean (T,) [rad] and period of nutation [s] of a spherical pendulum that starts at its greatest lean."""
    w2, u = s.pendulum_rate**2, np.cos(pendulum.lean)
    p2 = (1.0 - u**2) ** 2 * pendulum.spin**2
    energy = 0.5 * p2 / (1.0 - u**2) - w2 * u
    # u'^2 = -2 w0^2 u^3 - 2 E u^2 + 2 w0^2 u + 2 E - p^2
    u1, u2, u3 = np.sort(np.roots([-2.0 * w2, -2.0 * energy, 2.0 * w2, 2.0 * energy - p2]).real)
    rate, m = s.pendulum_rate * np.sqrt((u3 - u1) / 2.0), (u3 - u2) / (u3 - u1)
    sn = ellipj(rate * time + ellipk(m), m)[0]
    return np.arccos(u3 - (u3 - u2) * sn**2), float(2.0 * ellipk(m) / rate)


def _spherical(case: str, slope: float, bounds: tuple[float, float], jacobi: bool) -> list[Result]:
    def start(s: ParameterSet) -> Pendulum:
        return Pendulum(20.0 * DEGREE, s.pendulum_rate / 2.0, slope)

    flown = swinging(start)
    leans, azimuths = [], []
    for b, (s, _) in enumerate(MEMBERS):
        theta, phi = riser_lean(flown, b)
        want, turned = pendulum_ode(s, start(s), flown.time[:, b])
        leans.append(theta - (nutation(s, start(s), flown.time[:, b])[0] if jacobi else want))
        azimuths.append(phi - turned)
    reference = "Jacobi's sn" if jacobi else "ODE, rtol 1e-12"
    lines = elastic(case, "lean of the riser", reference, "deg", leans, SLACK * bounds[0])
    lines += elastic(case, "azimuth of the riser", "ODE, rtol 1e-12", "deg", azimuths, SLACK * bounds[1])
    return [*lines, unturned(case, flown)]


def spherical() -> list[Result]:
    """Case 9b: a spherical pendulum without aerodynamic stiffness."""
    return _spherical("9b", 0.0, (0.037, 0.26), jacobi=True)


def stiff_spherical() -> list[Result]:
    """Case 9c: a spherical pendulum with aerodynamic stiffness."""
    return _spherical("9c", SLOPE, (0.050, 0.41), jacobi=False)
