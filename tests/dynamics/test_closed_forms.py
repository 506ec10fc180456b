"""Check cases 1, 4, 6a, 6b, 7, 8 and 9a of CHECKCASES, flown by the simulator against closed forms.

Cases with a prescribed aerodynamic force are flown in a uniform updraft of 1e8 m/s and a density to match: relative to it
nothing that the bodies do changes dynamic pressure or wind direction, so forces depend on the geometry alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ellipj, ellipk
from tests.twins import small_cluster as small

from bayeschute.core.units import to_si
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.parameters import Canopies, Risers

FT, SLUG, LBF = to_si("1 ft", "m"), to_si("1 slug", "kg"), to_si("1 lbf", "N")
G = 32.174 * FT
UPDRAFT = 1e8
TIME = np.arange(small.SAMPLES) * small.DT
C_A = 0.927


class Set:
    """One parameter set of CHECKCASES, in SI; two canopies that carry half of everything each."""

    def __init__(self, name):
        m_L, L, S, m_c = {"T71": (21906 / 32.174, 235.0, 10563.0, 307.0), "T61": (648.44, 234.0, 10568.3, 307.0)}[name]
        self.m_L, self.L, self.S, self.m_c = m_L * SLUG, L * FT, S * FT**2, m_c * SLUG
        self.m_d = (328.0 / 32.174 if name == "T71" else 10.22) * SLUG
        self.rho = (self.m_c - self.m_d) / (140164.0 * FT**3)
        self.W = (self.m_L + 2 * self.m_d) * G
        self.M = self.m_L + 2 * self.m_c
        self.l = 116.0 * FT
        self.w0 = np.sqrt((G - self.m_d * G / self.m_c) / self.L)

    def cluster(self, axial, transverse, rho, tension, stiffer=1.0):
        k = 15000.0 * LBF / FT * stiffer
        zero = Vec3(0.0, 0.0, 0.0)
        capsule = replace(
            small.CAPSULE, mass=self.m_L, attach_b=zero, axial_force=0.0, normal_force_slope=0.0, moment_slope=0.0,
            roll_damping=0.0, pitch_damping=0.0, reference_centre_b=zero,
        )  # fmt: skip
        canopies = Canopies(self.S, self.l, 32.0 * FT, self.m_d, (self.m_c - self.m_d) / rho)
        risers = Risers(self.L - tension / k, k, 10000.0 * LBF * stiffer / FT, 0.25 * tension / k)
        model = small.cluster(axial, transverse, capsule=capsule, canopies=canopies, risers=risers)
        return replace(model, gravity=G)


def centre_velocity(s, x):
    return (s.m_L * x[:, 3:6] + s.m_c * x[:, 19:25].reshape(-1, 3, 2).sum(axis=2)) / s.M


def riser_angle(x, i=0):
    line = x[:, 13:19].reshape(-1, 3, 2)[:, :, i] - x[:, 0:3]
    return np.arctan2(line[:, 0], -line[:, 2])


def coincident(theta, turning=0.0, **more):
    d = np.array([[np.sin(theta), 0.0, -np.cos(theta)]] * 2).T
    t = turning * np.array([[np.cos(theta), 0.0, np.sin(theta)]] * 2).T
    return small.start(d, t, **more)


@pytest.mark.parametrize("name", ["T71", "T61"])
def test_case_1_constant_density(name):
    s = Set(name)
    V_t = np.sqrt(s.W / (s.rho * s.S * C_A))
    tau = V_t / (s.W / s.M)
    want = V_t / np.tanh(TIME / tau + np.arctanh(1 / 1.5))
    # Initial tension: the capsule's share of the deceleration.
    a = s.W / s.M * (1 - 1.5**2)
    error = []
    for stiffer in (1.0, 10.0):
        model = s.cluster((C_A, 0.0), (0.0,) * 5, s.rho, s.m_L * (G - a) / 2, stiffer)
        x = small.fly(small.flight(model, coincident(0.0, velocity=(0, 0, 1.5 * V_t)), density=s.rho))
        difference = centre_velocity(s, x) - want[:, None] * [0, 0, 1]
        error.append(np.abs(difference).max() / FT)
        assert np.abs(difference[-1]).max() / FT < 1e-4
        np.testing.assert_array_equal(x[:, 6:13], np.tile(x[0, 6:13], (len(x), 1)))
    assert error[0] < 0.105
    assert error[0] / error[1] == pytest.approx(10.0, abs=0.3)
    if name == "T71":
        assert error[0] == pytest.approx(0.096, abs=0.001)


def test_case_1_from_terminal_speed_nothing_changes():
    s = Set("T71")
    V_t = np.sqrt(s.W / (s.rho * s.S * C_A))
    model = s.cluster((C_A, 0.0), (0.0,) * 5, s.rho, s.m_L * G / 2)
    x = small.fly(small.flight(model, coincident(0.0, velocity=(0, 0, V_t)), density=s.rho))
    np.testing.assert_allclose(x[:, 3:6], np.tile([0, 0, V_t], (len(x), 1)), atol=2e-7)


@pytest.mark.parametrize("name", ["T71", "T61"])
def test_case_4_steady_glide(name):
    s = Set(name)
    C_A0, C_Aalpha, a0, C_Nalpha = 0.927, -0.329, 0.189, 0.1901
    V = np.sqrt(s.W / (s.rho * s.S * C_A0))
    glide = np.array([V * np.sin(a0), 0.0, V * np.cos(a0)])
    axial = (C_A0 - 0.5 * C_Aalpha * a0, 0.5 * C_Aalpha / a0)
    transverse = (0.0, -0.5 * C_Nalpha, 0.5 * C_Nalpha / a0**2, 0.0, 0.0)
    model = s.cluster(axial, transverse, s.rho, s.m_L * G / 2)
    x = small.fly(small.flight(model, coincident(0.0, velocity=glide), density=s.rho))
    if name == "T71":
        np.testing.assert_allclose(glide[[0, 2]] / FT, [6.19742, 32.3992], rtol=1e-5)
    np.testing.assert_allclose(x[:, 3:6], np.tile(glide, (len(x), 1)), atol=1e-6)
    assert np.abs(riser_angle(x)).max() < 1e-7


def updraft(s, start, transverse, tension, stiffer=1.0, qS=None):
    """Flight with axial force qS C_A per canopy, the pair's weight unless told."""
    rho = 2 * (s.W / (2 * C_A) if qS is None else qS) / (s.S * UPDRAFT**2)
    model = s.cluster((C_A, 0.0), transverse, rho, tension, stiffer)
    return small.fly(small.flight(model, start, wind=(0, 0, -UPDRAFT), density=rho))


