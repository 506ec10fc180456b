"""Steps per sample: enough keep Runge-Kutta stable, one fewer diverges where the pole says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.step_size import REAL_LIMIT, fastest_pole, substeps

ONE = Structure(("1",), ("e",), 1, "riser")
# One step per sample, so that the sample interval is the step.
FLIGHT = small.flight(
    small.cluster((1.8,), (0.2,), capsule=replace(small.CAPSULE, attach_b=Vec3(0.0, 0.0, 0.0))),
    small.start([[0.02], [0.0], [-1.0]]),
    ONE,
    samples=401,
    dt=0.02,
    substeps=1,
)


@pytest.fixture(scope="module")
def pole():
    return fastest_pole(FLIGHT, np.zeros(0), 13)


def test_the_fastest_pole_is_the_axial_one_of_a_damped_riser(pole):
    """The faster root of s^2 + c u s + k u = 0, u = 1/m_capsule + 1/m_canopy, and drag's share (PHYSICS 2)."""
    m = 149.1 + 1.1 * 3969.0
    u = 1 / 9463.0 + 1 / m
    drag = 1.1 * 981.8 * 1.8 * 10.0 / m
    assert pole == pytest.approx(-np.roots([1.0, 1.46e5 * u, 2.19e5 * u]).min() + drag / (m * u), rel=0.01)


@pytest.mark.parametrize("sample", [0.1, 0.2])
def test_enough_steps_are_stable_and_one_fewer_diverges(pole, sample):
    needed = int(np.ceil(pole * sample / REAL_LIMIT))
    assert substeps(pole, sample, least=1) >= needed
    jump = []
    for count in (needed, needed - 1):
        x = small.fly(replace(FLIGHT, dt=sample / count))
        line = np.linalg.norm(x[:, 13:16] - x[:, 0:3], axis=1)
        jump.append(np.abs(np.diff(line[:60], 2)).max())
    # Past the limit the growing transient hits the clamp of the tension, so it stays finite.
    assert jump[0] < 1e-3
    assert jump[1] > 1e-2


def test_substeps_keep_a_margin_and_a_least():
    assert substeps(1.0, 0.1) == 3
    assert substeps(1.0, 0.1, least=5) == 5
    for pole in (10.0, 61.0, 610.0, 980.0):
        assert pole * 0.1 / substeps(pole, 0.1, least=1) <= 0.85 * REAL_LIMIT
