"""`Posterior` of draws and files that are known: what it says of itself, and what it asks others for."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace

import arviz_stats
import numpy as np
import pandas as pd
import pytest
import xarray as xr

import bayeschute as bc
from bayeschute.api.posterior import Posterior, draws_held
from bayeschute.likelihood.priors import Prior

module = import_module("bayeschute.api.posterior")
DRAG = Prior("cds_over_mass", np.log(0.12), 0.5, True, "m^2/kg", "given")
CHECKS = {
    "rhat": {"passed": True, "value": 1.001, "bound": 1.01, "detail": "worst"},
    "mode": {"passed": False, "value": -1.0, "bound": 0.0, "detail": "curvature"},
    "ess_bulk": {"passed": True, "value": 900.0, "bound": 400.0, "detail": "least"},
}
FILES = {
    "checks.json": {"checks": CHECKS, "ess_bulk": {"cds_over_mass": 900.0}},
    "priors.json": [vars(DRAG) | {"source": "structure"}],
    "fit/priors.json": [vars(DRAG)],
}


def stored(files):
    return {name: json.dumps(value).encode() for name, value in files.items()}


def tree(**groups):
    """Draws (chain, draw) of parameters by group, each with its unit."""
    units = {"cds_over_mass": "m^2/kg", "angle": "rad"}
    return xr.DataTree.from_dict({
        group: xr.Dataset({
            name: (("chain", "draw"), x, {"units": units[name]} if name in units else {}) for name, x in draws.items()
        })
        for group, draws in groups.items()
    })  # fmt: skip


RNG = np.random.default_rng(0)
DRAWS = {"cds_over_mass": 0.15 + 0.01 * RNG.normal(size=(2, 300)), "angle": np.deg2rad(RNG.normal(10.0, 1.0, (2, 300)))}


@pytest.fixture(scope="module")
def known(sondes):
    """Of the first sonde, with an angle that no sonde has."""
    spec = replace(sondes.spec, flights=sondes.spec.flights[:1], requirements=())
    prior = {name: 2.0 * x for name, x in DRAWS.items()}
    return Posterior(spec, tree(posterior=DRAWS, prior=prior), stored(FILES))


def with_files(known, **files):
    return replace(known, files=stored(FILES | {f"{name}.json": value for name, value in files.items()}))


def test_draws_by_name_in_their_unit(known):
    assert known.names == ("cds_over_mass", "angle") and draws_held(known) == 600
    assert known["angle"].dims == ("chain", "draw") and known["angle"].attrs["units"] == "rad"
    np.testing.assert_array_equal(known["angle"], DRAWS["angle"])
    with pytest.raises(KeyError):
        known["speed"]


def test_a_summary_is_arvizs_with_units_first(known):
    told, wanted = known.summary(), arviz_stats.summary(known.data, ci_prob=0.9, round_to="none")
    assert told.columns[0] == "unit" and told["unit"].to_list() == ["m^2/kg", "rad"]
    assert list(told.columns[1:]) == list(wanted.columns)
    for name in told.columns[1:]:
        np.testing.assert_allclose(told[name].astype(float), wanted[name].astype(float), rtol=5.1e-4)
    assert told.loc["angle", "mean"] == float(f"{wanted.loc['angle', 'mean']:.4g}") != wanted.loc["angle", "mean"]
    assert "eti90_lb" in told.columns


def test_a_summarys_options_are_arvizs(known):
    whole = known.summary(round_to="none")
    assert whole.loc["angle", "mean"] == pytest.approx(DRAWS["angle"].mean(), rel=1e-12) and "unit" in whole
    half = known.summary(ci_prob=0.5, var_names=["angle"])
    assert half.index.to_list() == ["angle"] and "eti50_lb" in half.columns and half["unit"].to_list() == ["rad"]
    assert isinstance(known.summary(fmt="xarray"), xr.Dataset)
    bare = replace(known, data=tree(posterior={"share": DRAWS["angle"]})).summary()
    assert bare["unit"].to_list() == ["1"]


def test_checks_are_told_with_what_they_want(known):
    told = known.checks()
    assert told.index.to_list() == ["rhat", "mode", "ess_bulk"]
    assert told["wanted"].to_list() == ["at most 1.01", "above 0", "at least 400"]
    assert told["value"].to_list() == [1.001, -1.0, 900.0] and told.loc["mode", "detail"] == "curvature"
    assert not known.passed and known.failed_checks == ("mode",)


def test_a_posterior_passes_if_all_its_checks_do_and_some_were_made(known):
    good = with_files(known, checks={"checks": {n: one | {"passed": True} for n, one in CHECKS.items()}})
    assert good.passed and good.failed_checks == () and "all checks passed" in repr(good)
    for none in (replace(known, files={}), with_files(known, checks={}), with_files(known, checks={"checks": {}})):
        assert none.checks().empty and not none.passed and none.failed_checks == ()
        assert repr(none) == "Posterior of low: 2 parameters, 2 chains of 300 draws; not checked"


def test_it_shows_itself(known):
    assert repr(known) == (
        "Posterior of low: 2 parameters, 2 chains of 300 draws; no level of trust, failed checks: mode"
    )
    shown = known._repr_html_()
    low, middle, high = (f"{q:.4g}" for q in np.rad2deg(np.quantile(DRAWS["angle"], (0.05, 0.5, 0.95))))
    assert f"<tr><td>angle</td><td>{middle}</td><td>{low} to {high}</td><td>deg</td></tr>" in shown
    assert "<td>m²/kg</td>" in shown or "<td>m^2/kg</td>" in shown
    bare = replace(known, data=tree(posterior={"share": DRAWS["angle"]}))
    assert "<td>1</td></tr>" in bare._repr_html_() and "1 parameter," in repr(bare)


def test_identifiability_is_what_was_stored_of_all_fits(known):
    """A row per parameter, whichever fit it is of; what is not known of one is empty."""
    stored_fits = {
        "low": {"parameters": {"cds_over_mass": {"contraction": 0.75, "shift": 0.5, "diagnosis": "seen"}}},
        "rest": {"parameters": {"angle": {"shift": -0.5}, "mass": {"contraction": -0.1, "diagnosis": "unseen"}}},
    }
    told = with_files(known, identifiability=stored_fits).identifiability()
    assert told.index.to_list() == ["cds_over_mass", "angle", "mass"] and told.columns[0] == "contraction"
    assert told["contraction"].dropna().to_dict() == {"cds_over_mass": 0.75, "mass": -0.1}
    assert told["shift"].dropna().to_dict() == {"cds_over_mass": 0.5, "angle": -0.5}
    assert told["diagnosis"].dropna().to_dict() == {"cds_over_mass": "seen", "mass": "unseen"}
    assert known.identifiability().empty
    earlier = {"all": {"parameters": {"mass": {"shift": 0.5, "diagnosis": "mostly the prior"}}}}
    told = with_files(known, identifiability=earlier).identifiability()
    assert told.loc["mass", "shift"] == 0.5 and np.isnan(told.loc["mass", "contraction"])


def test_predictive_checks_and_possible_errors_are_as_stored_the_least_probable_check_first(known):
    assert known.possible_errors().empty and known.predictive_checks().empty
    rows = [
        {"flight": "i", "what": "w", "statistic": "s", "value": 1.0, "expected": 0.0, "p": p} for p in (0.5, 0.01, 0.2)
    ]
    size = {"flight": "i", "what": "the mass", "unit": "%", "estimate": 5.0, "se": 1.0, "moves": 3.0}
    stored = {"checks": rows, "errors": [size | {"p": 1e-6, "matters": True, "do": "Weigh it."}]}
    told = with_files(known, predictive=stored)
    table, (error,) = told.predictive_checks(), told.possible_errors().to_dict("records")
    assert table["p"].tolist() == [0.01, 0.2, 0.5] and table.index.tolist() == [0, 1, 2]
    assert (error["what"], error["estimate"], error["do"]) == ("the mass", 5.0, "Weigh it.")


def test_what_leave_one_out_needs_is_of_its_data(known, monkeypatch):
    monkeypatch.setattr(module, "for_loo_pit", lambda *given: given)
    assert known.for_loo_pit("low", "descent_rate") == (known.data, "low", "descent_rate")
    assert known.for_loo_pit("low") == (known.data, "low", None)


def test_trust_is_by_its_own_checks(known, monkeypatch):
    asked = []
    monkeypatch.setattr(module, "status", lambda job, checks, held: asked.append((job.study, checks, held)) or SimpleNamespace(claim="claim"))  # fmt: skip
    assert known.trust == "claim" and known.trust == "claim" and asked == [(known.spec, CHECKS, {})]


def test_ranges_and_proposals_are_of_what_was_flown(known, monkeypatch):
    flights = []
    monkeypatch.setattr(module, "flown", lambda job: [*flights])
    monkeypatch.setattr(module, "ranges", lambda some: {"alpha": (0.1, float(len(some)))})
    monkeypatch.setattr(module, "proposed_terms", lambda some: some)
    monkeypatch.setattr(module, "as_rows", lambda some: [{"kind": one} for one in some])
    assert replace(known).ranges == {} and replace(known).proposals().empty
    flights += ["axial", "transverse"]
    cached = replace(known)
    assert cached.ranges == {"alpha": (0.1, 2.0)} and cached.proposals()["kind"].to_list() == flights


def test_a_curve_is_of_draws_and_ranges(known, monkeypatch):
    """In the order of the arguments of `views.curve.curve`."""
    monkeypatch.setattr(module, "curve", lambda *given: given)
    monkeypatch.setattr(module, "agreement", lambda spec, draws, held: [spec, set(draws), held])
    monkeypatch.setattr(module, "flown", lambda job: [])
    made = replace(known)
    name, draws, prior, ranges, told, *rest = made.curve("C_A", 0.5, 7, over=(0.0, 1.0), distance=0.8, speed=1.1)
    assert name == "C_A" and rest == [0.5, 7, (0.0, 1.0), 0.8, 1.1, None] and ranges == {}
    np.testing.assert_array_equal(draws["angle"], DRAWS["angle"])
    np.testing.assert_array_equal(prior["angle"], 2.0 * DRAWS["angle"])
    assert told == [known.spec, {"cds_over_mass", "angle"}, None] and made.knowledge is made.knowledge
    bare = replace(known, data=tree(posterior=DRAWS)).curve("C_N")
    assert bare[2] is None and bare[5:] == (0.9, 61, None, None, 1.0, None)
    monkeypatch.setattr(Posterior, "_priors", [replace(DRAG, saturation=0.4)])
    levelled = replace(known)
    assert levelled.curve("C_A")[-1] == 0.4 and levelled.knowledge[-1] == 0.4


def test_priors_are_those_of_the_fit_where_it_put_them_right(known):
    """Else those of the stage; none where none are."""
    assert known._priors == [DRAG]
    assert replace(known, files=stored({"priors.json": FILES["priors.json"]}))._priors == [
        replace(DRAG, source="structure")
    ]
    assert replace(known, files={})._priors == []


@pytest.fixture(scope="module")
def alone(known):
    """The drag alone, as of a sonde."""
    return replace(known, data=tree(posterior={"cds_over_mass": DRAWS["cds_over_mass"]}))


def test_as_priors_it_is_a_gaussian_of_its_draws(alone):
    priors = alone.as_priors()
    (one,) = priors.parameters
    logarithms = np.log(DRAWS["cds_over_mass"])
    assert one.centre == pytest.approx(logarithms.mean(), rel=1e-12) and one.scale == pytest.approx(
        logarithms.std(), rel=0.01
    )
    assert one.logarithmic and one.source == "posterior of low" and priors.table == alone.spec.priors
    earlier = [
        {"flights": ["a", "b"], "joint": 1.0, "parameters": []},
        {"flights": ["c"], "joint": 0.5, "parameters": []},
    ]
    assert with_files(alone, history=earlier).as_priors().parameters[0].source == "posterior of a, b, c, low"


def test_what_each_drop_taught_follows_what_was_known_before(alone):
    earlier = [{"flights": ["a"], "joint": 1.5, "parameters": [{"name": "cds_over_mass", "gain": 1.5}]}]
    told = with_files(alone, history=earlier).taught()
    assert told.index.to_list() == [("a", "cds_over_mass"), ("low", "cds_over_mass")]
    own = told.loc[("low", "cds_over_mass")]
    assert own["prior_sd"] == pytest.approx(0.5) and own["gain"] > 1.0 and told.attrs["joint"]["a"] == 1.5
    assert alone.taught().index.to_list() == [("low", "cds_over_mass")]
    two = replace(alone, spec=replace(alone.spec, flights=bc.Study.example().spec.flights))
    assert two._taught_by == [f.name for f in two.spec.flights if "identify" in f.roles]


def test_an_update_fits_by_this_as_the_prior_and_keeps_the_history(alone, sondes, monkeypatch):
    """Sizes of the sampler are those that are asked, of the flights' study."""
    asked = {}
    spec = replace(alone.spec, seed=77)
    monkeypatch.setattr(module, "fitted_flights", lambda *given: asked.update(fit=given) or (spec, "made", {"a": b"1"}))
    monkeypatch.setattr(module, "drawn", lambda *given: asked.update(drawn=given) or "posterior")
    high, noise = sondes.flights["high"], sondes.noise
    made = alone.update(high, noise=noise, draws=400, chains=4, warmup=60, seed=5, progress=True)
    assert made == "posterior"
    flights, priors, *rest = asked["fit"]
    assert flights == [high] and rest == [noise, None, True] and priors.parameters == alone.as_priors().parameters
    drawn, groups, files, progress, read = asked["drawn"]
    assert (drawn.seed, drawn.sampler.draws, drawn.sampler.chains, drawn.sampler.warmup) == (5, 100, 4, 60)
    assert (groups, progress, read) == ("made", True, Posterior.of_run)
    assert files["a"] == b"1" and [one["flights"] for one in json.loads(files["history.json"])] == [["low"]]
    alone.update([high])
    assert asked["fit"][2:] == (None, None, None) and asked["drawn"][0] == spec
    with pytest.raises(bc.InputError, match="would count twice"):
        alone.update(sondes.flights["low"])


