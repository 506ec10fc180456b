"""The noun `Landings`: tables, files, words, figures; what the verb refuses."""

from __future__ import annotations

import doctest
from dataclasses import replace
from functools import partial
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from tests.landing.plans import ROOT, small_plan

import bayeschute as bc
from bayeschute.api.landing.landing_answers import DropRanking
from bayeschute.api.landing.landing_files import dictionary, write_landings
from bayeschute.api.landing.landing_questions import check_questions, rare_failures, sensitivity
from bayeschute.api.landing.landing_source import LandingSource
from bayeschute.api.landing.landing_verb import campaign_of, land, source_of
from bayeschute.api.landing.landings import in_words
from bayeschute.core.errors import InputError
from bayeschute.landing.aero_table import aero_table
from bayeschute.landing.decisions.shares import SOURCES
from bayeschute.landing.measures import MEASURES, ON_LEVEL_GROUND
from bayeschute.landing.surface import SurfacePlan
from bayeschute.study.landing_campaign.posterior_parameters import drawn_values
from bayeschute.study.load import load_study, usual_study

SPEC = load_study(ROOT / "models/studies/cdt-3-11.toml")
CANDIDATES = ROOT / "models/campaigns/candidate-drops.toml"
TABLES = {
    "requirement": [
        {"name": "soft", "limits": [{"quantity": "vertical_speed", "at_most": "12 m/s"}], "probability": 0.5},
        {"name": "upright", "limits": [{"quantity": "hang_angle", "at_most": "30 deg"}], "probability": 0.5},
    ],
    "placard": {"shear": ["0 m/s", "6 m/s"], "capsule_mass": ["9000 kg"], "landings": 64},
}


@pytest.fixture(scope="module")
def landings():
    plan, campaign = small_plan(), campaign_of(None, None, 96, None, 1, **TABLES)
    return land(LandingSource(campaign, plan, SPEC, {}))


def by_plan(landings, **tables):
    """Landings of another campaign with the same plan."""
    campaign = campaign_of(None, None, 96, None, 1, **tables)
    return land(LandingSource(campaign, landings.source.plan, SPEC, {}))


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
    angle = told.loc["hang_angle"]
    assert angle["unit"] == "deg" and told.loc["turning", "unit"] == "deg/s"
    assert angle["median"] == pytest.approx(np.rad2deg(np.median(landings.rows["hang_angle"])))
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
    sound = replace(landings, level="self-consistent")
    back = bc.Landings.load(sound.save(path))
    assert back.level == "self-consistent" and repr(back).endswith("0 failed; level of trust: self-consistent")
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
    monkeypatch.setattr(module, "source_of", lambda *given, **named: None)
    monkeypatch.setattr(module, "land", lambda *given, **named: None)
    study, wind = bc.Study.example(), bc.wind_profile([0.0, 2000.0], [1.0, 2.0], [0.0, 0.0])
    of = SimpleNamespace(spec=study.spec, files=None, failed_checks=(), trust=SimpleNamespace(words=""))
    heavy = study.flights["cdt-3-12"].changed(name="heavy", capsule_mass=9500.0, wind=wind)
    bc.Posterior.land(of, heavy, draws=10)
    bc.Posterior.land(of, None, wind, 10, capsule_mass="9500.0 kg")
    assert asked[0] == asked[1] and asked[0][0][1] is wind
    bc.Posterior.land(of, heavy, {"profile": []}, draws=10)
    assert asked[2][0][1] == {"profile": []}
    other = heavy.changed(vehicle=study.vehicle.model_copy(update={"name": "another"}))
    bc.Posterior.land(of, other, draws=10)
    assert asked[3][0][0] == other.vehicle != study.vehicle


def test_files_and_their_dictionary(landings, tmp_path):
    lines = write_landings(landings, tmp_path)
    assert any("soft: met" in line for line in lines)
    known = dictionary(landings).groupby("file")["column"].agg(set).to_dict()
    aero = aero_table(landings.source.plan.models[0])
    assert set(aero.columns) == known["aero_tables.csv"]
    for path in tmp_path.glob("*.csv"):
        if path.name != "data_dictionary.csv":
            assert set(pd.read_csv(path).columns) == known[path.name], path.name
    assert set(pd.read_parquet(tmp_path / "landings.parquet").columns) == known["landings.parquet"]
    assert (tmp_path / "landings-vertical_speed.png").stat().st_size > 10_000


