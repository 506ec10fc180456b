"""What `fit`, `sample` and `update` share: which flights, by which tables, in which order the stages are called."""

from __future__ import annotations

import json
from contextlib import contextmanager
from dataclasses import replace
from types import SimpleNamespace

import pytest

import bayeschute as bc
from bayeschute import console
from bayeschute.api import fitting
from bayeschute.api.fitting import chosen, drawn, fitted_flights, ingest, sampling, shown, spec_of
from bayeschute.api.workspace import workspace
from bayeschute.likelihood.priors import Prior
from bayeschute.study.assembly import fits
from bayeschute.study.run import stage_check, stage_data, stage_fit, stage_structure


@pytest.fixture(scope="module")
def low(sondes):
    return sondes.flights["low"]


@pytest.fixture(scope="module")
def high(sondes):
    return sondes.flights["high"]


def test_progress_goes_to_who_asks_for_it(monkeypatch):
    """Bars where True says so, closed at the end; nothing where nothing is asked."""
    told = []

    @contextmanager
    def bars():
        yield "bars"
        told.append("closed")

    monkeypatch.setattr(console, "Bars", bars)
    function = told.append
    for given, wanted in ((None, None), (False, None), (function, function), (True, "bars")):
        with shown(given) as made:
            assert made is wanted and not told
    assert told == ["closed"]


def test_of_a_study_those_that_have_a_part_in_its_fit_are_chosen(sondes):
    flights = tuple(
        replace(sondes.spec.flights[0], name=name, roles=roles)
        for name, roles in (("a", ("identify", "predict")), ("b", ("predict",)), ("c", ("structure",)), ("d", ()))
    )
    study = bc.Study(replace(sondes.spec, flights=flights))
    assert [flight.name for flight in chosen(study)] == ["a", "c"]
    one = study.flights["b"]
    assert chosen(one) == [one] and chosen((one, one)) == [one, one] and chosen([]) == []


def test_a_study_of_flights_has_the_tables_of_the_first_and_no_requirement(low, high, sondes):
    other = bc.Study(replace(sondes.spec, seed=99, title="other")).flights["high"]
    made = spec_of([low, other], ("structure", "identify"))
    assert (made.seed, made.title, [f.name for f in made.flights]) == (4, sondes.title, ["low", "high"])
    assert sondes.spec.requirements and made.requirements == () and made.vehicle is None
    assert made.flights[0] == replace(low.spec, roles=("identify",))
    assert spec_of([other, low], ("identify",)).seed == 99


def test_roles_that_are_not_asked_for_go_and_who_has_none_gets_them_all(low, high):
    only = high.changed(roles=("predict",))
    made = spec_of([low.changed(roles=("structure", "identify", "predict")), only], ("structure", "identify"))
    assert [flight.roles for flight in made.flights] == [("structure", "identify")] * 2
    assert [f.roles for f in spec_of([low, only], ("predict",)).flights] == [("predict",)] * 2


def test_only_another_vehicle_than_the_firsts_is_told_of_a_flight():
    study = bc.Study.example()
    one = study.flights[0]
    vehicle = study.vehicle.model_copy(update={"name": "another"})
    other, alike = one.changed(name="other", vehicle=vehicle), one.changed(name="alike", vehicle=study.vehicle)
    assert [f.vehicle for f in spec_of([one, other, alike], ("identify",)).flights] == [None, vehicle, None]
    made = spec_of([other, one], ("identify",))
    assert made.vehicle == vehicle and [f.vehicle for f in made.flights] == [None, study.vehicle]


def test_no_flight_and_two_of_one_name_are_refused(low):
    with pytest.raises(bc.InputError, match="flights: got none; wanted at least one flight"):
        spec_of([], ("identify",))
    with pytest.raises(bc.InputError, match="low, low; wanted flights of different names. Use `Flight.changed`"):
        spec_of([low, low], ("identify",))


