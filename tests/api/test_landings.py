"""The noun `Landings`: tables, files, words, figures; what the verb refuses."""

from __future__ import annotations

import doctest
from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.landing.plans import ROOT, small_plan

import bayeschute as bc
from bayeschute.api.landing.landing_files import dictionary, write_landings
from bayeschute.api.landing.landing_questions import (
    FlownCampaign,
    check_questions,
    drop_ranking,
    rare_failures,
    sensitivity,
    wind_placard,
)
from bayeschute.api.landing.landing_verb import campaign_of, drawn_from, drawn_values, land
from bayeschute.api.landing.landings import in_words
from bayeschute.core.errors import InputError
from bayeschute.landing.aero_table import aero_table
from bayeschute.landing.decisions.onset import placard_table
from bayeschute.landing.measures import MEASURES
from bayeschute.report.figures.landing_figures import design_figure, drivers_figure, placard_figure
from bayeschute.study.load import load_study, usual_study

TABLES = {
    "requirement": [
        {"name": "soft", "limits": [{"quantity": "vertical_speed", "at_most": "12 m/s"}], "probability": 0.5},
        {"name": "upright", "limits": [{"quantity": "hang_angle", "at_most": "30 deg"}], "probability": 0.5},
    ],
    "placard": {"shear": ["0 m/s", "6 m/s"], "capsule_mass": ["9000 kg"], "landings": 64},
}


@pytest.fixture(scope="module")
def flown():
    plan, campaign = small_plan(), campaign_of(None, None, 96, None, 1, **TABLES)
    return FlownCampaign(campaign, plan, land(campaign, plan))


@pytest.fixture(scope="module")
def landings(flown):
    return flown.landings


def test_the_table(landings):
    table = landings.table
    assert table.sizes["landing"] == 96 and table["vertical_speed"].attrs["units"] == "m/s"
    assert set(table["outcome"].values) == {"ok"} and table["label"].dtype.kind == "U"
    assert landings.modes().sum() == pytest.approx(1.0) and landings.failed == 0
    assert "96 with 12 draws" in repr(landings) and landings._repr_html_().count("<tr>") >= 5


def test_the_summary_is_of_landings_that_did_not_fail(landings):
    told = landings.summary(0.8)
    row = told.loc["vertical_speed"]
    ends = np.quantile(landings.rows["vertical_speed"], [0.1, 0.5, 0.9])
    np.testing.assert_allclose(row[["low", "median", "high"]].to_numpy(float), ends)
    assert list(told.index) == list(MEASURES) and row["unit"] == "m/s"
    rows = landings.rows.copy()
    rows["outcome"][:5], rows["vertical_speed"][:5] = 1, np.nan
    some = replace(landings, rows=rows).summary()
    assert some.loc["vertical_speed", "median"] == np.median(rows["vertical_speed"][5:])
    rows["outcome"] = 1
    assert replace(landings, rows=rows).summary()["median"].isna().all()
    with pytest.raises(InputError, match="probability between 0 and 1"):
        landings.summary(90.0)


def test_it_is_stored_and_read(landings, tmp_path):
    path = landings.save(tmp_path / "landings.nc")
    back = bc.Landings.load(path)
    assert back.rows.tobytes() == landings.rows.tobytes() and back.requirements == landings.requirements
    assert list(back.parameters) == list(landings.parameters)
    xr.testing.assert_identical(back.table, landings.table)
    assert back.failed_checks == () and "trust" not in repr(back)
    doubted = replace(landings, failed_checks=("rhat", "mode"))
    back = bc.Landings.load(doubted.save(path))
    assert back.failed_checks == ("rhat", "mode") and in_words(back, [])[0] == repr(doubted)
    assert repr(doubted).endswith("0 failed; no level of trust, failed checks: rhat, mode")
    other = tmp_path / "other.nc"
    xr.Dataset({"x": ("t", np.zeros(2))}).to_netcdf(other, engine="h5netcdf")
    for bad, word in ((other, "can't be read"), (tmp_path / "none.nc", "no such file")):
        with pytest.raises(bc.InputError, match=word):
            bc.Landings.load(bad)


def test_requirements_by_words_and_by_numbers(landings):
    one = landings.requirement(vertical_speed="40 ft/s", probability=0.5)
    assert one.verdict.verdict == "met" and one.chance.met == np.mean(landings.rows["vertical_speed"] <= 12.192)
    both = landings.requirement(vertical_speed=9.5, horizontal_speed=6.0)
    kept = (landings.rows["vertical_speed"] <= 9.5) & (landings.rows["horizontal_speed"] <= 6.0)
    assert both.chance.met == kept.mean()
    assert [j.requirement.name for j in landings.judgements()] == ["soft", "upright"]
    for bad, word in (({"speed": 1.0}, "one of"), ({}, "no limit"), ({"hang_angle": "3 m"}, "rad")):
        with pytest.raises(bc.InputError, match=word):
            landings.requirement(**bad)


