"""Laws between a record and its vehicle: kept by a vehicle at rest in its air, broken by a size that is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.atmosphere.standard import standard_density, standard_pressure, standard_temperature
from bayeschute.records.plausibility import vehicle_laws
from bayeschute.records.plausibility.evidence import Evidence, Nominal

G, GAS = 9.80665, 287.053
T = 0.1 * np.arange(1500)
VEHICLE = Nominal(
    mass=5000.0, attach_b=np.array([0.0, 0.0, -2.0]), inertia=np.array([4000.0, 5000.0, 6000.0]), capsule_length=3.5,
    capsule_area=10.0, capsule_drag=0.8, canopies=2, area=300.0, diameter=20.0, dry_mass=60.0, volume=700.0,
    riser_length=30.0, stiffness=5e4,
)  # fmt: skip
WIND = np.array([6.0, -4.0, 0.0])
LENGTH = 30.0 + 5000.0 * G / (2.0 * 5e4)
ANGLE = np.deg2rad(10.0)
SHARE = 5000.0 * G / (2.0 * np.cos(ANGLE))


def hanging():
    """Sinking steadily with the wind, two canopies 10 degrees to either side."""
    drag = 0.75 * 2.0 * 300.0 + 0.8 * 10.0
    density = 1.0
    speed = np.sqrt(2.0 * G * 5120.0 / (density * drag))
    velocity = np.tile(WIND + [0.0, 0.0, speed], (T.size, 1))
    place = velocity * T[:, None]
    lean = LENGTH * np.array([[np.sin(ANGLE), 0.0, -np.cos(ANGLE)], [-np.sin(ANGLE), 0.0, -np.cos(ANGLE)]])
    return Evidence(
        time=T, position=place, velocity=velocity, attitude=np.tile([1.0, 0.0, 0.0, 0.0], (T.size, 1)),
        canopies=place[:, None] + VEHICLE.attach_b + lean, tension=np.full((T.size, 2), SHARE),
        wind=np.tile(WIND, (T.size, 1)), density=np.full(T.size, density), vehicle=VEHICLE,
    )  # fmt: skip


GOOD = hanging()


def read(law, e=GOOD):
    return {r.law: r for r in getattr(vehicle_laws, law)(e)}


def test_a_vehicle_at_rest_in_its_air_keeps_the_laws():
    found = {r.law: r.excess for law in vehicle_laws.LAWS for r in law(GOOD)}
    exact = ("count.canopies", "count.load_cells", "riser.length", "riser.scatter", "pull.direction", "wind.drift",
             "balance.drag", "wind.present")  # fmt: skip
    for law in exact:
        assert found[law] < 0.01, law
    assert found["pull.size"] < 0.01 and found["wind.share"] < 0.05 and all(found[f"size.{s}"] < 1.0 for s in ("area", "volume", "inertia", "riser"))  # fmt: skip


def test_one_canopy_too_few_is_twice_the_limit():
    other = replace(VEHICLE, canopies=3)
    found = read("count", replace(GOOD, vehicle=other))
    assert [r.excess for r in found.values()] == [2.0, 2.0] and found["count.canopies"].wanted == "3"
    assert read("count", Evidence(time=T)) == {} and read("sizes", Evidence(time=T)) == {}


@pytest.mark.parametrize(
    ("key", "power", "law", "limit"),
    [
        ("area", 1.0, "size.area", 0.6), ("diameter", -2.0, "size.area", 0.6), ("volume", 1.0, "size.volume", 1.5),
        ("mass", -0.5, "size.inertia", 1.1), ("capsule_length", -1.0, "size.inertia", 1.1),
        ("riser_length", 1.0, "size.riser", 1.3), ("diameter", -1.0, "size.riser", 1.3),
    ],
)  # fmt: skip
def test_sizes_go_together_by_powers(key, power, law, limit):
    """A size ten times as large moves the logarithm of the ratio that it is part of by its power."""
    fair = replace(VEHICLE, area=np.pi * 100.0, volume=0.12 * (np.pi * 100.0) ** 1.5, riser_length=32.0,
                   inertia=5000.0 * (0.28 * 3.5) ** 2 * np.ones(3))  # fmt: skip
    found = read("sizes", replace(GOOD, vehicle=fair))
    assert len(found) == 4 and max(r.excess for r in found.values()) < 1e-9
    large = replace(fair, **{key: 10.0 * getattr(fair, key)})
    reading = read("sizes", replace(GOOD, vehicle=large))[law]
    assert reading.excess == pytest.approx(abs(power) * np.log(10.0) / limit)
    assert reading.got == f"a factor exp({power * np.log(10.0):+.2f})"


def test_risers_of_another_length():
    for factor in (0.9, 1.1):
        other = replace(GOOD, vehicle=replace(VEHICLE, riser_length=factor * LENGTH - (LENGTH - 30.0)))
        reading = read("risers", other)["riser.length"]
        assert (
            reading.excess == pytest.approx(abs(np.log(factor)) / 0.06) and reading.got == f"{1.0 / factor:.3g} of it"
        )
    breathing = 1.0 + 0.02 * np.sin(3.0 * T)[:, None, None]
    attach = GOOD.position[:, None] + VEHICLE.attach_b
    moved = replace(GOOD, canopies=attach + breathing * (GOOD.canopies - attach))
    share = np.sqrt(0.5 - np.sin(0.9 * np.pi) / (1.8 * np.pi))  # of a sine, its smaller nine tenths
    assert read("risers", moved)["riser.scatter"].excess == pytest.approx(0.02 * LENGTH * share / 30.0 / 0.03, rel=0.01)


def test_the_worst_riser_is_told():
    moved = GOOD.canopies.copy()
    moved[:, 1] += 0.2 * (moved[:, 1] - GOOD.position - VEHICLE.attach_b)
    assert read("risers", replace(GOOD, canopies=moved))["riser.length"].got == "1.2 of it"


@pytest.mark.parametrize("factor", [0.5, 4.448])
def test_load_cells_in_another_unit(factor):
    reading = read("pull", replace(GOOD, tension=factor * GOOD.tension))["pull.size"]
    assert (
        reading.excess == pytest.approx(abs(np.log(factor)) / 0.18, rel=0.01) and reading.got == f"{factor:.3g} of it"
    )


def test_a_pull_across_the_risers_is_told_as_a_share_of_the_weight():
    """An acceleration to the east, across the plane of the risers."""
    aside = replace(GOOD, velocity=GOOD.velocity + np.outer(0.1 * G * T, [0.0, 1.0, 0.0]))
    found = read("pull", aside)["pull.direction"]
    share = 0.1 * np.sqrt(3.0 * 0.7 / 2.7)  # of three components one, less the largest tenth of all
    assert found.got == f"{share:.3f} of the weight across them"
    swing = 0.1 * np.sqrt(2.0 * 0.8 / 1.8)
    assert found.excess == pytest.approx(share / (0.02 + 0.15 * swing), rel=5e-3)


def test_canopies_that_are_seen_badly_may_pull_aside_by_more():
    """By three times the scatter of their samples over the risers' length."""
    rng = np.random.default_rng(1)
    scatter = 0.004 * GOOD.vehicle.riser_length
    blurred = replace(GOOD, canopies=GOOD.canopies + scatter * rng.standard_normal(GOOD.canopies.shape))
    clear, found = (read("pull", e)["pull.direction"] for e in (GOOD, blurred))
    limits = [float(one.wanted.split()[1]) for one in (clear, found)]
    assert limits[1] - limits[0] == pytest.approx(0.012, abs=0.003)
    turned = replace(blurred, velocity=GOOD.velocity + np.outer(0.1 * G * T, [0.0, 1.0, 0.0]))
    assert read("pull", turned)["pull.direction"].excess > 1.0


