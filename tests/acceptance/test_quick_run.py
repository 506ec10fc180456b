"""The whole way: records in; posterior, bands, risk numbers and a report out."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

from bayeschute.cli import app
from bayeschute.posterior.assess import flight_groups
from bayeschute.records.record import load_record

ROOT = Path(__file__).parents[2]
ARTEFACT_VERSION = """
study.toml flights/low.nc flights/high.nc structure.json posterior.nc predictions.nc summary.json report.html
risk/draws.parquet risk/draws.csv risk/marginals.csv risk/correlation.csv risk/end_of_record.parquet risk/exceedance.csv
risk/tolerance.csv risk/requirements.json risk/data_dictionary.csv figures/bands-low.png figures/bands-low.svg
""".split()  # what the design says a run leaves


def _numbers(value: object) -> list[float]:
    """Every number of a nested table."""
    if isinstance(value, dict):
        return [n for v in value.values() for n in _numbers(v)]
    if isinstance(value, list):
        return [n for v in value for n in _numbers(v)]
    return [value] if isinstance(value, (int, float)) and not isinstance(value, bool) else []


def test_a_run_leaves_what_the_design_says(finished):
    missing = [name for name in ARTEFACT_VERSION if not (finished.folder / name).is_file()]
    assert missing == []
    assert not list(finished.folder.rglob(".*.part*")), "files that were written aside are left"


def test_the_true_drag_is_inside_a_sane_interval(finished, descents):
    for name, truth in descents.truth.items():
        found = finished.summary["parameters"][f"cds_over_mass[{name}]"]
        assert found["unit"] == "m^2/kg"
        assert abs(found["mean"] - truth) < 4.0 * found["sd"]
        assert found["q05"] < found["q50"] < found["q95"]
        assert 0.005 < found["sd"] / truth < 0.2  # gusts of 0.4 m/s that last 30 s, for 52 s at 12 m/s
        assert found["contraction"] > 0.9


def test_several_drops_have_a_population(finished, descents):
    found = finished.summary["parameters"]["population_mean"]
    middle = np.mean(np.log(list(descents.truth.values())))
    assert abs(found["mean"] - middle) < 4.0 * found["sd"]
    assert found["sd"] > finished.summary["parameters"]["cds_over_mass[low]"]["sd"]


def test_the_summary_holds_numbers_where_numbers_belong(finished):
    summary = finished.summary
    assert summary == json.loads((finished.folder / "summary.json").read_text(encoding="utf-8"))
    assert {"parameters", "sampling", "coverage", "checks", "versions", "seed", "hashes", "label"} <= set(summary)
    noise = summary["noise"]
    assert set(noise) == {"descent_rate", "wind, vertical"}
    assert all(isinstance(noise["descent_rate"][key], float) for key in ("white", "correlated", "time_constant"))
    assert all(isinstance(noise["wind, vertical"][key], float) for key in ("correlated", "time_constant"))
    assert min(_numbers(noise)) > 0.0
    assert summary["sampling"]["chains"] == 2 and summary["sampling"]["draws"] == 100
    assert summary["sampling"]["failed_solves"] == 0
    for check in ("optimum", "failed_solves", "step_error", "log_determinant"):
        assert summary["checks"][check]["passed"], summary["checks"][check]
    assert summary["claim"]["rank"] == 0 and summary["claim"]["level"] == "not checked"


def test_the_posterior_has_every_group(finished):
    with xr.open_datatree(finished.folder / "posterior.nc", engine="h5netcdf") as tree:
        groups = {"posterior", "conditional", "prior", "log_prior", *flight_groups.GROUPS}
        assert groups <= set(tree.children)
        names = {"cds_over_mass[low]", "cds_over_mass[high]", "population_mean", "population_sd"}
        assert set(map(str, tree["posterior"].data_vars)) == names == set(map(str, tree["prior"].data_vars))
        assert dict(tree["posterior"].sizes) == {"chain": 2, "draw": 100}
        assert tree["posterior"]["cds_over_mass[low]"].attrs["units"] == "m^2/kg"
        diverged = float(tree["sample_stats"]["population_diverging"].mean())
    check = finished.summary["checks"]["divergences"]
    assert check["value"] == diverged and check["passed"]


def test_bands_cover_the_part_that_was_held_out(finished):
    with xr.open_datatree(finished.folder / "predictions.nc", engine="h5netcdf") as tree:
        assert set(tree.children) == {"low", "high"}
        for name in tree.children:
            bands = tree[name].to_dataset().load()
            assert list(bands["quantile"].values) == [0.05, 0.25, 0.5, 0.75, 0.95]
            for quantity in ("descent_rate", "sea_level_descent_rate"):
                assert bands[quantity].dims == ("quantile", "time")
                assert bands[quantity].attrs["units"] == bands[f"{quantity}_draws"].attrs["units"] == "m/s"
                drawn = bands[f"{quantity}_draws"].quantile([0.05, 0.5, 0.95], "draw").values
                np.testing.assert_allclose(drawn, bands[quantity][::2], atol=1e-4)  # none is left out of so few
                assert (np.diff(bands[quantity].values, axis=0) >= 0.0).all()
            held_out = bands["held_out"].values
            assert 0.30 < held_out.mean() < 0.40 and held_out[-1] and not held_out[0]
            width = (bands["descent_rate"][-1] - bands["descent_rate"][0]).values
            assert width[held_out].mean() > width[~held_out].mean()
            shares = bands["variance_share"].sum("source")
            np.testing.assert_allclose(shares, 1.0, atol=1e-9)
            assert finished.summary["coverage"][name]["descent_rate"]["record"] >= 0.7  # 28 correlated samples


def test_ingested_records_list_what_was_done(finished):
    record = load_record(finished.folder / "flights" / "low.nc")
    assert {"altitude", "descent_rate", "density"} <= set(record.data_vars)
    assert [r["kind"] for r in finished.summary["flights"]["low"]["repairs"]].count("derived") == 2


def test_risk_files_agree_with_the_posterior(finished):
    risk = finished.folder / "risk"
    draws = pd.read_parquet(risk / "draws.parquet")
    assert len(draws) == 200
    written = pd.read_csv(risk / "draws.csv")
    np.testing.assert_allclose(written["cds_over_mass[low]"], draws["cds_over_mass[low]"], rtol=1e-9)
    mean = finished.summary["parameters"]["cds_over_mass[low]"]["mean"]
    assert draws["cds_over_mass[low]"].mean() == pytest.approx(mean)
    rows = finished.summary["requirements"]
    assert {(row["name"], row["run"]) for row in rows} == {("speed at the end", "low"), ("speed at the end", "high")}
    assert all(row["simulation_low"] <= row["probability_met"] <= row["simulation_high"] for row in rows)
    assert all(row["failed"] == 0 for row in rows)


def test_the_report_needs_no_network(finished):
    text = (finished.folder / "report.html").read_text(encoding="utf-8")
    assert "Two made-up sondes" in text
    assert not re.search(r'(src|href)="(https?:)?//', text)


def test_the_shell_comes_to_the_same(finished, descents):
    arguments = ["run", str(descents.study), "--out", str(finished.folder), "--resume"]
    result = CliRunner().invoke(app, arguments)
    missed = [name for name, check in finished.summary["checks"].items() if check["passed"] is False]
    assert result.exit_code == (1 if missed else 0), result.output
    assert f"Report: {finished.folder / 'report.html'}" in result.stdout
    assert all(name in result.stderr for name in missed)


@pytest.mark.slow
def test_the_default_study_runs_quickly_from_end_to_end(tmp_path: Path):
    study = ROOT / "models/studies/cdt-3-11.toml"
    result = CliRunner().invoke(app, ["run", str(study), "--out", str(tmp_path / "run"), "--quick"])
    assert result.exit_code == 0, result.output
    assert "the results are not for use" in result.stdout
    summary = json.loads((tmp_path / "run/summary.json").read_text(encoding="utf-8"))
    assert summary["quick"] is True
    assert {"riser_length", "riser_stiffness", "riser_damping", "axial[1]"} <= set(summary["parameters"])
    for name, found in summary["parameters"].items():
        assert np.isfinite([found["mean"], found["sd"], found["truth"]]).all(), name
        assert abs(found["mean"] - found["truth"]) < 6.0 * found["sd"], name
    assert set(summary["coverage"]) == {"cdt-3-11", "cdt-3-12"}
    assert {"swing_angle", "descent_rate"} <= set(summary["coverage"]["cdt-3-12"])
    assert summary["checks"]["optimum"]["passed"]
    tested = {row["what"]: row for row in summary["predictive"]["errors"]}
    assert {"the mass of the capsule", "the recorded wind north", "the clock of the attitude"} <= set(tested)
    assert all(row["se"] > 0.0 and abs(row["estimate"]) < 5.0 * row["se"] for row in tested.values()), tested
    report = (tmp_path / "run/report.html").read_text(encoding="utf-8")
    assert "the axial force of canopy 1 relative to the others" in report
    with xr.open_datatree(tmp_path / "run/posterior.nc", engine="h5netcdf") as tree:
        total = tree["log_likelihood"]["cdt-3-11"].sum("time_cdt-3-11") + sum(tree["log_prior"].ds.data_vars.values())
        apart = (total - tree["sample_stats"]["lp"]).values
        np.testing.assert_allclose(apart, apart[0, 0], rtol=1e-8)
        assert tree["log_likelihood"].attrs["lp_error"] < 1e-8 * abs(apart[0, 0])
        seen = tree["posterior_predictive"]["cdt-3-11"]
        assert seen.dims == ("chain", "draw", "time_cdt-3-11", "channel") and "capsule_velocity.down" in seen["channel"]
        assert 0.0 <= tree["prior_predictive"]["cdt-3-11"].attrs["failed"] < 0.5
    with xr.open_datatree(tmp_path / "run/predictions.nc", engine="h5netcdf") as tree:
        assert tree["cdt-3-12"]["swing_angle_draws"].dims == ("draw", "time")


@pytest.mark.slow
def test_drops_that_vary_are_joined_and_foretell_another_one(tmp_path: Path):
    head, drop, predicted = (ROOT / "models/studies/cdt-3-11.toml").read_text(encoding="utf-8").split("[[flight]]")
    other = (
        drop.replace("cdt-3-11", "second")
        .replace('["structure", "identify"]', '["identify"]')
        .replace("17 deg", "13 deg")
    )
    text = "[[flight]]".join([head, drop, other, predicted]).replace("../vehicles", str(ROOT / "models/vehicles"))
    text = text.replace("inflation = 10.0", 'vary = ["axial[1]", "riser_length"]\ninflation = 10.0')
    (tmp_path / "drops.toml").write_text(text, encoding="utf-8")
    CliRunner().invoke(app, ["run", str(tmp_path / "drops.toml"), "--out", str(tmp_path / "run"), "--quick"])
    summary = json.loads((tmp_path / "run/summary.json").read_text(encoding="utf-8"))
    found = summary["parameters"]
    for name in ("axial[1]", "riser_length"):
        own = [found[f"{name}@{flight}"] for flight in ("cdt-3-11", "second")]
        assert all(one["sd"] < found[name]["sd"] for one in own), "two drops tell more of themselves than of others"
        assert found[f"sd({name})"]["q05"] > 0.0
    assert summary["checks"]["optimum"]["passed"]
    assert set(summary["coverage"]) == {"cdt-3-11", "second", "cdt-3-12"}
    assert set(summary["identifiability"]) == {"cdt-3-11", "second"}
    assert "fitted separately and joined" in " ".join(summary["notes"])
    with xr.open_datatree(tmp_path / "run/predictions.nc", engine="h5netcdf") as tree:
        assert np.isfinite(tree["cdt-3-12"]["swing_angle"]).all()


@pytest.mark.slow
def test_canopies_that_vary_have_coefficients_of_their_own(tmp_path: Path):
    """Two canopies of drag an eighth apart are told apart, and told from their population."""
    text = (ROOT / "models/studies/cdt-3-11.toml").read_text(encoding="utf-8")
    text = text.replace("../vehicles", str(ROOT / "models/vehicles"))
    text = text.replace(
        "inflation = 10.0", 'vary_canopies = ["axial[1]"]\nspread = { "axial[1]" = 0.3 }\ninflation = 10.0'
    )
    text = text.replace('flyout = "9 deg"', 'canopy_sd = { "axial[1]" = 0.3 }\nflyout = "9 deg"')
    (tmp_path / "canopies.toml").write_text(text, encoding="utf-8")
    CliRunner().invoke(app, ["run", str(tmp_path / "canopies.toml"), "--out", str(tmp_path / "run"), "--quick"])
    summary = json.loads((tmp_path / "run/summary.json").read_text(encoding="utf-8"))
    found = summary["parameters"]
    first, second = (found[f"axial[1]@cdt-3-11.canopy{i}"] for i in (1, 2))
    apart = first["truth"] - second["truth"]
    assert abs(apart) > 0.1, "the seed's canopies differ"
    assert first["mean"] - second["mean"] == pytest.approx(apart, abs=0.4 * abs(apart))
    for one in (first, second):
        assert abs(one["mean"] - one["truth"]) < 4.0 * one["sd"] and one["sd"] < found["axial[1]"]["sd"]
    assert found["sd(axial[1])"]["truth"] == 0.3 and found["sd(axial[1])"]["q05"] > 0.01
    assert summary["checks"]["optimum"]["passed"] and set(summary["coverage"]) == {"cdt-3-11", "cdt-3-12"}
    assert "Hierarchical model over canopies for axial[1]" in " ".join(summary["notes"])
    with xr.open_datatree(tmp_path / "run/predictions.nc", engine="h5netcdf") as tree:
        assert np.isfinite(tree["cdt-3-12"]["swing_angle"]).all()
