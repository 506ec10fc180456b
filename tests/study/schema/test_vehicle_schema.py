"""What a vehicle may say beyond the default: canopies that breathe, risers that take hold sooner."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import bayeschute as bc
from bayeschute.core.errors import InputError
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.parameters import STANDARD_GRAVITY, engagement_length
from bayeschute.study import kept_inputs
from bayeschute.study.assembly import assemble
from bayeschute.study.load import check_study, load_flights, load_study, load_study_or_vehicle, load_vehicle
from bayeschute.study.schema.vehicle_schema import NOT_FLOWN
from bayeschute.study.study import study_hash
from bayeschute.virtual.drop import start_of

PRODUCTS = 'inertia_products = ["250 kg m^2", "-1500 kg m^2", "100 kg m^2"]'
BREATHING = '[canopies.breathing]\nfrequency = "0.23 Hz"\ndamping_ratio = 0.05\naxial_slope = 1.0\n'


def told(study: Path) -> str:
    return "\n".join(map(str, check_study(study)))


def test_breathing_reaches_structure_and_start(cluster: Path, spoil):
    spoil(cluster.parent / "vehicle.toml", r"^\[risers\]", f"{BREATHING}\n[risers]")
    spoil(cluster, r'^flyout = "9 deg".*$', 'flyout = "9 deg"\nshape = [0.05, -0.02]')
    study = load_study(cluster)
    assert study.vehicle is not None and study.flights[0].virtual is not None
    model, structure = assemble.cluster(study.vehicle)
    assert structure.breathing and model.breathing is not None
    omega = 2.0 * np.pi * 0.23
    assert model.breathing.stiffness == pytest.approx(omega**2)
    assert model.breathing.damping == pytest.approx(2.0 * 0.05 * omega)
    start = start_of(assemble.drop(study.flights[0].virtual), model, 2)
    np.testing.assert_array_equal(start.shape, [[0.05, -0.02], [0.0, 0.0]])


def test_engagement_is_told_or_follows_from_the_load(cluster: Path, spoil):
    vehicle = load_study(cluster).vehicle
    assert vehicle is not None
    weight = vehicle.capsule.mass * STANDARD_GRAVITY
    assert assemble.cluster(vehicle)[0].risers.engagement == engagement_length(weight, vehicle.risers.stiffness, 2)
    light = engagement_length(5000.0 * STANDARD_GRAVITY, vehicle.risers.stiffness, 2)
    assert assemble.cluster(vehicle, 5000.0)[0].risers.engagement == light
    spoil(
        cluster.parent / "vehicle.toml",
        r'^damping = "10000 lbf s/ft".*$',
        'damping = "10000 lbf s/ft"\nengagement = "3 cm"',
    )
    vehicle = load_study(cluster).vehicle
    assert vehicle is not None
    assert assemble.cluster(vehicle)[0].risers.engagement == pytest.approx(0.03)


def test_products_of_inertia_reach_the_capsule(cluster: Path, spoil):
    vehicle = load_study(cluster).vehicle
    assert vehicle is not None and assemble.cluster(vehicle)[0].capsule.products is None
    spoil(cluster.parent / "vehicle.toml", r"^reference_area", f"{PRODUCTS}\nreference_area")
    vehicle = load_study(cluster).vehicle
    assert vehicle is not None
    capsule = assemble.cluster(vehicle)[0].capsule
    assert capsule.products == Vec3(250.0, -1500.0, 100.0) and capsule.inertia == Vec3(25e3, 22e3, 20e3)


@pytest.mark.parametrize(
    ("file", "pattern", "new", "words"),
    [
        ("virtual.toml", r'^flyout = "9 deg".*$', 'flyout = "9 deg"\nshape = [0.1, 0.1]', "the vehicle's canopies don't breathe"),
        ("vehicle.toml", r"^\[risers\]", BREATHING.replace("0.05", "1.5") + "[risers]", "damping_ratio"),
        ("vehicle.toml", r"^\[risers\]", BREATHING.replace("0.23 Hz", "4 s") + "[risers]", "frequency"),
        ("vehicle.toml", r"^\[risers\]", '[risers]\nengagement = "1 m"', "to which the capsule's weight stretches them"),
        ("vehicle.toml", r"^\[risers\]", '[risers]\nengagement = "0 m"', "engagement"),
        ("vehicle.toml", r"^reference_area", PRODUCTS.replace("250", "30000") + "\nreference_area", "positive definite"),
        ("vehicle.toml", r"^reference_area", PRODUCTS.replace("250", "30000") + "\nreference_area", "a principal moment of -"),
        ("vehicle.toml", r"^reference_area", PRODUCTS.replace("250 kg m^2", "250 kg m") + "\nreference_area", "inertia_products"),
        ("vehicle.toml", r"^reference_area", PRODUCTS.replace(', "100 kg m^2"', "") + "\nreference_area", "inertia_products"),
    ],
)  # fmt: skip
def test_faults_are_told(cluster: Path, spoil, file: str, pattern: str, new: str, words: str):
    spoil(cluster.parent / file, pattern, new)
    assert words in told(cluster)


def test_as_many_shapes_as_canopies(cluster: Path, spoil):
    spoil(cluster.parent / "vehicle.toml", r"^\[risers\]", f"{BREATHING}\n[risers]")
    spoil(cluster, r'^flyout = "9 deg".*$', 'flyout = "9 deg"\nshape = [0.05]')
    assert "1 numbers; wanted 2 numbers, one for each canopy" in told(cluster)


SECOND = '\n[[flight]]\nname = "second"\nfile = "second.nc"\nroles = ["predict"]\nvehicle = "other.toml"\n'


@pytest.fixture
def several(cluster: Path, spoil) -> Path:
    """A study whose second flight has a vehicle of its own, with heavier capsule and without aerodynamics."""
    own = (cluster.parent / "vehicle.toml").read_text(encoding="utf-8")
    other = cluster.parent / "other.toml"
    other.write_text(own[: own.index("[aero]")], encoding="utf-8")
    spoil(other, r"^mass = .*$", 'mass = "9500 kg"')
    (cluster.parent / "second.nc").write_text("read by nothing here", encoding="utf-8")
    cluster.write_text(cluster.read_text(encoding="utf-8") + SECOND, encoding="utf-8")
    return cluster


def test_a_flight_has_a_vehicle_of_its_own(several: Path, tmp_path: Path, spoil):
    study = load_study(several)
    virtual, second = study.flights[0], study.flights[-1]
    assert study.vehicle_of(second).capsule.mass == 9500.0 != study.vehicle_of(virtual).capsule.mass
    before = study_hash(study)
    assert kept_inputs.keep(study, tmp_path / "run", "# run") == ""
    assert load_study(tmp_path / "run" / "study.toml").flights[-1].vehicle == second.vehicle
    spoil(several.parent / "other.toml", r"^mass = .*$", 'mass = "9400 kg"')
    assert study_hash(load_study(several)) != before


def test_faults_of_a_flights_own_vehicle_are_told_with_its_file(several: Path, spoil):
    spoil(several.parent / "other.toml", r'^mass = "9500 kg"', 'mass = "9500 m"')
    assert "other.toml" in told(several) and "9500 m" in told(several)
    spoil(several, r'^vehicle = "other.toml"', 'vehicle = "none.toml"')
    assert "none.toml" in told(several)


def test_a_study_has_one_number_of_canopies(several: Path, spoil):
    spoil(several.parent / "other.toml", r"^number = 2.*$", "number = 1")
    faults = [fault for fault in check_study(several) if "canopies" in fault.got]
    assert len(faults) == 1 and "bayeschute predict" in faults[0].do and "second" in faults[0].where


def test_a_mass_that_is_fitted_is_one(several: Path, spoil):
    spoil(several, r'^roles = \["predict"\]\nvehicle', 'roles = ["identify"]\nvehicle')
    spoil(several, r"^\[priors\.given\]", '[priors.given]\ncapsule_mass = { mean = "9000 kg", sd = "50 kg" }')
    assert "vehicle of a fitted flight's own" in told(several)


def test_no_virtual_drop_flies_without_aerodynamics(cluster: Path, spoil):
    vehicle = cluster.parent / "vehicle.toml"
    text = vehicle.read_text(encoding="utf-8")
    vehicle.write_text(text[: text.index("[aero]")], encoding="utf-8")
    assert load_vehicle(vehicle).aero == NOT_FLOWN
    faults = check_study(cluster)
    assert len(faults) == len(tomllib.loads(cluster.read_text(encoding="utf-8"))["flight"])
    assert all("without [aero]" in fault.got and "virtual" in fault.where for fault in faults)
    with pytest.raises(InputError, match=r"\[aero\]"):
        load_study_or_vehicle(vehicle)
    with pytest.raises(InputError, match=r"without \[aero\]"):
        bc.Study.example().flights[0].changed(vehicle=load_vehicle(vehicle))
    spoil(cluster, r"^\[flight\.virtual\]", 'vehicle = "vehicle.toml"\n[flight.virtual]')
    assert "vehicle of a virtual flight" in told(cluster)


def test_flights_to_be_predicted_have_the_number_of_canopies_at_the_top_of_their_file(several: Path, spoil):
    study, path = load_study(several), several.parent / "flights.toml"
    path.write_text(SECOND, encoding="utf-8")
    assert load_flights(path, study).flights[0].vehicle == study.flights[-1].vehicle
    spoil(several.parent / "other.toml", r"^number = 2.*$", "number = 1")
    with pytest.raises(InputError, match="1 canopies"):
        load_flights(path, study)
    path.write_text('vehicle = "other.toml"\n' + SECOND, encoding="utf-8")
    assert study.vehicle_of(load_flights(path, study).flights[0]).canopies.number == 1
