"""`check`, `run` and `fit` refuse a record that can't be true, name the cause, and let a study accept it."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from other_studies import toml
from typer.testing import CliRunner

import bayeschute as bc
from bayeschute.cli import app
from bayeschute.records.record import write_record
from bayeschute.study.load import examine_study, load_study
from bayeschute.study.plausible import judge, refuse_implausible, usual_noise
from bayeschute.study.schema.reading.strict import part_of
from bayeschute.study.schema.vehicle_schema import Vehicle
from bayeschute.study.templates import template


@pytest.fixture(scope="module")
def flown():
    return bc.Study.example().flights[0].record


@pytest.fixture
def study(flown, tmp_path):
    """A study of a record in a file, with a change made on the record and lines added to its flight."""

    def make(spoil=None, **more) -> Path:
        record = flown.copy(deep=True)
        if spoil is not None:
            spoil(record)
        write_record(record, tmp_path / "drop.nc")
        (tmp_path / "vehicle.toml").write_text(template("vehicle.toml").read_text(encoding="utf-8"), encoding="utf-8")
        tables = tomllib.loads(template("virtual.toml").read_text(encoding="utf-8"))
        flight = {"name": "drop", "roles": ["structure", "identify"], "file": "drop.nc", **more}
        path = tmp_path / "study.toml"
        path.write_text(toml({**tables, "flight": [flight], "vehicle": "vehicle.toml"}), encoding="utf-8")
        return path

    return make


def _scalar_last(record) -> None:
    record["capsule_attitude"].values = record["capsule_attitude"].values[:, [1, 2, 3, 0]]


def test_a_sound_record_passes(study):
    found = examine_study(study())
    assert found.faults == [] and len(found.verdicts["drop"].readings) > 25
    (only,) = found.warnings  # the study of virtual flights, told of a record
    assert "apparent mass of a canopy" in only and "is taken as known" in only
    said = found.said["drop"]
    assert (
        "at 10 Hz; fitted: canopy_position, capsule_velocity" in said and "laws tried, the nearest to its limit" in said
    )
    assert "read, not fitted: capsule_rate" in said


def test_a_jump_of_a_fitted_channel_s_level_is_told(study):
    """Within the window, in a channel that is fitted; no law is broken by two metres."""

    def jump(record) -> None:
        values = record["canopy_position"].values
        values[record["time"].values > 60.0, 1] += [2.0, 0.0, 0.0]

    found = examine_study(study(jump))
    (said,) = [line for line in found.warnings if "level shifts" in line]
    assert found.faults == [] and "flight 'drop', canopy_position.2 at 59.9 s: level shifts by +2" in said
    assert "not corrected" in said and "leave the channel out of [noise]" in said
    assert not any("level shifts" in line for line in examine_study(study(jump, window=["5 s", "50 s"])).warnings)
    flight = bc.Study.load(study(jump)).flights[0]
    assert any("canopy_position.2 at 59.9 s" in line for line in flight.plausibility().noise)
    others = flight.study.noise.model_copy(update={"canopy_position": None})
    assert not any("level shifts" in line for line in flight.plausibility(others).noise)


def test_check_run_and_fit_refuse_and_name_the_cause(study, tmp_path):
    path = study(_scalar_last)
    for command in (["check"], ["run", "--out", str(tmp_path / "run")], ["fit", "--out", str(tmp_path / "p.nc")]):
        done = CliRunner().invoke(app, [command[0], str(path), *command[1:]])
        assert done.exit_code == 2 and "scalar-last" in done.output, done.output
        assert not (tmp_path / "run").exists() and not (tmp_path / "p.nc").exists()
    flight = bc.Study.load(path).flights[0]
    with pytest.raises(bc.InputError, match="scalar-last"):
        bc.fit(flight)
    looked = flight.plausibility()
    assert not looked.ok and "scalar-last" in looked.causes[0] and "scalar-last" in repr(looked)
    assert "scalar-last" in looked._repr_html_() and (looked.table["severity"] == "fault").sum() == len(
        looked.verdict.faults
    )
    assert len(looked.plot().axes) > 5


def test_a_misspelled_frame_is_not_blamed_on_the_record(study):
    """Points in body axes, of a frame that is not valid: nothing is known of the attach point."""
    path = study()
    vehicle = path.with_name("vehicle.toml")
    body = re.sub(
        r"^(centre_of_mass|reference_centre|attach_point) = \[.*?\]",
        lambda line: f'{line[1]} = ["{1.9 if line[1] == "attach_point" else 0.0} m", "0 m", "0 m"]',
        vehicle.read_text(encoding="utf-8"),
        flags=re.M,
    )
    for frame, wanted in (("body", 0), ("bodyy", 1)):
        vehicle.write_text(body.replace("[capsule]", f'[capsule]\npoints_in = "{frame}"'), encoding="utf-8")
        faults = [str(fault) for fault in examine_study(path).faults]
        assert len(faults) == wanted and all("points_in: got 'bodyy'" in fault for fault in faults), faults


def test_a_study_may_accept_it(study):
    broken = sorted({one.law.split(".")[0] for one in examine_study(study(_scalar_last)).verdicts["drop"].faults})
    path = study(_scalar_last, accept_implausible=broken)
    found = examine_study(path)
    assert found.faults == [] and any("accepted" in line for line in found.warnings)
    assert bc.Study.load(path).flights[0].plausibility().ok
    faults = examine_study(study(accept_implausible=["winds"])).faults
    assert len(faults) == 1 and "'winds'" in str(faults[0])


def test_the_report_draws_the_record(study, tmp_path):
    page = tmp_path / "records.html"
    done = CliRunner().invoke(app, ["check", str(study(_scalar_last)), "--report", str(page)])
    text = page.read_text(encoding="utf-8")
    assert done.exit_code == 2 and "scalar-last" in text and "data:image/svg+xml," in text
    assert "http://" not in text.split("<img")[0]


def test_columns_and_conventions_of_a_study(flown, tmp_path, study):
    import pandas as pd

    p, v, c = (flown[f"{name}"].values for name in ("capsule_position", "capsule_velocity", "canopy_position"))
    w = flown["wind"].values
    q = flown["capsule_attitude"].values
    table = {"t": flown["time"].values, "rho": flown["density"].values}
    columns = {"time": ("t", "s"), "density": ("rho", "kg/m^3")}
    for name, values in (("capsule_position", p), ("capsule_velocity", v), ("canopy_position.1", c[:, 0]),
                         ("canopy_position.2", c[:, 1]), ("wind", -w)):  # fmt: skip
        for axis, column in (("east", values[:, 1]), ("north", values[:, 0]), ("up", -values[:, 2])):
            if (name, axis) != ("wind", "up"):
                table[f"{name}_{axis}"] = column
                columns[f"{name}.{axis}"] = (f"{name}_{axis}", "m/s" if name in ("capsule_velocity", "wind") else "m")
    table |= {f"q{i}": x for i, x in enumerate(q.T)}
    columns |= {f"capsule_attitude.{part}": (f"q{i}", "1") for i, part in enumerate("wxyz")}
    pd.DataFrame(table).to_csv(tmp_path / "drop.csv", index=False)
    written = {name: {"column": column, "unit": unit} for name, (column, unit) in columns.items()}
    said = {"wind_is": "from"}
    path = study(file="drop.csv", columns=written, conventions=said)
    assert examine_study(path).faults == []
    faults = examine_study(study(file="drop.csv", columns=written)).faults
    assert any('wind is "from"' in str(fault) for fault in faults)
    faults = examine_study(study(file="drop.csv", columns=written, conventions={"axes": "NEE"})).faults
    assert len(faults) == 1 and "conventions] axes" in faults[0].where


def test_a_record_whose_scatter_the_study_did_not_expect_is_told(study):
    """A fit begins at the study's noise: far from the record's it may take noise for motion."""
    sound = study()
    text = sound.read_text(encoding="utf-8")
    table = tomllib.loads(text)["noise"]["capsule_velocity"]
    assert table["white"] == "0.06 m/s"
    sound.write_text(text.replace('white = "0.06 m/s"', 'white = "0.6 m/s"', 1), encoding="utf-8")
    found = examine_study(sound)
    (line,) = [one for one in found.warnings if "scatter" in one]
    assert found.faults == [] and "scatter of capsule_velocity from sample to sample: got 0.06" in line
    assert "[noise] says, white = 0.6 m/s. Say white = '0.06" in line


def test_a_run_is_warned_of_the_noise_of_flights_that_it_fits(study, flown):
    """Of those that it only predicts it needs none."""
    sound = study()
    text = sound.read_text(encoding="utf-8").replace('white = "0.06 m/s"', 'white = "0.6 m/s"', 1)
    sound.write_text(text, encoding="utf-8")
    found = load_study(sound)
    (flight,) = found.flights
    lines = refuse_implausible(found, flight, flown)
    assert [one for one in lines if "scatter of capsule_velocity" in one]
    assert refuse_implausible(found, replace(flight, roles=("predict",)), flown) == [
        one for one in lines if "scatter" not in one and "apparent mass" not in one
    ]


def test_plausibility_tells_the_noise_as_check_does(study, flown):
    """Of a study's flight against its noise, of another against the one that is given, else what the record shows."""
    path = study()
    text = path.read_text(encoding="utf-8")
    assert bc.Study.load(path).flights[0].plausibility().noise == ()
    path.write_text(text.replace('white = "0.06 m/s"', 'white = "0.6 m/s"', 1), encoding="utf-8")
    flight = bc.Study.load(path).flights[0]
    looked = flight.plausibility()
    (line,) = looked.noise
    assert line in "".join(examine_study(path).warnings) and "Say white = '0.06" in repr(looked) and looked.ok
    assert line.split(": got")[0] in looked._repr_html_()
    assert flight.changed(roles=("predict",)).plausibility().noise == ()  # nothing is fitted to it
    alone = bc.Flight(flown, flight.vehicle)
    (shown,) = alone.plausibility().noise
    assert "capsule_attitude white = '0.1" in shown and "capsule_velocity white = '0.06" in shown
    table = {"white": "2 deg", "correlated": "0.1 deg", "time_constant": "2 s"}
    wind = {"horizontal": "1 m/s", "vertical": "0.3 m/s", "time_constant": "2 s"}
    (told,) = alone.plausibility(bc.noise({"capsule_attitude": table, "wind": wind})).noise
    assert told.startswith("scatter of capsule_attitude") and "Say white = '0.1" in told and "flight" not in told


