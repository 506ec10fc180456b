"""`bayeschute fit` and `bayeschute predict`: a posterior in one file, asked about the flights of another."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import bayeschute as bc
from bayeschute.api.forecasting import predict_file
from bayeschute.calibration.label import caveat
from bayeschute.cli import app
from bayeschute.study.load import load_flights
from bayeschute.study.schema.study_schema import ConventionsTable

RUN = CliRunner()
FLIGHTS = """
[columns]
time = { column = "time_s", unit = "s" }
altitude = { column = "altitude_m", unit = "m" }
[[flight]]
name = "tomorrow"
file = "high.csv"
rate = "1 Hz"
[[requirement]]
name = "slow enough"
quantity = "descent_rate"
statistic = "maximum"
at_most = "100 m/s"
[[requirement]]
name = "never fast enough"
quantity = "descent_rate"
statistic = "mean"
at_least = "100 m/s"
"""


@pytest.fixture(scope="module")
def stored(descents, tmp_path_factory):
    path = tmp_path_factory.mktemp("stored") / "sondes.posterior.nc"
    made = RUN.invoke(app, ["fit", str(descents.study), "--out", str(path), "--quick"])
    assert made.exit_code == 0, made.output
    assert str(path) in made.output.replace("\n", "")
    return path


@pytest.fixture
def asked(descents):
    path = descents.study.with_name("tomorrow.toml")
    path.write_text(FLIGHTS, encoding="utf-8")
    return path


def test_an_earlier_posterior_is_not_overwritten(stored, descents):
    before = stored.read_bytes()
    made = RUN.invoke(app, ["fit", str(descents.study), "--out", str(stored), "--quick"])
    assert made.exit_code == 2 and "--force" in made.output and stored.read_bytes() == before


def test_flights_of_a_file_are_predicted_and_judged(stored, asked, tmp_path):
    out = tmp_path / "out"
    made = RUN.invoke(app, ["predict", str(stored), str(asked), "--out", str(out), "--draws", "64", "--like", "high"])
    assert made.exit_code == 0, made.output
    rows = json.loads((out / "requirements.json").read_text())
    assert [(row["name"], row["met"]) for row in rows] == [("slow enough", 1.0), ("never fast enough", 0.0)]
    assert all(row["draws"] == 64 and row["low"] <= row["met"] <= row["high"] for row in rows)
    with xr.open_datatree(out / "predictions.nc", engine="h5netcdf") as tree:
        assert list(tree.children) == ["tomorrow"] and "descent_rate" in tree["tomorrow"].data_vars
    assert list(out.glob("bands-tomorrow.*"))
    again = ["predict", str(stored), str(asked), "--out", str(out), "--draws", "16", "--like", "high"]
    refused = RUN.invoke(app, again)
    assert refused.exit_code == 2 and "--force" in refused.output
    assert json.loads((out / "requirements.json").read_text()) == rows
    assert RUN.invoke(app, [*again, "--force"]).exit_code == 0
    assert {row["draws"] for row in json.loads((out / "requirements.json").read_text())} == {16}


def test_another_limit_needs_no_refit(stored, asked, tmp_path):
    lines = predict_file(stored, asked, tmp_path / "a", draws=64, seed=3, like="high")
    assert " m/s (" in lines[0] and " ft/s)" in lines[0]
    known = bc.Posterior.load(stored)  # as Python says it beside every number
    assert lines[-1] == caveat(known.failed_checks, known.trust.words) and "level of trust" in lines[-1]
    asked.write_text(FLIGHTS.replace('"100 m/s"', '"1 m/s"'), encoding="utf-8")
    again = predict_file(stored, asked, tmp_path / "b", draws=64, seed=3, like="high")
    assert lines[:2] == again[:2] and lines[2:] != again[2:]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("[[flight]]", "[[flights]]"), "flights"),
        (('"high.csv"', '"higher.csv"'), "higher.csv"),
        (('unit = "s"', 'unit = "kg"'), "time"),
        (('"descent_rate"', '"descent"'), "one of"),
    ],
)
def test_every_fault_of_a_flight_file_is_told_before_anything_is_drawn(stored, asked, tmp_path, change, words):
    asked.write_text(FLIGHTS.replace(*change), encoding="utf-8")
    with pytest.raises(bc.InputError, match=words):
        predict_file(stored, asked, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_flights_take_columns_and_conventions_of_the_posterior_unless_they_have_their_own(stored, asked):
    study = bc.Posterior.load(stored).spec
    plain = FLIGHTS[FLIGHTS.index("[[flight]]") :]
    asked.write_text(FLIGHTS, encoding="utf-8")
    want = load_flights(asked, study).flights[0]
    asked.write_text(plain, encoding="utf-8")
    assert load_flights(asked, study).flights == (want,)
    meant = ConventionsTable(axes="ENU")
    east = replace(study, flights=tuple(replace(f, conventions=meant) for f in study.flights))
    assert load_flights(asked, east).flights[0].conventions == meant
    asked.write_text(FLIGHTS, encoding="utf-8")  # columns of its own are of axes of its own
    assert load_flights(asked, east).flights[0].conventions is None
    asked.write_text(plain, encoding="utf-8")
    named = plain.replace("high.csv", "high.nc")  # such a file may name its columns
    (asked.parent / "high.nc").write_bytes(b"not opened here")
    asked.write_text(named, encoding="utf-8")
    assert (
        load_flights(asked, east).flights[0].columns == {} and load_flights(asked, east).flights[0].conventions is None
    )
    asked.write_text(plain, encoding="utf-8")
    unlike = replace(east, flights=(study.flights[0], *east.flights[1:]))
    with pytest.raises(bc.InputError, match="the columns of this record"):
        load_flights(asked, unlike)


def test_lost_simulations_are_told_by_python_and_the_shell(stored, asked, tmp_path, monkeypatch):
    from bayeschute.prediction import bands

    honest = bands._simulate

    def lost(flight, *rest):
        found = tuple(np.array(part, dtype=float) for part in honest(flight, *rest))
        for part in found:
            part[..., :2] = np.nan
        return found

    monkeypatch.setattr(bands, "_simulate", lost)
    lines = predict_file(stored, asked, tmp_path / "out", draws=16, like="high")
    words = [line for line in lines if "simulations of tomorrow failed" in line]
    assert words and words[0].endswith("its bands are of the others") and "bands" in lines[-1]


def test_a_name_is_no_flight_and_a_probability_has_one_limit(stored, descents):
    known, flight = bc.Posterior.load(stored), bc.Study.load(descents.study).flights["high"]
    with pytest.raises(bc.InputError, match="flight: got 'high'; wanted a Flight.*study.flights"):
        known.predict("high")
    forecast = known.predict(flight, draws=16)
    with pytest.raises(bc.InputError, match="probability of descent_rate: got no limit; wanted at_most or at_least"):
        forecast.probability("descent_rate")
    with pytest.raises(bc.InputError, match="got at_most='9 m/s' and at_least=1.0"):
        forecast.probability("descent_rate", at_most="9 m/s", at_least=1.0)


def test_flights_take_the_vehicle_of_the_study_unless_they_have_their_own(tmp_path):
    study = bc.Study.example().spec
    path = tmp_path / "drop.toml"
    text = """
    [[flight]]
    name = "next"
    capsule_mass = "9000 kg"
    [flight.virtual]
    duration = "20 s"
    rate = "10 Hz"
    altitude = "2000 m"
    swing = "10 deg"
    swing_azimuth = "0 deg"
    swing_rate = "0 deg/s"
    flyout = "8 deg"
    flyout_azimuth = "90 deg"
    wind = { altitude = ["0 m", "3000 m"], north = ["2 m/s", "5 m/s"], east = ["0 m/s", "0 m/s"] }
    sensors = {}
    """
    path.write_text(text, encoding="utf-8")
    found = load_flights(path, study)
    assert found.flights[0].capsule_mass == 9000.0 and found.flights[0].roles == ("predict",)
    assert found.vehicle == study.vehicle and found.requirements == ()


def test_a_posterior_with_failed_checks_is_told_by_the_shell_too(stored, asked, tmp_path):
    """As by Python and the report: numbers that are handed on alone must say that they have no level of trust."""
    known = bc.Posterior.load(stored)
    checks = json.loads(known.files["checks.json"])
    for passed in (True, False):
        for name, one in checks["checks"].items():
            one["passed"] = passed or name != "rhat"
        made = replace(known, files={**known.files, "checks.json": json.dumps(checks).encode()})
        path = made.save(tmp_path / f"{passed}.posterior.nc")
        told = RUN.invoke(
            app,
            ["predict", str(path), str(asked), "--out", str(tmp_path / f"{passed}"), "--draws", "16", "--like", "high"],
        )
        assert told.exit_code == 0, told.output
        assert ("no level of trust, failed checks: rhat" in told.output) is not passed