def test_a_flight_lands_with_its_payload_in_its_wind(monkeypatch):
    """As if they were said one by one; winds that are given go before its own."""
    module, asked = import_module("bayeschute.api.posterior"), []
    monkeypatch.setattr(module, "campaign_of", lambda *given, **tables: asked.append((given, tables)))
    monkeypatch.setattr(module, "drawn_from", lambda *given: None)
    monkeypatch.setattr(module, "land", lambda *given, **named: None)
    study, wind = bc.Study.example(), bc.wind_profile([0.0, 2000.0], [1.0, 2.0], [0.0, 0.0])
    of = SimpleNamespace(spec=study.spec, files=None, failed_checks=())
    heavy = study.flights["cdt-3-12"].changed(name="heavy", capsule_mass=9500.0, wind=wind)
    bc.Posterior.land(of, heavy, draws=10)
    bc.Posterior.land(of, None, wind, 10, capsule_mass="9500.0 kg")
    assert asked[0] == asked[1] and asked[0][0][1] is wind
    bc.Posterior.land(of, heavy, {"profile": []}, draws=10)
    assert asked[2][0][1] == {"profile": []}
    other = heavy.changed(vehicle=study.vehicle.model_copy(update={"name": "another"}))
    bc.Posterior.land(of, other, draws=10)
    assert asked[3][0][0] == other.vehicle != study.vehicle


def test_files_and_their_dictionary(flown, landings, tmp_path):
    lines = write_landings(landings, tmp_path)
    assert any("soft: met" in line for line in lines)
    known = dictionary(landings).groupby("file")["column"].agg(set).to_dict()
    aero = aero_table(flown.plan.models[0])
    assert set(aero.columns) == known["aero_tables.csv"]
    for path in tmp_path.glob("*.csv"):
        if path.name != "data_dictionary.csv":
            assert set(pd.read_csv(path).columns) == known[path.name], path.name
    assert set(pd.read_parquet(tmp_path / "landings.parquet").columns) == known["landings.parquet"]
    assert (tmp_path / "landings-vertical_speed.png").stat().st_size > 10_000


def test_what_drives_it(flown):
    table = sensitivity(flown, samples=48)
    kinds = table.groupby("kind")["source"].agg(set)
    assert kinds["total"] == {"parameters", "winds", "start", "gusts", "canopies"}
    assert kinds["shapley"] == set(drawn_values(flown.plan.models))
    assert set(table["quantity"]) == {"vertical_speed", "hang_angle", "fails: soft", "fails: upright"}
    canopies = table[(table["source"] == "canopies") & (table["quantity"] == "hang_angle")]
    np.testing.assert_allclose(canopies[canopies["kind"] == "total"]["share"], 0.0, atol=1e-9)  # canopy_sd is zero
    assert drivers_figure(table).axes


def test_rare_failures_agree_with_counting(flown):
    campaign = campaign_of(None, None, 96, None, 1, requirement=[
        {"name": "r", "limits": [{"quantity": "vertical_speed", "at_most": "10 m/s"}]}])  # fmt: skip
    made = FlownCampaign(campaign, flown.plan, land(campaign, flown.plan))
    found = rare_failures(made, samples=200)["r"]
    counted = 1.0 - landings_met(made)
    assert found.probability == pytest.approx(counted, abs=0.15) and found.evaluations >= 200


def landings_met(flown):
    (one,) = flown.landings.requirements
    return one.met(flown.landings.rows).mean()


def test_the_placard(flown):
    cells = wind_placard(flown)
    table = placard_table(cells)
    assert len(table) == 2 and set(table["verdict"]) <= {"go", "no-go", "can't tell"}
    assert placard_figure(cells).axes
    assert design_figure(pd.DataFrame({"candidate": ["a", "b"], "shrinking": [0.2, 0.4]})).axes


def test_a_placard_needs_no_requirement(flown):
    campaign = campaign_of(None, None, 96, None, 1, placard={"shear": ["3 m/s"], "landings": 64})
    (cell,) = wind_placard(FlownCampaign(campaign, flown.plan, land(campaign, flown.plan)))
    assert cell.judged == () and cell.word == "can't tell" and 0.0 <= cell.pendulum.met <= 1.0


def test_an_interval_to_shrink_is_one_of_the_parameters(flown):
    design = {"candidates": str(ROOT / "models/campaigns/candidate-drops.toml"), "interval": "axial[7]"}
    campaign = campaign_of(None, None, 96, None, 1, design=design, requirement=TABLES["requirement"])
    done = FlownCampaign(campaign, flown.plan, flown.landings)
    with pytest.raises(bc.InputError, match=r"\[design\] interval: got 'axial\[7\]'; wanted one of"):
        drop_ranking(done, load_study(ROOT / "models/studies/cdt-3-11.toml"), {})


def test_questions_without_their_tables_are_refused_at_once():
    study = load_study(ROOT / "models/studies/cdt-3-11.toml")
    bare = campaign_of(None, None, 64, None, 1)
    with pytest.raises(bc.InputError) as caught:
        check_questions(bare, ("shares", "placard", "design"), study)
    assert [fault.got for fault in caught.value.faults] == ["no requirement", "no placard", "no design"]
    check_questions(bare, (), study)


def test_tables_from_python_have_their_faults_told():
    wind = bc.wind_profile([0.0, 500.0], [1.0, 2.0], [0.0, 0.0])
    assert len(campaign_of(None, [wind, wind], 64, None, 1).tables.wind.profile) == 2
    assert len(campaign_of(None, wind, 64, None, 1).tables.wind.profile) == 1
    with pytest.raises(bc.InputError, match="altitude"):
        campaign_of(None, None, 64, {"altitude": 3.0}, 1)


def test_examples_of_the_docstrings_run(landings, tmp_path):
    told = {"bc": bc, "folder": tmp_path, "landings": landings}
    result = doctest.testmod(import_module("bayeschute.api.landing.landings"), extraglobs=told)
    assert result.failed == 0 and result.attempted >= 4


def test_a_posterior_of_a_point_mass_has_no_landings():
    study = usual_study("descent")
    with pytest.raises(bc.InputError, match="model 'cluster'"):
        drawn_from(campaign_of(None, None, 64, None, 1), study, {})
