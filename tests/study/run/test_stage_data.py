"""Records in, priors out: moments of priors from outside, notes on records, and what is refused."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from bayeschute.core.errors import InputError
from bayeschute.dynamics.parameters import BIASES
from bayeschute.records.record import Repair, repairs
from bayeschute.study.run import stage_data as module


def moments(mean=None, sd=None):
    return SimpleNamespace(log_normal=False, mean=mean, sd=sd)


def log_normal(median, log_sd):
    return SimpleNamespace(log_normal=True, median=median, log_sd=log_sd)


def test_what_may_be_negative_keeps_its_moments():
    made = module._given("capsule_pitch_damping", moments(-0.2, 0.1), "1")
    assert (made.centre, made.scale, made.logarithmic, made.unit) == (-0.2, 0.1, False, "1")
    assert (made.name, made.source) == ("capsule_pitch_damping", "given in the study")


@pytest.mark.parametrize("name", ["riser_stiffness", "riser_damping", "enclosed_air_factor", "cds_over_mass"])
def test_what_must_be_positive_is_log_normal_with_the_moments_given(name):
    made = module._given(name, moments(2.0, 0.5), "u")
    assert made.logarithmic and made.unit == "u"
    mean = np.exp(made.centre + 0.5 * made.scale**2)
    assert mean == pytest.approx(2.0) and mean * np.sqrt(np.expm1(made.scale**2)) == pytest.approx(0.5)
    made = module._given(name, log_normal(3.0, 0.4), "u")
    assert (made.centre, made.scale, made.logarithmic) == (pytest.approx(np.log(3.0)), 0.4, True)


def test_a_log_normal_law_of_what_is_fitted_as_a_value_has_its_moments():
    """Against draws of that law."""
    made = module._given("riser_length", log_normal(70.0, 0.3), "m")
    x = 70.0 * np.exp(0.3 * np.random.default_rng(0).standard_normal(400_000))
    assert not made.logarithmic
    assert made.centre == pytest.approx(x.mean(), rel=2e-3) and made.scale == pytest.approx(x.std(), rel=5e-3)


def test_priors_from_outside_are_those_that_are_there_with_their_units():
    given = SimpleNamespace(**dict.fromkeys([*module._GIVEN, *BIASES]))
    given.riser_length, given.capsule_mass, given.riser_damping = (
        moments(70.0, 1.0),
        moments(9.0, 1.0),
        moments(5.0, 1.0),
    )
    given.wind_bias = SimpleNamespace(sd=2.0)
    made = module.given_priors(SimpleNamespace(priors=SimpleNamespace(given=given)))
    units = {"riser_length": "m", "capsule_mass": "kg", "riser_damping": "N s/m"}
    assert {p.name: p.unit for p in made} == units | {"wind_bias.north": "m/s", "wind_bias.east": "m/s"}
    assert all((p.centre, p.scale, p.logarithmic) == (0.0, 2.0, False) for p in made if p.name.startswith("wind"))


def test_what_is_no_coefficient_does_not_differ_between_canopies():
    given = SimpleNamespace(**dict.fromkeys([*module._GIVEN, *BIASES]))
    given.riser_length = SimpleNamespace(log_normal=False, mean=70.0, sd=1.0)
    priors = SimpleNamespace(vary=("q",), vary_canopies=("riser_length",), given=given, inflation=1.0, floor=0.1)
    study = SimpleNamespace(priors=priors, structure=None, vehicle=None, knowledge=(), with_role=lambda role: ())
    selected = {"coefficients": {"axial": {"selected": [{"term": "1", "estimate": 1.0, "se": 0.1}]}}}
    with pytest.raises(InputError) as told:
        module.priors(SimpleNamespace(study=study, load=lambda name: selected))
    assert "[priors] vary: got q" in str(told.value)
    assert "[priors] vary_canopies: got riser_length; wanted coefficients of the fit: axial[1]" in str(told.value)


@pytest.mark.parametrize(("fit", "want"), [(None, "selected"), ("selected", "selected"), ("search", "library")])
def test_coefficients_are_of_the_selected_terms_or_of_all(monkeypatch, fit, want):
    for name in ("library", "selected"):
        monkeypatch.setattr(module, f"of_{name}", lambda study, kind, entry, source, n=name: [(n, kind, entry, source)])
    monkeypatch.setattr(module, "at_own_apparent_mass", lambda study, priors: priors)
    structure = None if fit is None else SimpleNamespace(fit=fit)
    flights = [SimpleNamespace(name="x"), SimpleNamespace(name="y")]
    study = SimpleNamespace(structure=structure, with_role=lambda role: flights if role == "structure" else [])
    found = {"axial": 1, "transverse": 2}
    assert module.of_structure(study, found) == [(want, kind, entry, "x, y") for kind, entry in found.items()]


def record(**values):
    """A record of a second, five samples."""
    time = 10.0 + 0.25 * np.arange(5)
    return xr.Dataset({name: ("time", np.asarray(v, float)) for name, v in values.items()}, {"time": time})


def test_channels_that_are_not_fitted_are_noted_with_the_reason(monkeypatch):
    monkeypatch.setattr(module, "fitted_channels", lambda record, channels: ("a",))
    made = module._not_fitted(record(a=np.ones(5), b=np.full(5, np.nan), c=np.ones(5)), ("a", "b", "c", "d"))
    assert {r.variable: r.detail for r in made} == {
        "b": "without a value: it is not fitted", "c": "derived: it is not fitted", "d": "not recorded: it is not fitted",
    }  # fmt: skip
    assert {(r.kind, r.start, r.end, r.count) for r in made} == {("assumed", 10.0, 11.0, 0)}


@pytest.fixture
def steps(monkeypatch):
    """What preparing a record asked for, by name."""
    seen = {}

    def noted(name, made=None):
        return lambda record, *given: seen.update({name: given}) or (record if made is None else made(record))

    used = SimpleNamespace(start=1.0, end=2.0, words="")
    monkeypatch.setattr(module, "window_used", lambda *given: seen.update(used=given[1:]) or used)
    monkeypatch.setattr(module, "remove_velocity_bias", noted("bias", lambda record: (record, None)))
    for name in ("clean", "derive", "with_wind"):
        monkeypatch.setattr(module, name, noted(name))
    monkeypatch.setattr(module, "_not_fitted", lambda record, channels: seen.update(noted=channels) or [])
    return seen, used


def flight(**changes):
    usual = dict(
        name="f", rate=None, window=("w",), virtual=None, skip_first=0.5, roles=("predict",), wind_profile=None,
        remove_velocity_bias=False,
    )  # fmt: skip
    return SimpleNamespace(**usual | changes)


def a_study(model="cluster"):
    return SimpleNamespace(model=model, noise=SimpleNamespace(channels=lambda: {"a": 1, "b": 2}))


def test_a_measured_record_is_cut_to_the_window_used_and_derived_from(steps):
    seen, used = steps
    module.prepared(a_study(), flight(), record(a=np.ones(5)))
    assert seen == {"used": (("w",), 0.5, ("predict",)), "clean": (4.0, (1.0, 2.0), 0.5), "derive": ()}
    used.words = "the rest stands on the ground"
    made = module.prepared(a_study(), flight(rate=2.0), record(a=np.ones(5)))
    (note,) = repairs(made)
    assert (note.kind, note.start, note.end, note.detail) == ("skipped", 1.0, 2.0, used.words)
    assert seen["clean"][0] == 2.0


def test_a_virtual_drop_of_a_cluster_has_all_quantities_and_its_own_window(steps):
    seen, _ = steps
    module.prepared(a_study(), flight(virtual=1), record(a=np.ones(5)))
    assert seen == {"clean": (4.0, ("w",), 0.5)}
    module.prepared(a_study("descent"), flight(virtual=1), record(a=np.ones(5)))
    assert "derive" in seen


def test_bias_wind_and_notes_come_where_they_are_wanted(steps):
    seen, _ = steps
    some = flight(roles=("identify",), remove_velocity_bias=True, wind_profile="profile")
    module.prepared(a_study(), some, record(a=np.ones(5)))
    assert seen["bias"] == () and seen["with_wind"] == ("profile",) and seen["noted"] == ("a", "b")
    seen.clear()
    module.prepared(a_study("descent"), some, record(a=np.ones(5)))
    assert "noted" not in seen


@pytest.fixture
def drop(monkeypatch):
    """A virtual drop whose simulation is set by the test."""
    monkeypatch.setattr(module.canopies, "flown", lambda *given: "sewn")
    monkeypatch.setattr(module.assemble, "cluster", lambda vehicle, mass, sewn: (vehicle, (mass, sewn)))
    monkeypatch.setattr(module.assemble, "drop", lambda virtual, quick: (virtual, quick))
    study = SimpleNamespace(vehicle_of=lambda flight: "vehicle")
    return study, SimpleNamespace(name="f", virtual="drop", capsule_mass=9.0)


def test_a_drop_that_fails_on_the_way_says_from_when_it_is_not_to_be_relied_on(drop, monkeypatch):
    made = record(a=np.ones(5))
    given = []
    monkeypatch.setattr(module, "fly", lambda *what: given.append(what) or (made, "truth"))
    assert module.flown(*drop, 7, True) == (made, "truth") and not repairs(made)
    assert given == [(("drop", True), "vehicle", (9.0, "sewn"), 7)]
    made.attrs.update(failed_at_s=10.5, outcome="slack")
    (note,) = repairs(module.flown(*drop, 7)[0])
    assert (note.kind, note.start, note.end, note.count) == ("simulation", 10.5, 11.0, 3)
    assert note.detail == "slack: not to be relied on from here"


def test_a_drop_that_leaves_the_finite_numbers_is_told_with_its_name(drop, monkeypatch):
    def fails(*given):
        raise FloatingPointError("infinite at 3 s")

    monkeypatch.setattr(module, "fly", fails)
    with pytest.raises(InputError, match="flight f.*infinite at 3 s"):
        module.flown(*drop, 7)


def test_a_truth_is_stored_at_the_times_of_the_record_and_without_its_notes(tmp_path, monkeypatch):
    truth = record(altitude=np.arange(5.0)).assign_attrs(repairs="[]", outcome="ok")
    kept = record(altitude=np.ones(5)).isel(time=[1, 3, 4]).assign_coords(time=[10.25, 10.875, 11.0 + 1e-9])
    monkeypatch.setattr(module, "flown", lambda study, flight, seed, quick: ("raw", truth))
    monkeypatch.setattr(module, "prepared", lambda study, flight, raw: kept)
    monkeypatch.setattr(module.assemble, "flight_seed", lambda study, flight: 1)
    (tmp_path / "flights").mkdir()
    for one in (truth, kept):
        one["altitude"].attrs["units"] = "m"
    job = SimpleNamespace(study=None, quick=False, out=tmp_path)
    assert module.ingest_flight(job, flight(virtual=1)) is kept
    stored = xr.load_dataset(tmp_path / "flights" / "f.truth.nc", engine="h5netcdf")
    np.testing.assert_allclose(stored["altitude"], [1.0, 3.5, 4.0])
    np.testing.assert_array_equal(stored["time"], kept["time"])
    assert stored.attrs == {"outcome": "ok"} and (tmp_path / "flights" / "f.nc").exists()
    module.ingest_flight(job, flight(name="g"), "raw")
    assert not (tmp_path / "flights" / "g.truth.nc").exists()


def test_repairs_that_are_no_matter_of_course_are_counted(monkeypatch):
    kinds = ("resampled", "derived", "assumed", "gap", "spike")
    monkeypatch.setattr(module, "read_and_judge", lambda job, flight: None)
    monkeypatch.setattr(module, "ingest_flight", lambda job, flight, raw: None)
    monkeypatch.setattr(module, "repairs", lambda record: [Repair(k, "", 0.0, 1.0, 1, "") for k in kinds])
    said = []
    flights = [flight(name="f"), flight(name="g")]
    job = SimpleNamespace(study=SimpleNamespace(flights=flights), say=lambda stage: lambda *words: said.append(words))
    assert module.ingest(job) == "2 flights, 4 repairs listed" and said == [(0.5, "f"), (1.0, "g")]


def test_only_measured_records_are_judged(monkeypatch):
    monkeypatch.setattr(module, "refuse_implausible", lambda study, flight, record: [f"{record} is odd"])
    monkeypatch.setattr(module, "as_read", lambda flight: "read")
    said = []
    job = SimpleNamespace(study=None, say=lambda stage: lambda *words: said.append((stage, *words)))
    assert module.read_and_judge(job, flight(virtual=1)) is None and not said
    assert module.read_and_judge(job, flight()) == "read" and module.read_and_judge(job, flight(), "given") == "given"
    assert said == [("ingest", 0.0, "warning: read is odd"), ("ingest", 0.0, "warning: given is odd")]