@pytest.fixture
def foretold(known, monkeypatch):
    """What `forecast` is asked; its answer has two failed checks of its own, and the posterior no level."""
    asked = []

    def forecast(*given):
        asked.append(given)
        draws = xr.Dataset(attrs={"failed": 0})
        return bc.Forecast("a", draws, np.zeros(0, bool), {}, None, {}, 1, {}, 0, ("bands", "mode"))

    monkeypatch.setattr(module, "forecast", forecast)
    monkeypatch.setitem(vars(known), "trust", SimpleNamespace(words="not checked"))
    return asked


def test_a_prediction_is_asked_by_study_and_files(known, foretold):
    made = known.predict("flight", 10, 0, like="low")
    assert foretold == [(known.spec, known.files, "flight", 10, 0, "low")]
    assert made.failed_checks == ("mode", "bands")  # its own first, none twice
    assert made.level == "not checked"
    known.predict("flight")
    assert foretold[1] == (known.spec, known.files, "flight", None, None, None)


def test_predictions_take_no_more_draws_than_there_are(known, foretold):
    known.predict("flight", 600)
    with pytest.raises(bc.InputError, match="draws: got 601; wanted at most 600, draws of the posterior"):
        known.predict("flight", 601)
    assert len(foretold) == 1


@pytest.mark.parametrize("spread", [0, 0.7, 3.0])
def test_the_air_may_be_rougher(known, foretold, spread):
    known.predict("flight", disturbance_log_sd=spread)
    spec = foretold[0][0]
    assert spec.predict.disturbance_log_sd == spread and isinstance(spec.predict.disturbance_log_sd, float)
    assert replace(spec, predict=known.spec.predict) == known.spec