def test_what_drives_it(landings):
    found = landings.sensitivity(samples=48)
    table = found.table
    kinds = table.groupby("kind")["source"].agg(set)
    assert kinds["total"] == {"parameters", "winds", "start", "gusts", "canopies"}
    assert kinds["shapley"] == set(drawn_values(landings.source.plan.models))
    assert set(table["quantity"]) == {"vertical_speed", "hang_angle", "fails: soft", "fails: upright"}
    canopies = table[(table["source"] == "canopies") & (table["quantity"] == "hang_angle")]
    np.testing.assert_allclose(canopies[canopies["kind"] == "total"]["share"], 0.0, atol=1e-9)  # canopy_sd is zero
    assert len(found.figure().axes) == 8 and len(found.words) == 4
    assert len(found.plot("hang_angle").patches) == 5 and "total shares: " in repr(found)
    assert len(found.plot("hang_angle", "shapley").patches) == len(kinds["shapley"])
    for bad in (("speed",), ("hang_angle", "second")):
        with pytest.raises(bc.InputError, match="one of vertical_speed, hang_angle"):
            found.plot(*bad)


def test_a_surface_that_is_drawn_has_its_share(landings):
    """Of the speed along the slope's normal; of the vertical speed it has none."""
    steep = replace(landings.source.plan, surface=SurfacePlan((0.1, 0.1)))
    limits = [{"quantity": name, "at_most": "12 m/s"} for name in ("normal_speed", "vertical_speed")]
    campaign = campaign_of(None, None, 96, None, 1, requirement=[{"name": "r", "limits": limits}])
    source = LandingSource(campaign, steep, SPEC, {})
    table = sensitivity(source, land(source).rows, 48).table
    total = table[(table["kind"] == "total") & (table["source"] == "surface")].set_index("quantity")["share"]
    assert total["normal_speed"] > 0.01 and total["vertical_speed"] == pytest.approx(0.0, abs=1e-9)
    assert set(table[table["kind"] == "first"]["source"]) == set(SOURCES.values())
    rare = rare_failures(source, 64).table
    assert 0.0 <= rare["probability_not_met"][0] < 1.0


def test_landings_that_were_stored_before_there_were_surfaces_are_read(landings, tmp_path):
    path = landings.save(tmp_path / "landings.nc")
    held = xr.load_dataset(path, engine="h5netcdf")
    gone = ["surface", *ON_LEVEL_GROUND, "surface_slope", "surface_slope_direction", "surface_rise"]
    held.drop_vars(gone).to_netcdf(path, engine="h5netcdf")
    back = bc.Landings.load(path).rows
    for name in back.dtype.names:
        np.testing.assert_allclose(back[name], landings.rows[name], rtol=1e-12, atol=1e-14)
    held.drop_vars([*gone, "hang_angle"]).to_netcdf(path, engine="h5netcdf")
    with pytest.raises(bc.InputError, match="can't be read"):
        bc.Landings.load(path)


def test_rare_failures_agree_with_counting(landings):
    limits = [{"quantity": "vertical_speed", "at_most": "10 m/s"}]
    made = by_plan(landings, requirement=[{"name": "r", "limits": limits}])
    found = made.rare_failures(samples=200)
    (one,) = made.requirements
    (row,) = found.table.itertuples()
    counted = 1.0 - one.met(made.rows).mean()
    assert row.probability_not_met == pytest.approx(counted, abs=0.15) and row.landings >= 200
    assert found.words[0].startswith("r: P(not met) ") and found.figure() is None


def test_the_placard(landings):
    found = landings.placard()
    assert len(found.table) == 2 and set(found.table["verdict"]) <= {"go", "no-go", "can't tell"}
    assert found.figure().axes and len(found.plot().patches) == 2
    other = landings.placard(shear=["3 m/s"], landings=64)
    assert other.table["shear_m_per_s"].tolist() == [3.0] and "shear 3 m/s, payload" in repr(other)
    with pytest.raises(bc.InputError, match="shear"):
        landings.placard(shear=["3 kg"])


def test_a_placard_needs_no_requirement(landings):
    (cell,) = by_plan(landings, placard={"shear": ["3 m/s"], "landings": 64}).placard().cells
    assert cell.judged == () and cell.word == "can't tell" and 0.0 <= cell.pendulum.met <= 1.0


def test_an_interval_to_shrink_is_one_of_the_parameters(landings):
    with pytest.raises(bc.InputError, match=r"\[design\] interval: got 'axial\[7\]'; wanted one of"):
        landings.rank_drops(CANDIDATES, interval="axial[7]")


