"""Flyout, maypole, breathing: numbers of the check cases, inverse formulas, and their differential equations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from tests.twins.cluster_modes import breathing_rate, flyout_period, maypole_turning

from bayeschute.reduced import cluster_mode_laws

# Feet, slugs, pounds and seconds: closed forms don't mind.
G = 32.174
CANOPY = cluster_mode_laws.Canopy(307.0, 328.0, 235.0)
CAPSULE, WEIGHT, C_A = 21906.0 / G, 22562.0, 0.927
LOAD = WEIGHT / (2 * C_A)
RHO, S = 0.00211756, 10563.0


def test_flyout_of_the_report():
    """7.2.1: 15 s; the report says 1.2 per radian, its own formula 1.07."""
    assert cluster_mode_laws.flyout_slope(CANOPY, LOAD, 15.0) == pytest.approx(1.07, abs=0.01)
    angle = brentq(_unbalanced, 0.1, 0.3)
    assert angle == pytest.approx(0.153255, abs=1e-6)  # CHECKCASES 10p
    assert flyout_period(CANOPY, _load(angle), 1.25) == pytest.approx(13.755, abs=1e-3)


def _load(angle):
    """Load q S of one of two canopies that carry the weight at a flyout angle (6.3.2-25)."""
    return WEIGHT / (2.0 * (C_A * np.cos(angle) + 1.25 * (angle - 0.15) * np.sin(angle)))


def _unbalanced(angle):
    return CANOPY.weight * np.sin(angle) - _load(angle) * 1.25 * (angle - 0.15)


def test_maypole_of_the_report():
    turning = 2 * np.pi / 35.0
    load = cluster_mode_laws.maypole_q_area(CANOPY, C_A, 50.0, turning, WEIGHT)
    assert load == pytest.approx(12324.6, abs=0.1)  # CHECKCASES 8
    assert cluster_mode_laws.maypole_normal(CANOPY, load, 50.0, turning) == pytest.approx(0.0448817, abs=1e-7)
    at_32 = 0.5 * RHO * 32.0**2 * S
    assert cluster_mode_laws.maypole_normal(CANOPY, at_32, 50.0, turning) == pytest.approx(0.0483, abs=1e-4)


def test_maypole_forces_balance():
    """Newton's law of one canopy in the rotating plane: line force, aerodynamics, weight, centripetal acceleration."""
    turning, radius = 0.17, 60.0
    load = cluster_mode_laws.maypole_q_area(CANOPY, C_A, radius, turning, WEIGHT)
    normal = load * cluster_mode_laws.maypole_normal(CANOPY, load, radius, turning)
    phi = np.arcsin(radius / CANOPY.length)
    outward, down = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    along = -np.sin(phi) * outward + np.cos(phi) * down  # from the canopy to the capsule
    inward = -np.cos(phi) * outward - np.sin(phi) * down
    pull = (WEIGHT / 2 - CANOPY.weight) / np.cos(phi)  # half of the capsule's weight hangs on each line
    total = (pull - load * C_A) * along + normal * inward + CANOPY.weight * down
    np.testing.assert_allclose(total, -CANOPY.mass * radius * turning**2 * outward, atol=1e-8 * WEIGHT)


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("value", [0.4, 1.07, 2.0])
def test_inverse_formulas_of_rigid_modes(value, count):
    for cosine in (1.0, 0.98):
        period = flyout_period(CANOPY, LOAD, value, cosine)
        assert cluster_mode_laws.flyout_slope(CANOPY, LOAD, period, cosine) == pytest.approx(value)
    radius, turning, weight = 50.0 * value, 0.15, WEIGHT * count / 2
    load = cluster_mode_laws.maypole_q_area(CANOPY, C_A, radius, turning, weight, count)
    normal = cluster_mode_laws.maypole_normal(CANOPY, load, radius, turning)
    assert maypole_turning(CANOPY, load, radius, normal) == pytest.approx(turning)


CLUSTER = cluster_mode_laws.Breathing(CAPSULE + 2 * 307.0, WEIGHT, 34.0, C_A)


def breathe(slope, frequency, amplitude, cluster=CLUSTER):
    stiffness = (2.0 * np.pi * frequency) ** 2
    time = np.arange(800) * 0.01 / frequency
    solved = solve_ivp(
        lambda t, x: breathing_rate(x, cluster, stiffness, 0.0, slope),
        (0, time[-1]), [amplitude, 0.0, cluster.speed], t_eval=time, rtol=1e-8, atol=1e-8,
    )  # fmt: skip
    last = np.arange(800) >= 500  # whole cycles, when the start is forgotten
    return time[last], solved.y[:, last]


def test_breathing_moves_the_descent_rate_as_linearised():
    frequency, small = 0.23, 0.02
    slope = cluster_mode_laws.breathing_axial_slope(CLUSTER, 1.6, frequency)
    _, (_, _, w) = breathe(slope, frequency, small)
    assert np.ptp(w) / 2 == pytest.approx(1.6 * small, rel=2e-3)


def test_breathing_of_the_report():
    """7.2.3: 0.23 Hz, from 32 to 35.2 ft/s about "approximately 34", the canopy's size ahead of the least speed."""
    cluster = CLUSTER._replace(speed=33.5)
    slope = cluster_mode_laws.breathing_axial_slope(cluster, 1.6, 0.23)
    _, (_, _, w) = breathe(slope, 0.23, 1.0, cluster)
    assert (w.min(), w.max()) == (pytest.approx(32.0, abs=0.1), pytest.approx(35.2, abs=0.1))