def test_noise_is_as_large_as_the_record_shows_and_as_fast_as_the_canopies_breathe(study, flown):
    """Whatever the study had stated: the record was flown with 0.15 m, 0.06 m/s and 0.1 deg; the rest stays."""
    flight = bc.Flight(flown, bc.Study.load(study()).vehicle)
    stated = flight.study.noise
    made, canopies = flight.usual_noise(), flight.vehicle.canopies
    for name, white in (("canopy_position", 0.15), ("capsule_velocity", 0.06), ("capsule_attitude", np.deg2rad(0.1))):
        found, usual = getattr(made, name), getattr(stated, name)
        assert found.white == pytest.approx(white, rel=0.1)
        assert found.correlated / found.white == pytest.approx(usual.correlated / usual.white)
        assert (found.time_constant, found.kind) == (usual.time_constant, usual.kind)
    assert made.breathing.frequency == pytest.approx(0.9 * canopies.reference_speed / canopies.reference_length)
    assert made.model_copy(update=dict.fromkeys(made.channels()) | {"breathing": None}) == stated.model_copy(
        update=dict.fromkeys(stated.channels()) | {"breathing": None}
    )
    assert flight.plausibility(made).noise == ()
    loud = flown.assign(capsule_velocity=20.0 * flown["capsule_velocity"])
    assert bc.Flight(loud, flight.vehicle).usual_noise().capsule_velocity.white == pytest.approx(1.2, rel=0.1)
    blind = usual_noise(flown.drop_vars("canopy_position"), stated, None)
    assert blind.canopy_position == stated.canopy_position and blind.breathing == stated.breathing