def test_a_ranking_in_words_and_as_a_figure():
    table = pd.DataFrame({
        "candidate": ["a", "b"], "spread_now": 0.1, "spread_expected": [0.06, 0.08], "shrinking": [0.4, 0.2],
        "sd left of axial[1]": [0.9, 0.5],
    })  # fmt: skip
    by_spread, by_sd = DropRanking(table), DropRanking(table, "axial[1]", {"c": "it does not fly"})
    assert by_spread.words[0] == "a: spread of P(met) 0.100 now, 0.060 expected after it"
    assert by_sd.words[1].endswith("50 % of the sd of axial[1] left")
    assert by_sd.words[2] == "c: can't be judged: it does not fly"
    widths = [[bar.get_width() for bar in one.plot().patches] for one in (by_spread, by_sd)]
    np.testing.assert_allclose(widths, [[0.2, 0.4], [0.1, 0.5]])
    assert by_sd.figure().axes[0].get_xlabel() == "expected shrinking of the sd of axial[1] [1]"
    assert by_sd._repr_html_().count("<tr") == 3 and "trust" not in repr(by_sd) + by_sd._repr_html_()


def test_an_answer_from_a_posterior_with_failed_checks_says_so(landings):
    doubted = replace(landings.source, failed_checks=("rhat", "predictive"))
    found = replace(landings, source=doubted).placard(shear=["3 m/s"], landings=64)
    assert repr(found).endswith("no level of trust, failed checks: rhat, predictive")
    assert (
        "no level of trust, failed checks: rhat, predictive" in found._repr_html_() and "trust" not in found.words[-1]
    )
    sound = replace(landings, source=replace(landings.source, level="not checked"))
    found = sound.placard(shear=["3 m/s"], landings=64)
    assert repr(found).endswith("level of trust: not checked") and "level of trust: not checked" in found._repr_html_()


def test_questions_need_landings_that_were_flown(landings, tmp_path):
    back = bc.Landings.load(landings.save(tmp_path / "landings.nc"))
    for question in (back.sensitivity, back.rare_failures, back.placard, back.rank_drops):
        with pytest.raises(bc.InputError, match="landings read from a file"):
            question()
    bare = by_plan(landings)
    for question, word in (
        (bare.sensitivity, "no requirement"), (bare.rare_failures, "no requirement"), (bare.placard, "no placard"),
        (bare.rank_drops, "no design"), (partial(bare.rank_drops, CANDIDATES), "no requirement"),
    ):  # fmt: skip
        with pytest.raises(bc.InputError, match=word):
            question()


def test_questions_without_their_tables_are_refused_at_once():
    bare = campaign_of(None, None, 64, None, 1)
    with pytest.raises(bc.InputError) as caught:
        check_questions(bare, ("shares", "placard", "design"), SPEC)
    assert [fault.got for fault in caught.value.faults] == ["no requirement", "no placard", "no design"]
    check_questions(bare, (), SPEC)


def test_tables_from_python_have_their_faults_told():
    wind = bc.wind_profile([0.0, 500.0], [1.0, 2.0], [0.0, 0.0])
    assert len(campaign_of(None, [wind, wind], 64, None, 1).tables.wind.profile) == 2
    assert len(campaign_of(None, wind, 64, None, 1).tables.wind.profile) == 1
    with pytest.raises(bc.InputError, match="altitude"):
        campaign_of(None, None, 64, {"altitude": 3.0}, 1)
    given = {"altitude": [0.0, 900.0], "north": [1.0, 2.0], "east": [0.0, 0.0], "east_sd": [1.0, 2.0], "length": 800.0}
    june = bc.wind_climatology(north_sd=[2.0, 3.0], correlation=[0.1, 0.2], **given)
    table = campaign_of(None, june, 64, None, 1).tables.wind.climatology
    assert table == june and table.rows()[0][1][1].tolist() == [900.0, 2.0, 0.0, 3.0, 2.0, 0.2]
    with pytest.raises(bc.InputError) as caught:
        bc.wind_climatology(north_sd=[2.0, -3.0], correlation=[0.1, 2.0], **given)
    assert len(caught.value.faults) == 2 and "wind_climatology [correlation]" in str(caught.value)


def test_examples_of_the_docstrings_run(landings, tmp_path):
    told = {"bc": bc, "folder": tmp_path, "landings": landings}
    for name, least in (("landings", 4), ("landing_winds", 3)):
        result = doctest.testmod(import_module(f"bayeschute.api.landing.{name}"), extraglobs=told)
        assert result.failed == 0 and result.attempted >= least


def test_a_posterior_of_a_point_mass_has_no_landings():
    study = usual_study("descent")
    with pytest.raises(bc.InputError, match="model 'cluster'"):
        source_of(campaign_of(None, None, 64, None, 1), study, {})