def taut(s, theta, rate):
    """Closed-form tension per riser with an axial force W on the pair (6.3.1-5 along the riser, rigid length)."""
    m_C, W_C = 2 * s.m_c, 2 * s.m_d * G
    # Along n: m_C a_C = W - T - W_C cos, m_L a_L = T - W_L cos, a_C - a_L = -L rate^2.
    inverse = 1 / m_C + 1 / s.m_L
    return ((s.W - W_C * np.cos(theta)) / m_C + G * np.cos(theta) + s.L * rate**2) / inverse / 2


@pytest.mark.parametrize("name", ["T71", "T61"])
def test_case_6a_large_pendulum(name):
    s, theta = Set(name), np.deg2rad(24.0)
    k = np.sin(theta / 2)
    want = 2 * np.arcsin(k * ellipj(ellipk(k**2) - s.w0 * TIME, k**2)[0])
    if name == "T71":
        assert 4 * ellipk(k**2) / s.w0 == pytest.approx(17.4614, abs=1e-4)
    error = [
        np.rad2deg(np.abs(riser_angle(updraft(s, coincident(theta), (0.0,) * 5, taut(s, theta, 0.0), f)) - want).max())
        for f in (1.0, 10.0)
    ]
    assert error[0] < 0.1
    assert error[0] / error[1] == pytest.approx(10.0, abs=0.3)


