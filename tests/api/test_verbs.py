"""The verbs: what each asks of the rooms below, by which names, and what it refuses."""

from __future__ import annotations

import json
from contextlib import contextmanager
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import bayeschute as bc
from bayeschute import console
from bayeschute.api import verbs
from bayeschute.api.verbs import Coverage
from bayeschute.core.errors import InputError
from bayeschute.records import reconstruct as records_reconstruct
from bayeschute.study import calibrate as campaigns
from bayeschute.study.assembly.assemble import smaller
from bayeschute.study.evidence.scenarios import SCENARIOS
from bayeschute.study.run import simulate, stages

COLUMNS = {"time": ("time_s", "s"), "altitude": ("altitude_m", "m")}


@pytest.fixture
def file(descents):
    return descents.study.with_name("low.csv")


def test_a_record_is_read_by_its_map_in_si(file):
    record = bc.read_record(file, COLUMNS)
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(record["time"], rows[:, 0])
    np.testing.assert_array_equal(record["altitude"], rows[:, 1])
    feet = bc.read_record(file, {"time": ("time_s", "s"), "altitude": ("altitude_m", "ft", 2.0, 3.0)})
    np.testing.assert_allclose(feet["altitude"], 0.3048 * (2.0 * rows[:, 1] + 3.0), rtol=1e-12)
    assert record.attrs["body_axes"] == "x y z" and record["altitude"].attrs["units"] == "m"


def test_conventions_are_those_of_the_reader_and_others_are_named(file):
    assert bc.read_record(file, COLUMNS, body_axes="-z y x").attrs["body_axes"] == "-z y x"
    with pytest.raises(bc.InputError) as caught:
        bc.read_record(file, COLUMNS, axis="ENU", bodyaxes="x y z", axes="ENU")
    assert [fault.got for fault in caught.value.faults] == ["'axis'", "'bodyaxes'"]
    assert "axes" in caught.value.faults[0].wanted and "repeated_times" in caught.value.faults[1].wanted


def test_a_file_in_the_schema_needs_no_map_and_says_its_own_axes(sondes, tmp_path):
    path = tmp_path / "low.nc"
    record = sondes.flights["low"].record
    record.to_netcdf(path, engine="h5netcdf")
    back = bc.read_record(str(path))
    np.testing.assert_array_equal(back["altitude"], record["altitude"])
    assert "body_axes" not in back.attrs


def test_a_unit_that_was_meant_is_told_with_the_fault(file):
    with pytest.raises(bc.InputError) as caught:
        bc.read_record(file, COLUMNS | {"altitude": ("altitude_m", "M")})
    (fault,) = caught.value.faults
    assert fault.do == "Did you mean 'm'?" and "altitude" in fault.where
    with pytest.raises(bc.InputError, match="gone.csv"):
        bc.read_record(file.with_name("gone.csv"))


def test_a_flight_is_reconstructed_by_its_vehicle_and_payload(monkeypatch):
    """The wind at the canopies only where the flight has a profile."""
    monkeypatch.setattr(records_reconstruct, "reconstruct", lambda record, geometry, canopy_wind: xr.Dataset(attrs={"of": (record, geometry, canopy_wind)}))  # fmt: skip
    assembly = import_module("bayeschute.study.assembly.assemble")
    monkeypatch.setattr(assembly, "geometry", lambda vehicle, mass: (vehicle, mass))
    aloft = import_module("bayeschute.study.assembly.canopy_wind")
    monkeypatch.setattr(aloft, "canopy_wind", lambda record, profile: (record, profile))
    flight = bc.Study.example().flights["cdt-3-12"].changed(capsule_mass=9000.0)
    record = object()
    object.__setattr__(flight, "_prepared", (record, None))
    motion = verbs.reconstruct(flight)
    assert motion.flight is flight and motion.data.attrs["of"] == (record, (flight.vehicle, 9000.0), None)
    wind = bc.wind_profile([0.0, 100.0], [1.0, 2.0], [0.0, 0.0])
    windy = flight.changed(wind=wind)
    object.__setattr__(windy, "_prepared", (record, None))
    assert verbs.reconstruct(windy).data.attrs["of"][2] == (record, wind)


def test_a_point_mass_has_no_motion(sondes):
    with pytest.raises(bc.InputError, match="flight low: got no vehicle; wanted the flight of a cluster"):
        bc.reconstruct(sondes.flights["low"])


@pytest.fixture
def selected(monkeypatch):
    """A stage that tells of what it was asked, and leaves results."""
    asked, stage = [], import_module("bayeschute.study.run.stage_structure")
    monkeypatch.setattr(verbs, "ingest", lambda job, flights: asked.append([f.name for f in flights]))

    def structure(job):
        asked.append(job.study)
        job.say("structure")(1.0, "done")
        job.save("structure.json", {"coefficients": {"axial": len(asked)}})
        if len(asked) > 2:
            (job.out / "structure.txt").write_text("said", encoding="utf-8")

    monkeypatch.setattr(stage, "structure", structure)
    return asked