def test_breathing_far_from_what_canopies_of_their_size_do_is_told(study):
    """It is sought within a factor of two of what the study says, so a small canopy's would never be found."""
    sound = study()
    assert not [one for one in examine_study(sound).warnings if "breathing" in one]
    text = sound.read_text(encoding="utf-8")
    assert 'frequency = "0.25 Hz"' in text
    sound.write_text(text.replace('frequency = "0.25 Hz"', 'frequency = "1.5 Hz"'), encoding="utf-8")
    (line,) = [one for one in examine_study(sound).warnings if "breathing" in one]
    assert "got 1.5 Hz in [noise.breathing]; usual is 0.9 times" in line and "Say frequency = '0.25 Hz'" in line


def test_faults_of_study_vehicle_and_record_are_told_at_once(study):
    """Those between values, and those of the record by the laws, beside those of single values."""
    path = study(_scalar_last, accept_implausible=["winds"], window=["60 s", "20 s"])
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("[noise.wind]", "[noise.winds]"), encoding="utf-8")
    file = path.parent / "vehicle.toml"
    text = file.read_text(encoding="utf-8")
    for before, after in (
        ('mass = "648.44 slug"', "mass = 9463"),  # a single value
        ('["25000 kg m^2", ', '["-25000 kg m^2", '),
        ("number = 2", "nummer = 2"),
        ('# engagement = "0.04 m"', 'engagement = "4 m"'),  # too long whatever the mass? that is not known
        ("roll_damping = -0.1", 'roll_damping = -0.1\ninertia_products = ["0 kg m^2", "90000 kg m^2", "0 kg m^2"]'),
        ('rate = "riser"', 'rate = "airflow"\nweight = 3'),
        ('"rate" = -0.545', '"rate" = -0.545\n"rate*(e.rate)" = 0.1'),
    ):
        assert before in text, before
        text = text.replace(before, after, 1)
    file.write_text(text, encoding="utf-8")
    told = [str(fault) for fault in examine_study(path).faults]
    for words in (
        "[capsule] mass: got a bare number",
        "nummer",
        "weight",
        "'winds'",
        "[noise] winds",
        "inertia, item 1",
    ):
        assert any(words in line for line in told), (words, told)
    assert any("hold the rate once" in line for line in told)  # a rule of a table with an unknown key
    assert not any("engagement of risers" in line for line in told)  # one that asks for the mass
    assert len(told) == len(set(told))