def test_exchanged_load_cells_are_told_by_their_difference():
    """The capsule is pulled to and fro in the plane of the risers: each pulls more when it goes its way."""
    push = 0.1 * G * np.sin(0.3 * T)
    velocity = GOOD.velocity + np.outer(-0.1 * G / 0.3 * (np.cos(0.3 * T) - 1.0), [1.0, 0.0, 0.0])
    more = 5000.0 * push / (2.0 * np.sin(ANGLE))
    e = replace(GOOD, velocity=velocity, tension=SHARE + np.stack([more, -more], axis=1))
    assert read("pull", e)["pull.order"].excess == 0.0 and read("pull", e)["pull.size"].excess < 0.05
    other = read("pull", replace(e, tension=e.tension[:, ::-1]))["pull.order"]
    assert other.excess == pytest.approx(1.0 / 0.3, rel=0.01)


@pytest.mark.parametrize("factor", [0.5, 1.9])
def test_the_drag_that_holds_the_weight(factor):
    """q C_A n S + q C_D S_c = weight, and the square of the speed is in q."""
    fast = replace(GOOD, density=factor * GOOD.density)
    wanted = (0.75 * 600.0 + 8.0) / factor / 600.0 - 8.0 / 600.0
    reading = read("balance", fast)["balance.drag"]
    assert reading.got == f"C_A of about {wanted:.3g}"
    assert reading.excess == pytest.approx(abs(np.log(wanted / 0.75)) / np.log(1.9))
    blown = replace(GOOD, wind=None, velocity=GOOD.velocity - WIND)
    assert read("balance", blown)["balance.drag"].excess == pytest.approx(0.0, abs=1e-9)


