"""Channels and masses of a cluster study: what is flown, recorded, fitted, and told where it can't be."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import bayeschute as bc
from bayeschute.records.read import read_record
from bayeschute.records.record import repairs, write_record
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import data_of
from bayeschute.study.evidence.identity import configuration, study_hash
from bayeschute.study.job import load_flight
from bayeschute.study.load import check_study, load_study
from bayeschute.study.run.stage_data import ingest, priors
from bayeschute.study.run.stage_report import true_values

NOISE = r'^(?=capsule_attitude = \{ white = "0.1 deg", correlated = "0.2 deg", time_constant = "2 s")'
SENSORS = r"^(?=dropouts = \{ share)"
GIVEN = r"^(?=riser_length = \{)"


@pytest.fixture
def asked(cluster: Path, spoil) -> Path:
    """The shipped study, six seconds of it, with tensions and a mass."""
    for _ in ("fitted", "predicted"):  # of one length: one compilation
        spoil(cluster, r'^duration = "90 s"', 'duration = "6 s"')
    spoil(cluster, SENSORS, 'riser_tension = { white = "100 lbf" }\nswing_angle = { white = "0.2 deg" }\n')
    spoil(cluster, NOISE, 'swing_angle = { white = "0.2 deg", kind = "white" }\n')
    spoil(cluster, NOISE, 'riser_tension = { white = "100 lbf", kind = "white" }\n')
    spoil(cluster, NOISE, 'descent_rate = { white = "0.2 ft/s", kind = "white" }\n')
    spoil(cluster, GIVEN, 'capsule_mass = { mean = "640 slug", sd = "13 slug" }\n')
    return spoil(cluster, GIVEN, 'canopy_mass = { median = "149 kg", log_sd = 0.1 }\n')


def test_what_is_not_said_leaves_a_study_s_hashes(cluster: Path, asked: Path):
    study = load_study(asked)
    for table in (study.noise, study.priors.given, study.flights[0].virtual.sensors):
        assert all(value is not None for value in table.model_dump(exclude_none=True).values())
    bare = study.noise.model_copy(update={"swing_angle": None, "riser_tension": None, "descent_rate": None})
    assert "riser_tension" not in bare.model_dump(exclude_none=True)
    assert configuration(replace(study, noise=bare)) != configuration(study)
    assert study_hash(study) == study_hash(load_study(asked))


def test_units_of_the_study_file(asked: Path):
    assert check_study(asked) == []
    study = load_study(asked)
    noise = study.noise.channels()
    assert list(noise) == [
        "canopy_position", "capsule_velocity", "capsule_attitude", "descent_rate", "swing_angle", "riser_tension"
    ]  # fmt: skip
    assert noise["riser_tension"].white == pytest.approx(444.82216)
    assert noise["swing_angle"].white == pytest.approx(np.deg2rad(0.2))
    assert noise["descent_rate"].white == pytest.approx(0.2 * 0.3048)
    drop = assemble.drop(study.flights[0].virtual)
    assert drop.sensors["riser_tension"].white == pytest.approx(444.82216) and "descent_rate" not in drop.sensors


def test_from_the_study_to_what_is_fitted(asked: Path, tmp_path: Path):
    study, kept = load_study(asked), {"structure.json": {"coefficients": {}}}
    study = replace(study, structure=study.structure.model_copy(update={"fit": "selected"}))
    job = SimpleNamespace(
        study=study, out=tmp_path / "run", quick=False, say=lambda _: lambda *said: None,
        load=lambda name: kept[name], save=lambda name, value: kept.update({name: value}),
    )  # fmt: skip
    (job.out / "flights").mkdir(parents=True)
    ingest(job)
    record = load_flight(job, "cdt-3-11")
    told = {r.variable: r.detail for r in repairs(record) if r.kind == "assumed"}
    assert told == {"descent_rate": "not recorded: it is not fitted"}
    assert not any(r.kind == "assumed" for r in repairs(load_flight(job, "cdt-3-12")))

    priors(job)
    made = {entry["name"]: entry for entry in kept["priors.json"]}
    assert made["capsule_mass"]["unit"] == made["canopy_mass"]["unit"] == "kg"
    assert made["capsule_mass"]["scale"] == pytest.approx(13 * 14.5939, rel=1e-5)
    assert made["canopy_mass"]["centre"] == pytest.approx(149.0 * np.exp(0.005))
    truth = true_values(job)
    assert truth["capsule_mass"] == study.vehicle.capsule.mass
    assert truth["canopy_mass"] == study.vehicle.canopies.dry_mass

    from bayeschute.study.job import load_priors

    parameters = load_priors(job)
    theta = np.array([p.centre for p in parameters])
    first, second = (data_of(job, flight, parameters) for flight in study.flights)
    assert first.model.channels == (
        "canopy_position", "capsule_velocity", "capsule_attitude", "swing_angle", "riser_tension"
    )  # fmt: skip
    assert sorted(set(first.channel)) == [0, 1, 2, 4, 5]
    assert float(first.model.numbers(theta).capsule.mass) == pytest.approx(640 * 14.5939, rel=1e-5)
    # The second flight says its own mass, and keeps it; the canopies are the same.
    assert float(second.model.numbers(theta).capsule.mass) == pytest.approx(20340 * 0.45359237)
    assert float(second.model.numbers(theta).canopies.dry_mass) == pytest.approx(149.0 * np.exp(0.005))


def test_velocities_of_canopies_from_a_virtual_drop_to_check(cluster: Path, spoil, tmp_path: Path):
    """A virtual drop's record goes to a file, is read again and passes its laws."""
    imu = 'canopy_velocity = { white = "0.05 m/s", correlated = "0.15 m/s", time_constant = "1 s" }\n'
    spoil(cluster, SENSORS, imu)
    spoil(cluster, NOISE, imu)
    study = load_study(cluster)
    assert list(study.noise.channels()).index("canopy_velocity") == 3
    flight = bc.Study.load(cluster).flights[0]
    assert flight.truth is not None and flight.truth["canopy_velocity"].shape == flight.record["canopy_velocity"].shape
    write_record(flight.record, tmp_path / "drop.nc")
    again = read_record(tmp_path / "drop.nc")
    np.testing.assert_array_equal(again["canopy_velocity"].values, flight.record["canopy_velocity"].values)
    found = flight.plausibility()
    laws = {r.law: r.excess for r in found.verdict.readings}
    assert found.ok and max(laws["canopy_velocity.horizontal"], laws["canopy_velocity.down"]) < 0.7
    assert "Velocity of the canopies down" in [
        axes.get_title(loc) for axes in found.plot().axes for loc in ("left", "center")
    ]


