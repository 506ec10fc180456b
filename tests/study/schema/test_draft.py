"""A study as far as its tables are valid: whose vehicle, where, and whether all flights are there."""

from __future__ import annotations

from types import SimpleNamespace

from bayeschute.study.schema.draft import Draft

RAW = {"flight": [{"name": "a"}, {"name": "b"}, {"name": "c"}]}
FLIGHTS = {
    0: SimpleNamespace(vehicle=None),
    1: SimpleNamespace(vehicle="own.toml"),
    2: SimpleNamespace(vehicle="bad.toml"),
}


def test_a_flight_has_its_own_vehicle_or_that_of_the_file_but_never_that_for_its_own():
    draft = Draft("x.toml", RAW, {}, FLIGHTS, "of the file", {1: "its own"})
    assert [draft.vehicle_of(i) for i in FLIGHTS] == ["of the file", "its own", None]


def test_flights_are_complete_where_each_of_the_file_is_there():
    assert Draft("x.toml", RAW, {}, FLIGHTS).flights_complete
    assert not Draft("x.toml", RAW, {}, {0: FLIGHTS[0]}).flights_complete
    assert not Draft("x.toml", {"flight": {}}, {}, {}).flights_complete and not Draft("x.toml", {}, {}).flights_complete


def test_places_have_the_names_of_its_flights_and_a_model_may_lack():
    draft = Draft("x.toml", RAW, {"model": "descent"}, FLIGHTS)
    assert draft.at("flight", 1, "window") == "x.toml [flight] window (flight 'b')"
    assert draft.model == "descent" and Draft("x.toml", RAW, {}).model is None