def test_a_record_is_tried_by_what_is_known_of_a_vehicle_with_faults(study):
    path = study(_scalar_last)
    file = path.parent / "vehicle.toml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace('mass = "648.44 slug"', 'mass = "648.44 slugs and a bit"', 1), encoding="utf-8")
    told = [str(fault) for fault in examine_study(path).faults]
    assert len(told) == 2 and "vehicle.toml [capsule] mass" in told[0] and "scalar-last" in told[1]
    file.write_text(text.replace("[capsule]", "[capsule", 1), encoding="utf-8")
    told = [str(fault) for fault in examine_study(path).faults]
    assert "TOML that can't be read" in told[0] and any("scalar-last" in line for line in told[1:])
    file.write_text(text.replace('length = "234 ft"', 'length = "234 m"', 1).replace('name = "', 'nam = "', 1))
    told = [str(fault) for fault in examine_study(path).faults]
    assert any("risers' length is in feet" not in line and "'nam'" in line for line in told)


@pytest.mark.parametrize("gone", ["capsule", "canopies", "risers", "canopies.number", "capsule.attach_point"])
def test_laws_say_nothing_of_what_is_not_known(flown, gone):
    table, _, key = gone.partition(".")
    raw = tomllib.loads(template("vehicle.toml").read_text(encoding="utf-8"))
    if key:
        del raw[table][key]
    else:
        del raw[table]
    found = judge(flown, part_of(Vehicle, raw))
    assert found.findings == () and len(found.readings) > 15


def _by_altitude(study, sign=1.0, of_profile=(), **flight):
    """A study whose wind is known by altitude alone, from a file."""
    aside = np.array([0.0, 1.0, 2.0, 3.0]) * 1000.0
    rows = [f"{height},{sign * 4.0},{-sign * height / 500.0}" for height in aside]
    profile = {"file": "wind.csv", **{k: {"column": c, "unit": u} for k, c, u in
               (("altitude", "h", "m"), ("north", "n", "m/s"), ("east", "e", "m/s"))}, **dict(of_profile)}  # fmt: skip
    path = study(wind_profile={"profile": profile}, **flight)
    (path.parent / "wind.csv").write_text("\n".join(["h,n,e", *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("of_profile", "told"),
    [
        ({"file": "winds.csv"}, "no such file"),
        ({"north": {"column": "north", "unit": "m/s"}}, "no such column among h, n, e"),
        ({"scale": 2.0}, "unknown key 'scale'"),
        ({"wind_is": "fro"}, "got 'fro'; wanted one of 'towards', 'from'"),
    ],
)
def test_faults_of_a_profile_are_told_and_nothing_else(study, of_profile, told):
    (fault,) = examine_study(_by_altitude(study, of_profile=of_profile)).faults
    assert told in str(fault)


def test_a_profile_in_the_study_whose_columns_differ_in_length_is_told(study):
    table = {"altitude": ["0 m", "1 km"], "north": ["1 m/s"], "east": ["0 m/s", "0 m/s"]}
    (fault,) = examine_study(study(wind_profile=table)).faults
    assert "as many winds as altitudes" in str(fault)


def test_a_profile_may_tell_where_its_winds_come_from(study):
    towards = load_study(_by_altitude(study)).flights[0].wind_profile.rows()
    came = load_study(_by_altitude(study, -1.0, {"wind_is": "from"})).flights[0].wind_profile.rows()
    np.testing.assert_array_equal(came, towards)
    assert towards[2].tolist() == [2000.0, 4.0, -4.0, 0.0]
    assert load_study(_by_altitude(study, -1.0)).flights[0].wind_profile.rows()[2].tolist() == [2000.0, -4.0, 4.0, 0.0]


def test_a_convention_of_winds_is_refused_where_no_column_has_one(study, flown, tmp_path):
    import pandas as pd

    pd.DataFrame({"t": flown["time"].values, "h": -flown["capsule_position"].values[:, 2]}).to_csv(
        tmp_path / "drop.csv"
    )
    columns = {"time": {"column": "t", "unit": "s"}, "altitude": {"column": "h", "unit": "m"}}
    path = _by_altitude(study, file="drop.csv", columns=columns, conventions={"wind_is": "from"})
    for faults in (examine_study(path).faults, pytest.raises(bc.InputError, bc.Study.load, path).value.faults):
        told = [str(fault) for fault in faults if "wind_is" in str(fault)]
        assert len(told) == 1 and "Say it in [flight.wind_profile.profile]" in told[0]