@pytest.mark.parametrize("C_Nadot, bound", [(0.0, 5e-4), (0.5, 3e-4), (-0.3, 1e-2)])
def test_cases_6b_and_7_damped_pendulum(C_Nadot, bound):
    s, theta, C_Na = Set("T71"), np.deg2rad(1.0), 0.1901
    w = np.sqrt(s.w0**2 + s.W * C_Na / C_A / (2 * s.m_c * s.L))
    b = s.W * C_Nadot / (2 * 2 * s.m_c * s.L * C_A)
    if C_Nadot == 0.5:
        assert b == pytest.approx(0.0421698, rel=1e-5)
    w_d = np.sqrt(w**2 - b**2)
    want = theta * np.exp(-b * TIME) * (np.cos(w_d * TIME) + b / w_d * np.sin(w_d * TIME))
    transverse = (0.0, C_Na, 0.0, C_Nadot * 2 * UPDRAFT / s.l, 0.0)
    x = updraft(s, coincident(theta), transverse, taut(s, theta, 0.0))
    assert np.abs(riser_angle(x) - want).max() / theta < bound


def test_case_8_maypole():
    s, R, omega = Set("T71"), 50.0 * FT, 2 * np.pi / 35.0
    phi = np.arcsin(R / s.L)
    F_n = s.m_c * R * omega**2 * np.cos(phi) + s.m_d * G * np.sin(phi)
    qS = (s.W / 2 - F_n * np.sin(phi)) / (C_A * np.cos(phi))
    C_N = F_n / qS
    assert (qS / LBF, C_N) == (pytest.approx(12324.6, rel=1e-5), pytest.approx(0.0448817, rel=1e-5))
    d = np.array([[np.sin(phi), 0, -np.cos(phi)], [-np.sin(phi), 0, -np.cos(phi)]]).T
    turning = omega * np.sin(phi) * np.array([[0, 1, 0], [0, -1, 0]]).T
    begin = small.start(d, turning, velocity=(0.0, 0.0, 0.0))
    x = updraft(s, begin, (C_N / np.sin(phi), 0, 0, 0, 0), s.m_L * G / 2 / np.cos(phi), qS=qS)
    apart = x[:, 13:19].reshape(-1, 3, 2) - x[:, 0:3, None]
    turn = omega * TIME
    want = np.stack([R * np.cos(turn), R * np.sin(turn), np.full_like(turn, -s.L * np.cos(phi))], axis=1)
    np.testing.assert_allclose(apart[:, :, 0], want, atol=2e-5)
    np.testing.assert_allclose(apart[:, :, 1], want * [-1, -1, 1], atol=2e-5)


def test_case_9a_conical_pendulum():
    s, theta = Set("T71"), np.deg2rad(15.0)
    spin = np.sqrt(s.w0**2 / np.cos(theta))
    assert 2 * np.pi / spin == pytest.approx(16.9733, abs=1e-4)
    d = np.array([[np.sin(theta), 0, -np.cos(theta)]] * 2).T
    begin = small.start(d, spin * np.sin(theta) * np.array([[0.0, 1.0, 0.0]] * 2).T)
    x = updraft(s, begin, (0.0,) * 5, taut(s, theta, spin * np.sin(theta)))
    line = x[:, 13:19].reshape(-1, 3, 2)[:, :, 0] - x[:, 0:3]
    lean = np.arctan2(np.hypot(line[:, 0], line[:, 1]), -line[:, 2])
    np.testing.assert_allclose(lean, theta, atol=1e-7)
    np.testing.assert_allclose(np.unwrap(np.arctan2(line[:, 1], line[:, 0])), spin * TIME, atol=1e-6)