def test_structures_are_of_flights_or_their_motions(sondes, selected):
    """Print-outs only where the stage left them."""
    low, high = sondes.flights
    told = []
    made = bc.select_structure([low, verbs.Motion(high, xr.Dataset())], progress=lambda *said: told.append(said))
    assert selected[0] == ["low", "high"] and made.spec is selected[1] and told == [("structure", 1.0, "done")]
    assert made.found == {"coefficients": {"axial": 2}} and made.text == ""
    assert [f.name for f in made.spec.flights] == ["low", "high"] and made.spec.structure is None
    for one in (low, verbs.Motion(low, xr.Dataset())):
        assert bc.select_structure(one).text == "said" and selected[-2] == ["low"]


def test_candidates_replace_the_studys(selected):
    study = bc.Study.example()
    few = study.candidates.model_copy(update={"axial": ("1",)})
    assert bc.select_structure(study.flights[0], few).spec.structure is few
    assert bc.select_structure(study.flights[0]).spec.structure == study.candidates


def test_a_fit_is_of_what_is_chosen(sondes, monkeypatch):
    asked = []
    monkeypatch.setattr(verbs, "fitted_flights", lambda *given: asked.append(given) or ("spec", ("group",), {"a": b""}))
    fit = bc.fit(sondes, "priors", noise="noise", seed=0, progress=True)
    assert (fit.spec, fit.groups, fit.files) == ("spec", ("group",), {"a": b""})
    assert [f.name for f in asked[0][0]] == ["low", "high"] and asked[0][1:] == ("priors", "noise", 0, True)
    bc.fit(sondes.flights["high"])
    assert [f.name for f in asked[1][0]] == ["high"] and asked[1][1:] == (None, None, None, None)


def test_draws_are_of_the_fit_with_the_sizes_that_are_asked(sondes, monkeypatch):
    asked = []
    monkeypatch.setattr(verbs, "drawn", lambda *given: asked.append(given) or "posterior")
    fit = verbs.Fit(sondes.spec, ("group",), {"a": b"1"})
    assert bc.sample(fit, 300, chains=3, warmup=60, seed=0, sampler="emcee", progress=True) == "posterior"
    spec, *rest = asked[0]
    table = spec.sampler
    assert (table.draws, table.chains, table.warmup, table.kind, spec.seed) == (100, 3, 60, "emcee", 0)
    assert rest == [("group",), {"a": b"1"}, True, bc.Posterior.of_run]
    bc.sample(fit)
    assert asked[1][0] == sondes.spec and asked[1][3] is None