def test_the_balance_asks_for_no_recorded_density():
    """That of pressure and temperature, or of the standard atmosphere, does where none is recorded: a mass in pounds shows."""
    gas = GOOD.density * vehicle_laws.GAS_CONSTANT_DRY_AIR * 280.0
    measured = replace(GOOD, density=None, pressure=gas, temperature=np.full(T.size, 280.0))
    exact = read("balance", GOOD)["balance.drag"].excess
    assert read("balance", measured)["balance.drag"].excess == pytest.approx(exact, abs=1e-9)
    standard = replace(GOOD, density=None, pressure=None, temperature=None)
    assert read("balance", standard)["balance.drag"].excess < 1.0
    heavy = replace(VEHICLE, mass=VEHICLE.mass / 0.45359237)
    assert read("balance", replace(measured, vehicle=heavy))["balance.drag"].excess > 1.0
    assert (
        read("balance", replace(standard, vehicle=replace(VEHICLE, mass=9.0 * VEHICLE.mass)))["balance.drag"].excess
        > 1.0
    )
    assert read("balance", replace(standard, altitude=None, position=None)) == {}


def test_a_wind_that_comes_from_where_it_should_go():
    found = read("drift", replace(GOOD, wind=-GOOD.wind))
    assert found["wind.share"].got.endswith("turned by 180 deg")
    assert found["wind.share"].excess > 1.0 and found["wind.drift"].excess > 1.0
    east = read("drift", replace(GOOD, wind=GOOD.wind[:, [1, 0, 2]] * [1.0, -1.0, 1.0]))
    assert east["wind.share"].got.endswith("turned by 90 deg")
    none = read("drift", replace(GOOD, wind=None))
    assert none["wind.present"].excess == 1.5 and len(none) == 1
    apart = read("drift", replace(GOOD, profile=GOOD.wind + [3.0, 3.0, 0.0]))["wind.profile"]
    size = min(np.sqrt((1.0 * 4.0**2 + 0.8 * 6.0**2) / 1.8), np.sqrt((1.0 * 1.0 + 0.8 * 9.0**2) / 1.8))
    assert apart.excess == pytest.approx(3.0 / (1.0 + 0.3 * size))
    np.testing.assert_allclose(vehicle_laws.air(replace(GOOD, shear=np.full((T.size, 3), 0.5))), GOOD.wind + 0.5)


@pytest.mark.parametrize(("seconds", "judged"), [(40.0, False), (50.0, True), (120.0, True)])
def test_a_drift_needs_one_and_a_half_swings(seconds, judged):
    n = round(seconds / 0.1)
    short = Evidence(time=T[:n], velocity=GOOD.velocity[:n], wind=GOOD.wind[:n])
    found = read("drift", short)
    assert set(found) == ({"wind.drift", "wind.share"} if judged else set())
    assert all(r.excess < 0.05 for r in found.values())


def test_what_is_not_recorded_is_not_judged():
    names = ("position", "velocity", "attitude", "canopies", "tension", "wind", "density")
    whole = {r.law for law in vehicle_laws.LAWS for r in law(GOOD)}
    for one in names:
        for other in names:
            less = replace(GOOD, **{one: None, other: None})
            assert {r.law for law in vehicle_laws.LAWS for r in law(less)} <= whole, (one, other)
    assert vehicle_laws.attached(replace(GOOD, position=None)) is None
    plain = vehicle_laws.attached(replace(GOOD, attitude=None))
    np.testing.assert_allclose(plain, GOOD.canopies - GOOD.position[:, None])


def test_air_of_another_density_and_lapse():
    height = 3000.0 - 10.0 * T
    pressure, warmth = standard_pressure(height), standard_temperature(height)
    air = Evidence(time=T, altitude=height, pressure=pressure, temperature=warmth, density=pressure / (GAS * warmth))
    kept = read("density", air)
    assert set(kept) == {"density.gas", "density.level", "density.slope", "pressure.altitude"}
    assert max(r.excess for r in kept.values()) < 1e-2
    dense = read("density", replace(air, density=1.2 * air.density))
    assert dense["density.gas"].excess == pytest.approx(np.log(1.2) / 0.05, rel=1e-3)
    assert dense["density.level"].excess == pytest.approx(np.log(1.2) / 0.13, rel=1e-2)
    assert dense["density.level"].got == "1.2 of the standard" and dense["density.slope"].excess < 1e-2
    steep = read("density", replace(air, density=standard_density(height) * np.exp(0.06 * height / 1000.0)))
    assert (
        steep["density.slope"].excess == pytest.approx(1.5, rel=1e-3) and "+0.060 per km" in steep["density.slope"].got
    )
    high = read("density", replace(air, altitude=height + 1000.0))["pressure.altitude"]
    assert high.excess == pytest.approx(1000.0 / (350.0 + 0.07 * np.median(height + 1000.0)), rel=1e-3)
    assert high.got == "-1000 m apart"
    dry = read("density", replace(air, density=None))
    assert dry["density.level"].excess < 1e-2 and "density.gas" not in dry
    assert read("density", Evidence(time=T)) == {}