def test_a_fitted_flight_has_one_mass(asked: Path, spoil):
    spoil(asked, r'^roles = \["structure", "identify"\]', 'roles = ["structure", "identify"]\ncapsule_mass = "9000 kg"')
    faults = check_study(asked)
    assert len(faults) == 1
    assert "capsule_mass (flight 'cdt-3-11')" in faults[0].where and "which is fitted" in faults[0].wanted


@pytest.mark.parametrize(
    "pattern, new, where",
    [
        (r"^(?=descent_rate = \{)", 'riser_tension = { white = "1 N", kind = "white" }\n', "[noise] riser_tension"),
        (
            r"^(?=descent_rate = \{)",
            'canopy_velocity = { white = "1 m/s", kind = "white" }\n',
            "[noise] canopy_velocity",
        ),
        (r"^(?=descent_rate = \{)", 'swing_angle = { white = "1 deg", kind = "white" }\n', "[noise] swing_angle"),
        (r"^(?=cds_over_mass = )", 'capsule_mass = { mean = "9 kg", sd = "1 kg" }\n', "[priors.given] capsule_mass"),
    ],
)
def test_a_descent_has_no_use_for_them(descent: Path, spoil, pattern: str, new: str, where: str):
    faults = check_study(spoil(descent, pattern, new))
    assert len(faults) == 1 and where in faults[0].where and "no use for" in faults[0].got
