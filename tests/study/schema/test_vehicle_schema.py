"""What a vehicle may say beyond the default: canopies that breathe, risers that take hold sooner."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.parameters import STANDARD_GRAVITY, engagement_length
from bayeschute.study.assembly import assemble
from bayeschute.study.load import check_study, load_study
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