def test_a_run_is_asked_as_the_command_asks_it(sondes, monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(stages, "run_study", lambda *given, **named: asked.append((given, named)))
    run = bc.run(sondes, str(tmp_path), resume=True, until="fit", workers=3, progress=print, force=True)
    assert asked[0] == (
        (sondes.spec, str(tmp_path), "fit", True, False),
        {"progress": print, "workers": 3, "force": True},
    )
    assert run.folder == tmp_path and run.study is sondes
    quick = bc.run(sondes, tmp_path, quick=True)
    assert asked[1] == ((sondes.spec, tmp_path, None, False, True), {"progress": None, "workers": 1, "force": False})
    assert quick.study.spec == smaller(sondes.spec) != sondes.spec


@pytest.mark.parametrize("one", ["t_ms", ("t_ms",), ("t_ms", 1.0), ("t_ms", "ms", "2"), ("t", "s", 1.0, 0.0, 0.0), 5])
def test_a_column_without_its_unit_is_told(tmp_path, one):
    with pytest.raises(InputError) as told:
        bc.read_record(tmp_path / "none.csv", {"time": one, "altitude": ("h", "m")})
    (fault,) = told.value.faults
    assert fault.where == "columns 'time'" and "name and unit" in fault.wanted


def test_conventions_are_texts(tmp_path):
    with pytest.raises(InputError, match="body_axes: got .*'-z', 'y', 'x'.*; wanted a text"):
        bc.read_record(tmp_path / "none.csv", {"time": ("t", "s")}, body_axes=["-z", "y", "x"])


def test_a_run_that_is_stopped_says_how_to_go_on(sondes, monkeypatch, tmp_path):
    def stopped(*given, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr(stages, "run_study", stopped)
    for named, more in (({}, ""), ({"quick": True, "until": "fit"}, ", quick=True, until='fit'")):
        with pytest.raises(KeyboardInterrupt) as end:
            bc.run(sondes, tmp_path, **named)
        (note,) = end.value.__notes__
        assert f"bc.run(study, '{tmp_path}', resume=True{more}) goes on" in note


FOUND = {"replicates": 40, "coverage": {"a": 0.9, "b": 0.8}, "standard_error": {"a": 0.05, "b": 0.06}}


def test_coverage_is_a_table_of_shares(sondes):
    made = Coverage(json.loads(json.dumps(FOUND)))
    assert made.table.loc["b"].to_dict() == {"share": 0.8, "standard_error": 0.06} and made.replicates == 40
    assert list(made.table.index) == ["a", "b"] and list(made.table.columns) == ["share", "standard_error"]
    assert repr(made).splitlines()[0] == "Coverage of 90 % intervals over 40 replicates" and "0.06" in repr(made)
    shown = made._repr_html_()
    assert "<b>Coverage over 40 replicates</b>" in shown and "<tr><td>b</td><td>0.800</td><td>0.060</td></tr>" in shown


def test_a_campaign_is_asked_with_its_progress(sondes, monkeypatch):
    asked, told = [], []

    def campaign(*given, progress):
        asked.append(given)
        if progress is not None:
            progress(0.5, "half")
        return FOUND

    monkeypatch.setattr(campaigns, "calibrate", campaign)
    tell = lambda *said: told.append(said)  # noqa: E731
    made = bc.calibrate(sondes, "out", 40, scenario="strong-gusts", noise="ar1", workers=2, quick=True, progress=tell)
    assert made.found is FOUND and told == [("calibrate", 0.5, "half")]
    bc.calibrate(sondes, "out")
    assert asked == [
        (sondes.spec, "out", 40, "strong-gusts", "ar1", 2, None, True),
        (sondes.spec, "out", 100, "none", None, 1, None, False),
    ]


def test_virtual_flights_are_flown_by_their_study(sondes, monkeypatch):
    monkeypatch.setattr(simulate, "simulate_study", lambda *given: given)
    assert bc.simulate_study(sondes, "out", 7, seed=0, workers=2, progress=print) == (
        sondes.spec,
        "out",
        7,
        0,
        print,
        2,
    )
    assert bc.simulate_study(sondes, "out") == (sondes.spec, "out", 1, None, None, 1)


def test_scenarios_are_told_in_words():
    told = bc.scenarios()
    assert list(told) == list(SCENARIOS) and "strong-gusts" in told
    assert all(told[name] == SCENARIOS[name].says and len(told[name]) > 10 for name in SCENARIOS)


def test_a_model_for_numpyro_is_of_one_set_of_flights(monkeypatch, sondes):
    models = import_module("bayeschute.posterior.numpyro_model")
    monkeypatch.setattr(models, "model", lambda marginal, priors: ("model", marginal, priors))
    group = lambda name: SimpleNamespace(found=SimpleNamespace(marginal=name), group=SimpleNamespace(priors=(name,)))  # noqa: E731
    assert bc.numpyro_model(verbs.Fit(sondes.spec, (group("a"),), {})) == ("model", "a", ("a",))
    assert bc.numpyro_model(SimpleNamespace(marginals=[("b", ("q",))])) == ("model", "b", ("q",))
    for source in (verbs.Fit(sondes.spec, (group("a"), group("b")), {}), SimpleNamespace(marginals=())):
        with pytest.raises(bc.InputError, match="numpyro_model: got [02] fits; wanted one set of flights"):
            bc.numpyro_model(source)


def test_a_verb_shows_its_progress_where_it_is_asked(sondes, monkeypatch, tmp_path):
    """Bars are closed when the work ends."""
    seen = []

    @contextmanager
    def bars():
        yield "bars"
        seen.append("closed")

    monkeypatch.setattr(console, "Bars", bars)
    monkeypatch.setattr(stages, "run_study", lambda *given, progress, **named: seen.append(progress))
    monkeypatch.setattr(simulate, "simulate_study", lambda *given: seen.append(given[4]))
    bc.run(sondes, tmp_path, progress=True)
    bc.simulate_study(sondes, tmp_path, progress=True)
    assert seen == ["bars", "closed"] * 2


def test_where_winds_come_from_is_refused_of_a_record_that_has_none(tmp_path):
    """It would change nothing, and would be believed."""
    columns = {"time": ("t", "s"), "altitude": ("h", "m")}
    with pytest.raises(InputError, match="'from' of a record without columns of the wind"):
        bc.read_record(tmp_path / "none.csv", columns, wind_is="from")
    with pytest.raises(InputError, match=r"none\.csv"):  # that there is no file is told where there is a wind
        bc.read_record(tmp_path / "none.csv", columns | {"wind.speed": ("v", "m/s")}, wind_is="from")
