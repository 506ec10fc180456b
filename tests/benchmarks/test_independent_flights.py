"""Flights of a simulator of its own: laws of its motion, and files that the reader of other sets understands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import independent_flights as module
import numpy as np
import pytest
from independent_flights import (
    GRAVITY,
    SMALL,
    TWO_MAINS,
    Air,
    AsFlown,
    Flights,
    density,
    drift,
    make_set,
    table,
)
from other_records import flights_of, read_flight

STILL = {"gusts": (0.0, ((1.0, 1.0),)), "breathing": (0.0, 0.2), "wind": (0.0, 0.0)}


def as_drawn(vehicle):
    n = vehicle.canopies
    return AsFlown(vehicle, np.full(n, vehicle.riser[0]), np.ones(n), 1.0, np.array(vehicle.attach), vehicle.tensor())


def calm_air(vehicle):
    altitude = np.array([vehicle.ground - 60.0, vehicle.start + 200.0])
    return Air(altitude, np.zeros((2, 2)), np.zeros((2, 2)))


def test_a_calm_descent_comes_to_its_terminal_speed():
    """Weight is balanced by drag of canopy and capsule; the falling density makes the rest of a few per mille."""
    one = replace(SMALL, **STILL, axial=table((0.0, 0.5, 1.6), (0.8, 0.8, 0.8)), attach=(0.11, 0.0, 0.0))
    one = replace(one, inertia=(0.11, 0.15, 0.14, 0.0, 0.0, 0.0), start=400.0, wake=(0.0, 0.4, 0.5))
    one = replace(one, normal=table((0.0, 0.5, 1.6), (0.0, 0.3, 0.6)))  # restores: else it would glide
    flights = Flights(as_drawn(one), calm_air(one), one.mass, 1, np.random.default_rng(1))
    history = flights.fly(flights.start(0.0, 0.0), 14.0)
    x = history.states[-1, 0]
    areas = 0.8 * one.area[0] + one.capsule[0] * one.capsule[1]
    fall = np.sqrt(2.0 * GRAVITY * (one.mass + one.area[3]) / (density(-x[2]) * areas))
    assert x[5] == pytest.approx(fall, rel=4e-3)
    assert np.abs(x[3:5]).max() < 1e-3 and history.truth(0)["swing_angle_deg"][-1] < 0.05
    np.testing.assert_allclose(history.tension[-1, 0] / one.mass / GRAVITY, 0.98, atol=0.03)


def test_risers_act_on_both_ends_alike():
    """Momentum: what speeds capsule and canopies up is weight and air alone, whatever the risers pull."""
    flights = [
        Flights(as_drawn(replace(TWO_MAINS, **STILL, riser=(71.3, k, 0.0))), calm_air(TWO_MAINS), 9400.0, 1, None)
        for k in (1e5, 3e5)
    ]
    x = flights[0].start(0.2, 0.5)[None]
    still = np.zeros((1, 3, 3)), np.zeros((1, 2))
    made = [one.rate(x, *still) for one in flights]
    assert made[1][2].min() > 2.0 * made[0][2].min() > 0.0
    dry, volume = TWO_MAINS.area[3], TWO_MAINS.area[2]
    axis = x[0, 25:31].reshape(2, 3)
    carried = volume * density(-x[0, 13:19].reshape(2, 3)[:, 2])

    def gained(rate):
        speeding = rate[0, 19:25].reshape(2, 3)
        along = (speeding * axis).sum(-1, keepdims=True) * axis
        heavy = (dry + 1.1 * carried)[:, None] * along + (dry + 0.6 * carried)[:, None] * (speeding - along)
        return 9400.0 * rate[0, 3:6] + heavy.sum(axis=0)

    np.testing.assert_allclose(gained(made[1][0]), gained(made[0][0]), rtol=1e-9, atol=1e-6 * made[1][2].max())


def test_drifts_have_unit_variance_and_their_memory():
    x = drift(np.random.default_rng(3), 4000, 0.1, 1.0, (50,))
    assert x.var() == pytest.approx(1.0, abs=0.05)
    assert (x[:-10] * x[10:]).mean() == pytest.approx(np.exp(-1.0), abs=0.05)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("set")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "SETTLING", 5.0)
        make_set(folder, replace(TWO_MAINS, start=TWO_MAINS.ground + 120.0), 5, replicates=2)
    return folder


def test_a_set_is_read_as_set_p_is(made: Path):
    assert flights_of(made, "P") == ["P_1", "P_2"]
    flight = read_flight(made, "P_2")
    truth = np.load(made / "truth" / "P_2_00.npz")
    assert flight.canopies.shape[1:] == (2, 3) and flight.tension.shape[1] == 2
    seen = flight.quantities()
    apart = np.abs(seen["swing_angle"] - truth["swing_angle_deg"])
    assert np.nanmedian(apart) < 1.0
    np.testing.assert_allclose(seen["sea_level_descent_rate"], truth["sea_level_descent_rate_mps"], atol=0.3)
    lift = flight.force[:, 0]
    assert np.nanmean(lift) == pytest.approx(GRAVITY, rel=0.05)
    risers = np.linalg.norm(flight.risers(), axis=-1)
    assert abs(np.nanmedian(risers) - TWO_MAINS.riser[0]) < 2.0
    assert 0.5 < np.load(made / "truth" / "P_2_01.npz")["flyout_angle_deg"].mean() < 25.0


def test_replicates_begin_alike_and_part(made: Path):
    first, second = (np.load(made / "truth" / f"P_2_{k:02d}.npz")["swing_angle_deg"] for k in (0, 1))
    assert first[0] == second[0] and abs(first[60] - second[60]) > 1e-3


def test_a_seed_makes_one_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "SETTLING", 1.0)
    short = replace(SMALL, start=SMALL.ground + 35.0)
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        make_set(tmp_path / name, short, seed, replicates=1)
    a, b, c = (read_flight(tmp_path / name, "P_1") for name in "abc")
    np.testing.assert_array_equal(a.position, b.position)
    assert min(len(a.position), len(c.position)) >= 50
    assert not np.array_equal(a.position[:50], c.position[:50])
