"""What flights flew: by symbol, over all canopies and flights together, without the farthest samples."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.core.vectors import Vec3
from bayeschute.study.aerodynamics.flown import FlownFlight, flown, ranges


def flight(alpha, rate, speed, *distances):
    """Canopies (canopy, T) with a total angle of attack, a transverse rate (3, ...), V/V_o and distances to others."""
    near = tuple(SimpleNamespace(distance=np.asarray(d)) for d in distances)
    flow = SimpleNamespace(
        alpha_squared=np.square(alpha), rate=Vec3(*rate), speed_ratio=np.asarray(speed) - 1.0, neighbours=near
    )
    return FlownFlight("a", SimpleNamespace(flow=flow), (), ())


def test_ranges_are_central_and_of_all_canopies_of_all_flights():
    at = np.linspace(0.0, 1.0, 1001).reshape(1, -1)
    still = np.zeros_like(at)
    first = flight(-0.2 * at, (3.0 * at, still, -4.0 * at), 1.0 + 0.1 * at, 1.0 + at)
    second = flight(0.2 + 0.2 * at, (still, 5.0 * at, still), 0.9 + 0.1 * at, 2.0 + at, 3.0 + at)
    found = ranges([first, second])
    assert found["alpha"] == pytest.approx((0.002, 0.398), abs=1e-3)  # lengths: never below zero
    assert found["rate"] == pytest.approx((0.025, 4.975), abs=1e-2)
    assert found["speed"] == pytest.approx((0.901, 1.099), abs=1e-3)
    assert found["D_prox"] == pytest.approx((1.015, 3.985), abs=2e-3)


def test_a_single_canopy_has_no_distances():
    at = np.linspace(0.0, 1.0, 11).reshape(1, -1)
    assert "D_prox" not in ranges([flight(at, (at, at, at), at)])


def test_a_point_mass_has_no_airflow():
    assert flown(SimpleNamespace(study=SimpleNamespace(model="descent"))) == []
