"""Recalibration: asked for only where replicates tell how, said in the results, and nothing to studies without it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from bayeschute.calibration.recalibration import FACTORS
from bayeschute.core.errors import InputError
from bayeschute.prediction.bands import Prediction
from bayeschute.study.calibrate import calibrate
from bayeschute.study.evidence.calibration_status import replicates_lacking
from bayeschute.study.evidence.identity import Stored, configuration
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.evidence.recalibrate import NAME, Widening, applied_recalibration, plain, widening
from bayeschute.study.job import Job
from bayeschute.study.load import load_study
from bayeschute.study.run import stage_list
from bayeschute.study.run.forecasts import FlightForecast, widened

PATH = Path(__file__).parents[3] / "models/studies/cdt-3-11.toml"
STUDY = load_study(PATH)
ASKED = replace(STUDY, predict=STUDY.predict.model_copy(update={"recalibrate": "replicates"}))
BY = Widening({"swing_angle": 1.5}, 120)


@pytest.fixture
def job(tmp_path, monkeypatch):
    for module in ("calibration_status", "recalibrate"):
        monkeypatch.setattr(f"bayeschute.study.evidence.{module}.places", lambda job: [tmp_path / "calibration"])

    def made(study=ASKED, replicates=100, share=0.92, quick=False, keeps=True):
        kept = {"scaled": [share if f >= 1.1 else 0.5 for f in FACTORS]} if keeps else {}
        bands = {f"new/{q}": {"role": "predict"} | kept for q in STUDY.predict.quantities}
        result = {"hash": configuration(STUDY), "disturbance": "none", "replicates": replicates, "bands": bands}
        result |= {"numerics": numerics(), "coverage": {}}
        (tmp_path / "calibration").mkdir(exist_ok=True)
        (tmp_path / "calibration/latent.none.json").write_text(json.dumps(result))
        return SimpleNamespace(
            study=study, out=tmp_path, quick=quick, load=lambda name: json.loads((tmp_path / name).read_text())
        )

    return made


def test_a_study_without_it_is_the_study_it_was(job):
    assert widening(job(STUDY)) is None and widening(job(quick=True)) is None
    assert configuration(plain(ASKED)) == configuration(STUDY) != configuration(ASKED)


def test_factors_come_from_replicates_of_the_same_configuration(job):
    by = widening(job())
    assert by is not None and by.replicates == 100
    assert by.factors == dict.fromkeys(STUDY.predict.quantities, 1.1)
    assert "swing angle widened by 1.10" in by.words and by.words.endswith("learned on 100 replicates")


@pytest.mark.parametrize(
    ("given", "says"),
    [({"replicates": 99}, "99 replicates are stored"), ({"share": 0.8}, "no factor up to 2"),
     ({"keeps": False}, "rows are of an older version")],
)  # fmt: skip
def test_what_is_not_known_is_refused(job, given, says):
    with pytest.raises(InputError, match=says):
        widening(job(**given))


def test_no_calibration_is_refused(job, tmp_path):
    made = job()
    (tmp_path / "calibration/latent.none.json").unlink()
    with pytest.raises(InputError, match="none is stored"):
        widening(made)


def test_draws_move_away_from_their_median_in_flights_unseen():
    draws = np.random.default_rng(1).normal(size=(50, 4))
    draws[3] = np.nan
    whole = Prediction(np.arange(4.0), {"swing_angle": draws, "other": draws}, np.zeros((50, 3)), 1, {})
    one = FlightForecast(None, None, whole, np.arange(4.0), np.arange(4) > 1, None, None, 1)
    made = widened(one, BY).prediction.draws
    before, after = (np.nanquantile(d, [0.05, 0.5, 0.95], axis=0) for d in (draws, made["swing_angle"]))
    np.testing.assert_allclose(after[1], before[1])
    np.testing.assert_allclose(after[2] - after[0], 1.5 * (before[2] - before[0]))
    assert made["other"] is draws and np.isnan(made["swing_angle"][3]).all()
    assert widened(one, None) is one and not one.widened_by and widened(one, BY).widened_by == BY.factors
    fitted = replace(one, held_out=np.zeros(4, bool))
    assert widened(fitted, BY) is fitted


def test_a_run_says_so_and_has_no_level(job, tmp_path):
    made = job()
    (tmp_path / NAME).write_text(json.dumps(BY._asdict()))
    assert applied_recalibration(made) == BY
    (words,) = replicates_lacking(made, Stored({}, {}))
    assert "swing angle widened by 1.50" in words and "120" in words and "was not tested" in words


def test_replicates_of_a_recalibrated_study_are_refused(tmp_path):
    text = PATH.read_text(encoding="utf-8").replace("../vehicles", str(PATH.parents[1] / "vehicles"))
    text = text.replace("[predict]", '[predict]\nrecalibrate = "replicates"')
    assert "recalibrate" in text
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="recalibration learns from these replicates"):
        calibrate(tmp_path / "study.toml", tmp_path / "out", 4)


def _statistics_are_of_the_widened_draws(plain_folder, folder, summary, factors):
    """Draws at the end of the record lie as much farther from their median as the bands do; so P(met) is of these."""
    before, after = (pd.read_parquet(f / "risk/end_of_record.parquet") for f in (plain_folder, folder))
    for (_, was), (_, now) in zip(before.groupby("run"), after.groupby("run"), strict=True):
        for name, factor in factors.items():
            spread = was[name] - was[name].median()
            np.testing.assert_allclose(now[name] - now[name].median(), factor * spread, atol=1e-9)
    as_found = json.loads((plain_folder / "risk/requirements.json").read_text(encoding="utf-8"))
    assert {row["widened_by"] for row in as_found} == {1.0}
    table = pd.read_csv(folder / "risk/exceedance.csv")
    for name, part in table.groupby("quantity"):
        assert set(part.widened_by) == {factors.get(name, 1.0)}
    for row in summary["requirements"]:
        final = after[after.run == row["run"]][row["quantity"]]
        assert row["statistic"] == "final" and row["widened_by"] == factors[row["quantity"]]
        assert row["probability_met"] == pytest.approx(float((final <= row["at_most"]).mean()))
    text = (folder / "report.html").read_text(encoding="utf-8")
    assert "Draws of low and high are recalibrated as their bands are" in text


def test_bands_of_a_run_are_widened_and_its_summary_says_so(finished, descents, tmp_path):
    """The last stages anew on a finished run, a calibration of its configuration made up beside it."""
    plain_study = load_study(descents.study)
    asked = replace(plain_study, predict=plain_study.predict.model_copy(update={"recalibrate": "replicates"}))
    folder = Path(shutil.copytree(finished.folder, tmp_path / "run"))
    factors = {"descent_rate": 1.2, "sea_level_descent_rate": 0.9}
    bands = {
        f"a/{name}": {"role": "predict", "scaled": [float(f >= least) for f in FACTORS]}
        for name, least in factors.items()
    }
    shares = dict.fromkeys(bands, 0.8)
    result = {"hash": configuration(plain_study), "numerics": numerics(), "disturbance": "none", "replicates": 100}
    result |= {"bands": bands, "coverage": shares, "standard_error": dict.fromkeys(bands, 0.01)}
    result |= {"failed": {}, "parameters": {}}
    (folder / "calibration").mkdir()
    (folder / "calibration/made-up.json").write_text(json.dumps(result))
    job = Job(asked, folder, False, "", lambda *_: None)
    stage_list.predict(job)
    stage_list.risk(job)
    stage_list.report(job)
    before, after = (xr.open_datatree(f / "predictions.nc", engine="h5netcdf") for f in (finished.folder, folder))
    for name in ("low", "high"):
        was, now = (tree[name]["descent_rate"].values for tree in (before, after))
        np.testing.assert_allclose(now - now[2], 1.2 * (was - was[2]), atol=1e-9)
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["recalibration"] == {"factors": factors, "replicates": 100, "flights": ["low", "high"]}
    _statistics_are_of_the_widened_draws(finished.folder, folder, summary, factors)
    assert "descent rate widened by 1.20" in summary["label"] and summary["claim"]["rank"] == 0
    assert any("Bands of predicted flights are recalibrated" in note for note in summary["notes"])
    assert "descent rate widened by 1.20" in (folder / "report.html").read_text(encoding="utf-8")
    stage_list.predict(replace(job, study=plain_study))
    assert not (folder / NAME).exists()