def test_records_are_read_each_for_its_own_flight(low, high, monkeypatch):
    told = []
    monkeypatch.setattr(stage_data, "read_and_judge", lambda job, spec, raw: (spec.name, raw))
    monkeypatch.setattr(stage_data, "ingest_flight", lambda job, spec, read: told.append((spec.name, read)))
    pair = [SimpleNamespace(raw="first"), SimpleNamespace(raw="second")]
    with workspace(spec_of([low, high], ("identify",))) as job:
        ingest(job, pair)
        assert told == [("low", ("low", "first")), ("high", ("high", "second"))]
        with pytest.raises(ValueError):
            ingest(job, pair[:1])


@pytest.fixture
def stages(monkeypatch):
    """Stages that leave a file each, and tell when they were called."""
    called = []

    def stage(name):
        def left(job, *more):
            called.append((name, job.study, *more))
            (job.out / "fit").mkdir(exist_ok=True)
            (job.out / "fit" / f"{name}.txt").write_text(name)

        return left

    monkeypatch.setattr(fitting, "ingest", stage("ingest"))
    monkeypatch.setattr(stage_structure, "structure", stage("structure"))
    monkeypatch.setattr(stage_data, "priors", stage("priors"))
    monkeypatch.setattr(stage_fit, "fit_structures", stage("structures"))
    monkeypatch.setattr(fits, "groups", lambda job: ["one", "two"])
    monkeypatch.setattr(
        stage_fit, "fit_group", lambda job, group, say: called.append((group, job.study)) or say(0.5, group) or f"fit of {group}"
    )  # fmt: skip
    return called


def test_without_priors_structure_and_the_studys_own_are_asked(low, high, stages):
    told = []
    spec, made, files = fitted_flights([low, high], None, None, None, lambda *said: told.append(said))
    assert [one[0] for one in stages] == ["ingest", "structure", "priors", "structures", "one", "two"]
    assert all(one[1] is spec for one in stages) and stages[0][2] == [low, high]
    assert made == ("fit of one", "fit of two") and told == [("fit", 0.5, "one"), ("fit", 0.5, "two")]
    assert set(files) == {f"fit/{name}.txt" for name in ("ingest", "structure", "priors", "structures")}
    assert spec == spec_of([low, high], ("structure", "identify"))


def test_without_a_study_the_first_records_own_noise_is_taken(low, high, stages, monkeypatch):
    alone = [bc.Flight(stage_data.as_read(one.spec), name=one.name) for one in (low, high)]
    quiet, loud = (
        bc.noise({"descent_rate": {"white": f"{sd} m/s", "correlated": "1 m/s", "time_constant": "3 s"}})
        for sd in (0.1, 3.0)
    )
    monkeypatch.setattr(bc.Flight, "usual_noise", lambda flight: quiet if flight.name == "low" else None)
    assert fitted_flights(alone, None, None, None, None)[0].noise == quiet
    assert fitted_flights(alone, None, loud, None, None)[0].noise == loud


def test_priors_that_are_given_take_the_place_of_two_stages(low, sondes, stages):
    found = {"coefficients": {"axial": {}}}
    given = (Prior("b", 0.0, 1.0, False, "1", "x"), Prior("cds_over_mass", -2.0, 0.5, True, "m^2/kg", "y"))
    priors = replace(sondes.priors, parameters=given, found=found)
    spec, _, files = fitted_flights([low], priors, None, None, None)
    assert [one[0] for one in stages] == ["ingest", "structures", "one", "two"]
    assert json.loads(files["structure.json"]) == found
    stored = [Prior(**one) for one in json.loads(files["priors.json"])]
    assert stored == list(stage_data.in_order(spec, list(given))) and {one.name for one in stored} == {
        "b",
        "cds_over_mass",
    }
    none = fitted_flights([low], replace(priors, found=None), None, None, None)[2]
    assert json.loads(none["structure.json"]) == {"coefficients": {}}