@pytest.mark.parametrize("spread", [-0.001, 3.001, np.nan])
def test_how_rough_is_bounded(known, foretold, spread):
    with pytest.raises(bc.InputError, match="disturbance_log_sd: got .*; wanted a number from 0 to 3"):
        known.predict("flight", disturbance_log_sd=spread)
    assert foretold == []


@pytest.fixture
def landed(monkeypatch):
    """What is asked of campaign, source and landings."""
    asked = SimpleNamespace(campaign=[], source=[], land=[])
    monkeypatch.setattr(
        module, "campaign_of", lambda *given, **tables: asked.campaign.append((given, tables)) or "campaign"
    )
    monkeypatch.setattr(module, "source_of", lambda *given, **named: asked.source.append((given, named)) or "source")
    monkeypatch.setattr(module, "land", lambda *given: asked.land.append(given) or "landings")
    return asked


def test_landings_are_asked_by_campaign_and_source(known, landed, tmp_path, monkeypatch):
    monkeypatch.setitem(vars(known), "trust", SimpleNamespace(words="not checked"))
    made = known.land(
        "vehicle", "winds", 10, start={"tilt": "1 deg"}, workers=3, folder=str(tmp_path), progress=print, name="n"
    )
    assert made == "landings" and landed.land == [("source", tmp_path)]
    assert landed.campaign == [(("vehicle", "winds", 10, {"tilt": "1 deg"}, 4), {"name": "n"})]
    assert landed.source == [
        (("campaign", known.spec, known.files, ("mode",), 3), {"progress": print, "level": "not checked"})
    ]
    known.land(seed=0)
    assert landed.campaign[1] == ((None, None, 100_000, None, 0), {}) and landed.land[1] == ("source", None)


