"""Reading a study: every fault of every file at once, and what a sound one holds."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import bayeschute as bc
from bayeschute.core.errors import InputError
from bayeschute.study.load import check_study, load_study, load_study_or_vehicle, load_vehicle, usual_study
from bayeschute.study.study import file_hash, study_hash
from bayeschute.study.templates import template

ROOT = Path(__file__).parents[2]
REALDATA = ROOT.parent / "shared" / "realdata"
FOOT = 0.3048


def test_the_default_study_is_in_si():
    study = load_study(ROOT / "models/studies/cdt-3-11.toml")
    assert study.model == "cluster"
    assert [flight.name for flight in study.flights] == ["cdt-3-11", "cdt-3-12"]
    assert [flight.name for flight in study.with_role("identify")] == ["cdt-3-11"]
    first, second = (flight.virtual for flight in study.flights)
    assert first is not None and second is not None
    assert first.altitude == pytest.approx(6500 * FOOT)
    assert first.wind.east[-1] == pytest.approx(-14 * FOOT)
    assert study.flights[1].capsule_mass == pytest.approx(20340 * 0.45359237)
    assert study.vehicle is not None and study.vehicle.canopies.number == 2
    assert study.requirements[0].at_most == pytest.approx(33 * FOOT)
    assert set(study.noise.channels()) == {"canopy_position", "capsule_velocity", "capsule_attitude"}
    assert study.priors.given.riser_length is not None and not study.priors.given.riser_length.log_normal
    assert study.structure is not None and study.structure.sigma_max == 1.0


@pytest.mark.parametrize("name", ["dropsondes", "halcyon"])
@pytest.mark.skipif(not REALDATA.is_dir(), reason="the measured descents lie outside the project")
def test_the_measured_studies_have_no_fault(name: str):
    assert check_study(ROOT / f"models/studies/{name}.toml", REALDATA) == []


@pytest.mark.parametrize("name", ["dropsondes", "halcyon"])
def test_the_measured_studies_have_only_one_fault_without_data(name: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("BAYESCHUTE_DATA", raising=False)
    faults = check_study(ROOT / f"models/studies/{name}.toml")
    assert len(faults) == 1
    assert "--data DIR" in faults[0].do and "BAYESCHUTE_DATA" in faults[0].do


def test_data_come_from_the_option_or_the_environment(descent: Path, spoil, monkeypatch: pytest.MonkeyPatch):
    spoil(descent, '^file = "', 'file = "${DATA}/')
    monkeypatch.setenv("BAYESCHUTE_DATA", str(descent.parent))
    assert check_study(descent) == []
    monkeypatch.setenv("BAYESCHUTE_DATA", "/nowhere")
    assert "no such folder" in str(check_study(descent)[0])
    assert check_study(descent, descent.parent) == []
    assert load_study(descent, descent.parent).flights[0].path == descent.parent / "my-descent.csv"


def test_faults_of_study_vehicle_and_records_are_told_together(cluster: Path, descent: Path, spoil):
    spoil(cluster, '^title = ".*"', "title = 3")
    spoil(cluster, r"^canopies = \[1\]", "canopies = [7]")
    spoil(cluster, '^frequency = "0.25 Hz"', 'frequency = "-2 Hz"')
    spoil(cluster.parent / "vehicle.toml", '^length = "234 ft"', "length = 234")
    told = "\n".join(map(str, check_study(cluster)))
    assert all(word in told for word in ("title", "[noise.breathing] frequency", "vehicle.toml [risers] length"))

    spoil(descent, "^seed = 1", "seed = 1.5")
    spoil(descent, '^median|median = "0.15', 'medium = "0.15')
    (descent.parent / "my-descent.csv").write_text("time_s,altitude_m\n" + "0,x\n" * 20, encoding="utf-8")
    told = "\n".join(map(str, check_study(descent)))
    assert all(
        word in told
        for word in ("seed", "medium", "my-descent.csv column 'altitude_m'", "my-descent.csv column 'time_s'")
    )


def test_tables_that_are_sound_are_checked_against_each_other_though_another_is_not(cluster: Path, spoil):
    spoil(cluster, '^title = ".*"', "title = 3")
    spoil(cluster, r"^canopies = \[1\]", "canopies = [7]")
    told = [str(fault) for fault in check_study(cluster)]
    assert len(told) == 2
    assert "canopy 7" in told[1]


def test_toml_that_cannot_be_read_is_told_with_its_line(descent: Path, spoil):
    spoil(descent, "^seed = 1", "seed == 1")
    faults = check_study(descent)
    assert len(faults) == 1
    assert f"{descent} line" in faults[0].where
    assert "TOML" in faults[0].wanted


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "required"),
        (b"\xff\xfe\x00garbage\x80", "UTF-8"),
        (b"a = " + b"[" * 50_000, "nested too deep"),
        (b"a = 1" + b"0" * 5000, "can't be read"),
        (b"#" * 2_000_000, "2000000 bytes"),
        (b"title = 1\ntitle = 2\n", "line 2"),
        (b"flight = 3", "a list"),
        (b"flight = [3]", "a table"),
    ],
)
def test_files_that_are_no_study(tmp_path: Path, content: bytes, words: str):
    path = tmp_path / "x.toml"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        load_study(path)
    assert words in str(caught.value)
    assert all(fault.where.startswith(str(path)) for fault in caught.value.faults)


@pytest.mark.parametrize("path", ["nowhere.toml", "."])
def test_a_path_that_is_no_file(path: str):
    with pytest.raises(InputError, match="wanted a TOML file"):
        load_study(path)


def test_the_hash_is_of_the_meaning_not_of_the_layout(cluster: Path, spoil):
    before = study_hash(load_study(cluster))
    spoil(cluster, '^altitude = "6500 ft".*', 'altitude = "6500ft"  # a comment')
    assert study_hash(load_study(cluster)) == before
    spoil(cluster, '^altitude = "6500ft"', 'altitude = "6501 ft"')
    assert study_hash(load_study(cluster)) != before


def test_the_hash_does_not_depend_on_the_folder_but_on_the_record(descent: Path, tmp_path: Path):
    before = study_hash(load_study(descent))
    other = tmp_path / "other"
    other.mkdir()
    for name in ("descent.toml", "my-descent.csv"):
        shutil.copy(descent.parent / name, other / name)
    assert study_hash(load_study(other / "descent.toml")) == before
    with (other / "my-descent.csv").open("a", encoding="utf-8") as file:
        file.write("200,0\n")
    assert study_hash(load_study(other / "descent.toml")) != before


def test_the_hash_depends_on_the_vehicle(cluster: Path, spoil):
    before = study_hash(load_study(cluster))
    spoil(cluster.parent / "vehicle.toml", '^length = "234 ft"', 'length = "235 ft"')
    assert study_hash(load_study(cluster)) != before


def test_a_files_hash_is_its_sha256(tmp_path: Path):
    (tmp_path / "x").write_bytes(b"abc")  # FIPS 180-2, appendix B.1
    assert file_hash(tmp_path / "x") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_a_vehicle_alone_is_a_virtual_drop_of_it(tmp_path: Path, spoil):
    path = tmp_path / "v.toml"
    shutil.copy(template("vehicle.toml"), path)
    spoil(path, '^length = "234 ft"', 'length = "200 ft"')
    study = load_study_or_vehicle(path)
    assert study.vehicle is not None and study.vehicle == load_vehicle(path)
    assert study.vehicle.risers.length == pytest.approx(200 * FOOT)
    assert all(flight.virtual for flight in study.flights)
    spoil(path, '^length = "200 ft"', "length = 200")
    with pytest.raises(InputError, match="bare number"):
        load_study_or_vehicle(path)


def test_a_cut_is_a_share_of_the_window_or_a_time(descent: Path, spoil):
    cut = load_study(descent).flights[0].identify_until
    assert cut is not None and cut.at(100.0, 200.0) == pytest.approx(165.0)
    spoil(descent, '^identify_until = "65 %"', 'identify_until = "1 min"')
    cut = load_study(descent).flights[0].identify_until
    assert cut is not None and cut.at(0.0, 200.0) == pytest.approx(60.0)


def test_a_flight_without_a_study_has_priors_of_its_own_risers_and_terms_of_its_canopies():
    """Those of a payload of 12 kg under one canopy were about the lines of a capsule of ten tonnes."""
    whole = bc.Study.example().flights[0].vehicle
    same = usual_study("cluster", whole)
    assert same.priors == usual_study("cluster").priors and same.structure == usual_study("cluster").structure
    risers = whole.risers.model_copy(update={"length": 4.0, "stiffness": 2600.0, "damping": 70.0})
    canopies = whole.canopies.model_copy(update={"number": 1})
    one = whole.model_copy(update={"risers": risers, "canopies": canopies})
    made = usual_study("cluster", one)
    given = made.priors.given
    assert (given.riser_length.mean, given.riser_length.sd) == (4.0, 0.2)
    assert (given.riser_stiffness.median, given.riser_damping.median) == (2600.0, 70.0)
    assert given.riser_stiffness.log_sd == same.priors.given.riser_stiffness.log_sd
    assert made.structure.axial == ("1", "alpha^2", "alpha^4")
    assert "c" not in made.structure.transverse and "repulsion(0.8)" not in made.structure.transverse
    assert {"e", "side*e", "e*(e.rate)"} <= set(made.structure.transverse)


def test_a_flight_without_a_study_has_a_prior_of_its_own_capsule_s_drag_and_none_beside_a_table():
    whole = bc.Study.example().flights[0].vehicle
    draggy = whole.model_copy(update={"capsule": whole.capsule.model_copy(update={"axial_force": -0.5})})
    given = usual_study("cluster", draggy).priors.given
    assert (given.capsule_axial_force.mean, given.capsule_axial_force.sd) == (-0.5, 0.3)
    tabled = {"axial_force": None, "normal_force_slope": None, "pitch_moment_slope": None, "table": "any"}
    with_table = whole.model_copy(update={"capsule": whole.capsule.model_copy(update=tabled)})
    given = usual_study("cluster", with_table).priors.given
    assert given.capsule_axial_force is None and given.capsule_pitch_moment_slope is None
    assert given.capsule_pitch_damping is not None and given.capsule_inertia_factor_y is not None