def test_tables_of_priors_noise_and_seed_replace_the_studys(low, sondes, stages):
    table = sondes.spec.priors.model_copy(update={"inflation": 7.0})
    candidates = bc.Study.example().candidates
    loud = bc.noise({"descent_rate": {"white": "3 m/s", "correlated": "1 m/s", "time_constant": "3 s"}})
    priors = replace(sondes.priors, table=table, candidates=candidates)
    spec, _, _ = fitted_flights([low], priors, loud, 0, None)
    assert (spec.priors, spec.structure, spec.noise, spec.seed) == (table, candidates, loud, 0)
    spec, _, _ = fitted_flights([low], replace(priors, candidates=None), None, None, None)
    assert (spec.priors, spec.structure, spec.noise, spec.seed) == (table, None, sondes.noise, 4)


def test_knowledge_that_priors_include_is_told_once(low, sondes, stages):
    """What the study compares with stays; what it took for its own priors goes; of one name the study's stays."""
    known = [SimpleNamespace(name=name, use=use) for name, use in (("a", "compare"), ("b", "prior"))]
    of_priors = [SimpleNamespace(name=name, use="prior") for name in ("c", "a")]
    flight = bc.Study(replace(sondes.spec, knowledge=tuple(known))).flights["low"]
    spec, _, _ = fitted_flights([flight], replace(sondes.priors, known=tuple(of_priors)), None, None, None)
    assert spec.knowledge == (known[0], of_priors[0])
    assert fitted_flights([flight], None, None, None, None)[0].knowledge == tuple(known)


@pytest.mark.parametrize(
    ("asked", "sizes"),
    [
        ((None, None, None, None, None), ("nuts", 2, 50, 100, 4)),
        ((300, None, None, None, None), ("nuts", 2, 50, 150, 4)),
        ((301, None, None, None, None), ("nuts", 2, 50, 151, 4)),
        ((300, 3, None, None, None), ("nuts", 3, 50, 100, 4)),
        ((None, 5, 77, 0, "emcee"), ("emcee", 5, 77, 100, 0)),
    ],
)
def test_draws_are_counted_over_all_chains(sondes, asked, sizes):
    made = sampling(sondes.spec, *asked)
    table = made.sampler
    assert (table.kind, table.chains, table.warmup, table.draws, made.seed) == sizes
    assert replace(made, sampler=sondes.spec.sampler, seed=4) == sondes.spec


def test_sizes_out_of_range_are_told_with_their_table(sondes):
    for given, words in (
        ((None, 1, None, None, None), "sample.*chains"), ((None, None, 3, None, None), "sample.*warmup"),
        ((60, 2, None, None, None), "draws: got 30"), ((None, None, None, None, "gibbs"), "sample.*kind"),
    ):  # fmt: skip
        with pytest.raises(bc.InputError, match=words):
            sampling(sondes.spec, *given)


def test_fits_are_drawn_from_stored_and_checked_before_they_are_read(sondes, monkeypatch):
    called, told = [], []
    monkeypatch.setattr(stage_fit, "draw_group", lambda job, one, say: called.append(one) or say(0.25, one) or f"draws of {one}")  # fmt: skip
    monkeypatch.setattr(stage_fit, "store", lambda job, made, draws: called.append((made, draws)))
    monkeypatch.setattr(stage_check, "check", lambda job: called.append("checked"))

    def read(folder, spec):
        called.append("read")
        return (folder / "fit" / "a.npz").read_bytes(), spec

    made = drawn(sondes.spec, ["one", "two"], {"fit/a.npz": b"7"}, lambda *said: told.append(said), read)
    assert made == (b"7", sondes.spec) and told == [("fit", 0.25, "one"), ("fit", 0.25, "two")]
    assert called == ["one", "two", (["one", "two"], ["draws of one", "draws of two"]), "checked", "read"]
