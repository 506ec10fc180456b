"""Laws of one body's motion: kept to the last digit by motions in closed form, broken by a size that is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.records.plausibility import motion_laws
from bayeschute.records.plausibility.evidence import Evidence, Nominal, conjugate, turned
from bayeschute.records.plausibility.motion_laws import earth_force, over_lag

G = 9.80665
T = 0.1 * np.arange(1200)
RATE = np.array([0.02, -0.05, 0.3])
CANOPIES = np.array([[30.0, 10.0, -60.0], [-25.0, -5.0, -62.0]])


def moving(growth=0.05, wind=(6.0, -3.0)):
    """Accelerated evenly, turning steadily: windows of displacements and velocities agree exactly."""
    start, rise = np.array([*wind, 9.0]), growth * np.array([1.0, -0.5, 0.02])
    velocity = start + rise * T[:, None]
    position = start * T[:, None] + 0.5 * rise * T[:, None] ** 2
    size = np.linalg.norm(RATE)
    half = 0.5 * size * T[:, None]
    attitude = np.hstack([np.cos(half), np.sin(half) * RATE / size])
    force = turned(conjugate(attitude), np.broadcast_to(rise - [0.0, 0.0, G], (T.size, 3)))
    each = 4.0 * np.sin(0.2 * T[:, None, None] + np.arange(2)[:, None])
    own = np.concatenate([each, -0.5 * each, 0.0 * each], axis=2)
    return Evidence(
        time=T,
        position=position,
        velocity=velocity,
        attitude=attitude,
        rate=np.tile(RATE, (T.size, 1)),
        force=force,
        canopies=position[:, None] + CANOPIES + own,
        canopy_velocity=velocity[:, None] + _rate_of(own),
        altitude=500.0 - position[:, 2],
        descent_rate=velocity[:, 2],
    )


def _rate_of(own):
    return np.gradient(own, T, axis=0)


GOOD = moving()


def read(law, e=GOOD):
    return {r.law: r for r in getattr(motion_laws, law)(e)}


def excesses(e=GOOD):
    return {r.law: r.excess for law in motion_laws.LAWS for r in law(e)}


def test_a_motion_in_closed_form_keeps_all_laws():
    found = excesses()
    exact = {"velocity.horizontal", "velocity.down", "altitude.rate", "altitude.descent_rate", "attitude.norm",
             "attitude.rate.x", "attitude.rate.y", "attitude.rate.z", "force.down", "clock"}  # fmt: skip
    for law in exact:
        assert found[law] < 1e-6, law
    assert max(v for k, v in found.items() if k not in ("altitude.datum", "hanging.canopies")) < 0.5
    assert found["altitude.datum"] == 0.99  # 500 m apart: never more than looked at
    assert len(found) > 18


@pytest.mark.parametrize("step", [1e-4, 0.1, 100.0])
def test_two_decades_from_a_tenth_of_a_second_are_the_limit(step):
    reading = read("clock", Evidence(time=step * np.arange(100)))["clock"]
    assert reading.excess == pytest.approx(abs(np.log10(step / 0.1)) / 2.0)


@pytest.mark.parametrize("factor", [-1.0, 0.3048, 3.6])
def test_a_velocity_in_another_unit_is_that_much_apart(factor):
    still = moving(growth=0.0)
    found = read("velocity", replace(still, velocity=factor * still.velocity))
    for name, size in (("horizontal", np.sqrt((36.0 + 9.0) / 2.0)), ("down", 9.0)):
        if name == "horizontal":
            kept = np.r_[np.full(1180, 6.0), np.full(1180, 3.0)]
            kept = np.sort(kept)[: int(0.9 * kept.size)]
            size = np.sqrt(np.mean(kept**2))
        wanted = abs(factor - 1.0) * size / (0.7 + 0.1 * size * min(abs(factor), 1.0))
        assert found[f"velocity.{name}"].excess == pytest.approx(wanted, rel=1e-6), name
    assert found["velocity.down"].got == f"{abs(factor - 1.0) * 9.0:.2g} m/s apart"


def test_canopies_that_are_exchanged_move_against_each_other():
    assert read("canopy_velocity")["canopy_velocity.order"].excess == 0.0
    found = read("canopy_velocity", replace(GOOD, canopy_velocity=GOOD.canopy_velocity[:, ::-1]))
    assert found["canopy_velocity.order"].excess == pytest.approx(1.0 / 0.3, rel=0.01)
    alike = replace(GOOD, canopy_velocity=np.repeat(GOOD.canopy_velocity[:, :1], 2, axis=1))
    assert "canopy_velocity.order" not in read("canopy_velocity", alike)


def _descent(speed):
    return Evidence(time=T, position=np.stack([0 * T, 0 * T, speed * T], axis=1), altitude=-speed * T,
                    velocity=np.stack([0 * T, 0 * T, speed + 0 * T], axis=1), descent_rate=speed + 0 * T)  # fmt: skip


@pytest.mark.parametrize(
    ("speed", "excess"), [(10.0, 0.0), (-0.5, 1.0), (-9.0, 5.0), (150.0, 1.0), (0.5, 0.5), (1.5, 0.0), (np.sqrt(1500.0), 0.5)]
)  # fmt: skip
def test_what_hangs_comes_down_by_every_channel(speed, excess):
    found = read("falling", _descent(speed))
    assert set(found) == {"falling.position", "falling.altitude", "falling.velocity", "falling.descent_rate"}
    for reading in found.values():
        assert reading.excess == pytest.approx(excess, abs=1e-6) and f"{speed:.3g} m/s downwards" in reading.got


def test_an_altitude_that_runs_the_other_way_is_told():
    turned_over = replace(_descent(9.0), altitude=9.0 * T)
    found = read("altitude", turned_over)
    assert found["altitude.rate"].excess == pytest.approx(18.0 / (0.5 + 0.9))
    assert found["altitude.descent_rate"].excess == pytest.approx(18.0 / (1.0 + 0.15 * 9.0))
    assert read("altitude", _descent(9.0))["altitude.datum"].excess == pytest.approx(0.0, abs=1e-9)
    assert read("altitude", replace(GOOD, position=None, descent_rate=None)) == {}


@pytest.mark.parametrize("axis", range(3))
def test_a_gyro_of_the_other_sense_is_told_about_its_axis(axis):
    fast = 0.4 * (np.arange(3) == axis) + 1e-3
    size = np.linalg.norm(fast)
    half = 0.5 * size * T[:, None]
    q = np.hstack([np.cos(half), np.sin(half) * fast / size])
    said = np.tile(fast, (T.size, 1))
    kept = read("attitude", Evidence(time=T, attitude=1.01 * q, rate=said))
    assert kept["attitude.norm"].excess == pytest.approx(0.5)
    assert max(kept[f"attitude.rate.{a}"].excess for a in "xyz") < 1e-6
    said[:, axis] *= -1.0
    told = read("attitude", Evidence(time=T, attitude=-q, rate=said))
    for j, name in enumerate("xyz"):
        wanted = (0.802 - 0.03) / (0.007 + 0.15 * 0.401) if j == axis else 0.0
        assert told[f"attitude.rate.{name}"].excess == pytest.approx(wanted, abs=1e-6), name


def test_a_gyro_may_be_off_by_a_bias_and_no_more():
    for bias, wanted in ((0.03, 0.0), (0.05, 0.02)):
        found = read("attitude", replace(GOOD, rate=GOOD.rate + [bias, 0.0, 0.0]))["attitude.rate.x"]
        assert found.excess * (0.007 + 0.15 * 0.02) == pytest.approx(wanted, abs=1e-6)


def test_specific_force_of_another_size():
    found = read("specific_force", Evidence(time=T, force=np.tile([2.0 * G, 0.0, 0.0], (T.size, 1))))["force.size"]
    assert found.excess == pytest.approx(np.log(2.0) / 0.2) and found.got == "a median of 2 g"


def test_a_force_turned_by_an_angle_is_told_with_the_angle():
    push = 2.0 * np.stack([np.cos(0.05 * T), np.sin(0.05 * T)], axis=1)
    velocity = np.column_stack([40.0 * np.sin(0.05 * T), -40.0 * np.cos(0.05 * T), 9.0 + 0.0 * T])
    level = np.tile([1.0, 0.0, 0.0, 0.0], (T.size, 1))
    force = np.column_stack([push, np.full(T.size, -G)])
    e = Evidence(time=T, velocity=velocity, attitude=level, force=force)
    assert read("specific_force", e)["force.turn"].excess < 0.01
    quarter = replace(e, force=np.column_stack([-push[:, 1], push[:, 0], force[:, 2]]))
    told = read("specific_force", quarter)
    assert told["force.turn"].excess == pytest.approx(np.sqrt(2.0) / 0.25, rel=0.01)
    assert "1.00 of it, turned by -90 deg" in told["force.turn"].got
    heavy = replace(e, force=force - [0.0, 0.0, 0.3])
    assert read("specific_force", heavy)["force.down"].excess == pytest.approx(0.5)


@pytest.mark.parametrize("angle", [0.0, 30.0, 50.0, 180.0])
def test_canopies_that_are_not_above(angle):
    lean = np.deg2rad(angle)
    away = 60.0 * np.array([np.sin(lean), 0.0, -np.cos(lean)])
    place = np.zeros((T.size, 3))
    e = Evidence(time=T, position=place, canopies=np.tile(away, (T.size, 1, 1)))
    found = read("hanging", e)["hanging.canopies"]
    assert found.excess == pytest.approx((1.0 - np.cos(lean)) / (1.0 - np.cos(np.deg2rad(50.0))), abs=1e-12)
    assert found.got.startswith(f"{angle:.0f} deg")


def test_the_attach_point_is_above_and_pulled_at():
    """A body whose attach point is 20 degrees off its lowest axis, hanging straight down from it or not."""
    lean = np.deg2rad(20.0)
    reach = 2.5 * np.array([np.sin(lean), 0.0, -np.cos(lean)])
    level = np.tile([1.0, 0.0, 0.0, 0.0], (T.size, 1))
    vehicle = Nominal(1.0, reach, np.ones(3), 1.0, 1.0, 1.0, 1, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    e = Evidence(time=T, attitude=level, force=np.tile([0.0, 0.0, -G], (T.size, 1)), vehicle=vehicle)
    limit = 1.0 - np.cos(np.deg2rad(50.0))
    found = read("hanging", e)
    for law in ("hanging.force", "hanging.attitude"):
        assert found[law].excess == pytest.approx((1.0 - np.cos(lean)) / limit) and found[law].got == "20 deg"
    half = 0.5 * lean  # about the y axis by as much: upright
    upright = np.tile([np.cos(half), 0.0, np.sin(half), 0.0], (T.size, 1))
    assert read("hanging", replace(e, attitude=-1.1 * upright))["hanging.attitude"].excess < 1e-9
    over = read("hanging", replace(e, attitude=np.tile([0.0, 1.0, 0.0, 0.0], (T.size, 1)), force=None))
    assert set(over) == {"hanging.attitude"} and over["hanging.attitude"].got == "160 deg"
    assert set(read("hanging", replace(e, attitude=None))) == {"hanging.force"}
    assert read("hanging", replace(e, vehicle=replace(vehicle, attach_b=np.zeros(3)))) == {}


def test_what_is_not_recorded_is_not_judged():
    """A law that lacks a channel says nothing, and no law fails: channels are left out one by one, then two by two."""
    names = (
        "position",
        "velocity",
        "attitude",
        "rate",
        "force",
        "canopies",
        "canopy_velocity",
        "altitude",
        "descent_rate",
    )
    whole = excesses()
    for one in names:
        for other in names:
            left = excesses(replace(GOOD, **{one: None, other: None}))
            assert set(left) < set(whole), (one, other)
            assert all(left[law] == whole[law] for law in left)


def test_what_pulls_the_mass_is_acceleration_less_gravity():
    made = earth_force(GOOD)
    np.testing.assert_allclose(made, np.tile([0.05, -0.025, 0.001 - G], (T.size - 20, 1)), atol=1e-9)
    np.testing.assert_allclose(over_lag(GOOD, 2.0 * T), 2.0 * (T[:-20] + 1.0), atol=1e-9)
    assert earth_force(Evidence(time=T)) is None and over_lag(GOOD, GOOD.force).shape == made.shape