def test_a_flight_without_own_payload_and_wind_lands_as_its_vehicle(landed):
    study = bc.Study.example()
    of = SimpleNamespace(spec=study.spec, files=None, failed_checks=(), trust=SimpleNamespace(words=""))
    bare = study.flights["cdt-3-12"].changed(capsule_mass=None)
    assert bare.spec.capsule_mass is None and bare.spec.wind_profile is None
    Posterior.land(of, bare, draws=5)
    assert landed.campaign[0][0][:3] == (None, None, 5) and landed.campaign[0][1] == {}
    Posterior.land(of, bare.changed(name="x", capsule_mass=9000.0), draws=5)
    assert landed.campaign[1][1] == {"capsule_mass": "9000.0 kg"}
    wind = bc.wind_profile([0.0, 2000.0], [1.0, 2.0], [0.0, 0.0])
    windy = bare.changed(wind=wind, vehicle=study.vehicle.model_copy(update={"name": "another"}))
    Posterior.land(of, windy, draws=5)
    Posterior.land(of, windy, "winds", draws=5)
    assert [given[:2] for given, _ in landed.campaign[2:]] == [(windy.vehicle, wind), (windy.vehicle, "winds")]


def test_it_is_stored_and_read_again(known, tmp_path):
    path = known.save(str(tmp_path / "a.nc"))
    back = Posterior.load(str(path))
    assert back.files == known.files and back.names == known.names and back.spec.flights == known.spec.flights
    np.testing.assert_array_equal(back["angle"], known["angle"])
    with pytest.raises(bc.InputError, match="no posterior.nc"):
        Posterior.of_run(str(tmp_path), known.spec)


def test_marginals_are_with_the_priors_of_each_set_of_flights(known, monkeypatch):
    sets = [SimpleNamespace(priors=("p",), name="one"), SimpleNamespace(priors=("q",), name="two")]
    monkeypatch.setattr(module, "groups", lambda job: sets)
    monkeypatch.setattr(module, "load_fit", lambda job, one: SimpleNamespace(marginal=f"of {one.name}"))
    assert replace(known).marginals == (("of one", ("p",)), ("of two", ("q",)))


def test_a_summary_of_other_frames_is_left_as_it_is(known, monkeypatch):
    """Rows that are no parameters have no unit."""
    frame = pd.DataFrame({"mean": [1.23456789]}, index=["angle[0]"])
    monkeypatch.setattr(arviz_stats, "summary", lambda data, **options: frame.copy())
    assert list(known.summary().columns) == ["mean"] and known.summary()["mean"].to_list() == [1.235]
    assert known.summary(round_to=6)["mean"].to_list() == [1.23456789]
