"""`Flight` and `Flights`: made of a record or changed, and what they say of record, repairs and plausibility."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest

import bayeschute as bc
from bayeschute.api import flight as module
from bayeschute.api.flight import Flight, Flights, Repairs, flight_rows, wind_profile
from bayeschute.core.errors import InputError
from bayeschute.records.record import Repair
from bayeschute.study import plausible
from bayeschute.study.load import usual_study
from bayeschute.study.run import stage_data
from bayeschute.study.schema.vehicle_schema import NOT_FLOWN


@pytest.fixture(scope="module")
def low(sondes):
    return sondes.flights["low"]


@pytest.fixture(scope="module")
def drop():
    return bc.Study.example().flights["cdt-3-12"]


@pytest.fixture
def raw(descents):
    columns = {"time": ("time_s", "s"), "altitude": ("altitude_m", "m")}
    return bc.read_record(descents.study.with_name("low.csv"), columns)


def test_a_wind_is_of_numbers_in_si():
    wind = wind_profile([0, 100.5, 2000.0], np.array([3.0, 0.1, -1.0]), [1.0, -2.0, 1e-9], down=[0.5, 0.0, -0.25])
    np.testing.assert_array_equal(
        wind.rows(), [[0.0, 3.0, 1.0, 0.5], [100.5, 0.1, -2.0, 0.0], [2000.0, -1.0, 1e-9, -0.25]]
    )
    still = wind_profile([0.0, 10.0], [1.0, 2.0], [3.0, 4.0])
    np.testing.assert_array_equal(still.rows(), [[0.0, 1.0, 3.0, 0.0], [10.0, 2.0, 4.0, 0.0]])
    square = wind_profile([[0.0], [10.0]], [[1.0], [2.0]], [[3.0], [4.0]])
    assert square == still


def test_a_wind_may_be_in_other_units():
    """Of altitudes, and of velocities."""
    made = wind_profile([0.0, 1000.0], [10.0, -20.0], [0.0, 5.0], units=("ft", "kt"))
    knot = 1852.0 / 3600.0
    np.testing.assert_allclose(made.rows(), [[0.0, 10.0 * knot, 0.0, 0.0], [304.8, -20.0 * knot, 5.0 * knot, 0.0]])
    for units in (("m", "ft"), ("kt", "kt"), ("m", "metres")):
        with pytest.raises(bc.InputError, match="wind_profile"):
            wind_profile([0.0, 10.0], [1.0, 2.0], [3.0, 4.0], units=units)


def test_priors_of_a_flight_without_a_study_are_about_its_vehicle(drop):
    risers = drop.vehicle.risers.model_copy(update={"length": 61.0})
    made = bc.Flight(drop.record, drop.vehicle.model_copy(update={"risers": risers})).priors
    (length,) = [p for p in made.parameters if p.name == "riser_length"]
    assert length.centre == 61.0 and "canopy_position_bias.north" in made.names and "axial[1]" not in made.names
    more = made | bc.Priors.given(capsule_normal_force_slope={"mean": 0.8, "sd": 0.2})
    assert set(more.names) == {*made.names, "capsule_normal_force_slope"} and more.candidates == made.candidates


@pytest.mark.parametrize(
    "columns",
    [
        ([0.0, 0.0], [1.0, 1.0], [1.0, 1.0]), ([0.0, 1.0], [1.0], [1.0, 1.0]), ([0.0, 1.0], [1.0, np.nan], [1.0, 1.0]),
        ([0.0, 1.0], [1.0, 1.0], [1.0, 1.0], [0.0]),
    ],
)  # fmt: skip
def test_a_wind_that_is_none_is_refused(columns):
    with pytest.raises(bc.InputError, match="wind_profile"):
        wind_profile(*columns)


def test_repairs_are_lines():
    some = Repairs((Repair("gap", "altitude", 1.0, 2.25, 12, "too long"), Repair("derived", "density", 0.0, 79.0, 80)))
    assert repr(some).splitlines() == [
        "gap           altitude                            1.0 to        2.2 s     12 samples too long",
        "derived       density                             0.0 to       79.0 s     80 samples ",
    ]
    assert repr(Repairs()) == "nothing was changed" and some[0].count == 12


def test_of_a_record_alone_a_point_mass_is_made(raw):
    flight = Flight(raw)
    assert flight.name == "flight" and flight.roles == ("structure", "identify") and flight.vehicle is None
    assert flight.raw is raw and flight.source == "in memory" and flight.study.model == "descent"
    assert flight.study == replace(usual_study("descent"), flights=(flight.spec,), title="flight")
    assert flight.spec.path is None and flight.spec.window is None and flight.spec.rate is None
    assert flight.truth is None and flight.record.sizes["time"] == 80


def test_with_a_vehicle_it_is_a_cluster(raw, drop):
    flight = Flight(raw, drop.vehicle, name="mine")
    assert flight.study.model == "cluster" and flight.vehicle == drop.vehicle == flight.study.vehicle
    assert flight.study.title == "mine" and flight.spec.vehicle is None


def test_all_that_a_flight_is_made_by_is_kept(raw):
    wind = wind_profile([0.0, 100.0], [1.0, 2.0], [0.0, 0.0])
    given = {"capsule_mass": "9 t", "identify_until": "65 %", "roles": ("identify",), "accept_implausible": ("clock",)}
    flight = Flight(raw, name="a", wind=wind, window=("5 s", 60), rate=2, **given)
    spec = flight.spec
    assert (spec.window, spec.rate, spec.capsule_mass, spec.roles) == ((5.0, 60.0), 2.0, 9000.0, ("identify",))
    assert spec.wind_profile is wind and spec.accept_implausible == ("clock",)
    assert spec.identify_until.at(0.0, 100.0) == 65.0
    assert flight == flight and flight.changed(skip_first="3 s", window=None).spec.skip_first == 3.0
    for wrong, where in (({"rate": "2 m"}, "rate"), ({"roles": ("fly",)}, "roles"), ({"wind": 3.0}, "wind")):
        with pytest.raises(bc.InputError, match=f"flight.*{where}"):
            Flight(raw, **wrong)


def test_a_change_is_of_what_is_said_and_nothing_else(low):
    for values, wanted in (
        ({"name": "x"}, {"name": "x"}), ({"rate": 4}, {"rate": 4.0}), ({"skip_first": 2.5}, {"skip_first": 2.5}),
        ({"roles": ["predict"]}, {"roles": ("predict",)}), ({"capsule_mass": 9e3}, {"capsule_mass": 9e3}),
        ({"window": [1.0, "20 s"]}, {"window": (1.0, 20.0)}), ({"rate": None}, {"rate": None}),
        ({"wind": None}, {"wind_profile": None}), ({}, {}),
    ):  # fmt: skip
        made = low.changed(**values)
        assert made.spec == replace(low.spec, **wanted) and made.study is low.study and made.raw is low.raw
    with pytest.raises(bc.InputError) as caught:
        low.changed(rates=2.0, mas=3.0)
    assert [fault.got for fault in caught.value.faults] == ["mas", "rates"]
    assert "Did you mean 'rate'" in caught.value.faults[1].do


@pytest.mark.parametrize(
    "name", ["", "a/b", "../../a", "a\\b", ".hidden", "..", "a\nb", "a\0b", 61 * "x", None, 3]
)  # fmt: skip
def test_a_name_that_is_no_file_name_is_refused(raw, low, name):
    """Records lie in files of their flights' names; others would be lost, or lie outside their folder."""
    for make in (lambda: Flight(raw, name=name), lambda: low.changed(name=name)):
        with pytest.raises(bc.InputError, match="flight name: got .* It becomes a file name"):
            make()


@pytest.mark.parametrize("name", ["drop 3", "drop.1", "Fallschirm-Ü", "<script>", 60 * "x"])
def test_other_names_are_kept(raw, low, name):
    assert Flight(raw, name=name).name == low.changed(name=name).name == name


@pytest.mark.parametrize(
    "values", [{"rate": True}, {"capsule_mass": True}, {"window": (True, 60.0)}, {"skip_first": False}]
)
def test_true_and_false_are_no_numbers(low, values):
    with pytest.raises(bc.InputError, match=f"flight.*{next(iter(values))}"):
        low.changed(**values)


def test_another_payload_than_that_of_the_record_is_told(raw, drop):
    """Where a forecast starts from a record; a virtual drop starts with its own payload."""
    flight = Flight(raw, name="a", capsule_mass="9 t")
    with pytest.warns(UserWarning, match="'a' was flown with 9000 kg. A forecast with 10000 kg starts from the first"):
        assert flight.changed(capsule_mass="10 t").spec.capsule_mass == 10_000.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        flight.changed(capsule_mass=9000.0, name="b")
        drop.changed(capsule_mass=9000.0)


def test_a_virtual_drop_flies_another_vehicle_only_with_aerodynamics(drop, low):
    other = drop.vehicle.model_copy(update={"name": "other"})
    assert drop.changed(vehicle=other).vehicle == other and drop.changed(name="x").vehicle == drop.vehicle
    assert drop.changed(vehicle=other).changed(name="x").vehicle == other
    bare = drop.vehicle.model_copy(update={"aero": NOT_FLOWN, "name": "bare"})
    with pytest.raises(bc.InputError, match=r"'bare' without \[aero\]; wanted one that virtual drops can fly with"):
        drop.changed(vehicle=bare)
    assert low.changed(vehicle=bare).vehicle == bare  # a record needs none


def test_where_a_record_comes_from(low, drop, raw):
    assert (low.source, drop.source, Flight(raw).source) == ("low.csv", "virtual drop", "in memory")
    assert repr(low) == "Flight('low', identify+predict, low.csv)"


def test_the_record_is_prepared_once_by_the_flights_own_table(low, monkeypatch):
    """Also of a flight that its study does not list, or lists otherwise; the truth is where the drop is virtual."""
    called, ingest = [], stage_data.ingest_flight
    monkeypatch.setattr(stage_data, "ingest_flight", lambda job, spec, raw: called.append((job.study.flights, spec, raw)) or ingest(job, spec, raw))  # fmt: skip
    slower = low.changed(rate=0.5)
    assert slower.record.sizes["time"] == 40 and slower.record is slower.record and slower.truth is None
    (flights, spec, given), *rest = called
    assert not rest and spec is slower.spec and given is None
    assert flights == (slower.spec, low.study.flights[1])
    low.changed(name="third").record  # noqa: B018
    assert [f.name for f in called[1][0]] == ["low", "high", "third"]


def test_what_was_done_to_a_record_is_told(low):
    kinds = {one.kind for one in low.repairs}
    assert isinstance(low.repairs, Repairs) and "derived" in kinds
    shown = low._repr_html_()
    time = low.record["time"].values
    assert f"{time.size} samples from {time[0]:g} s to {time[-1]:g} s, {len(low.repairs)} repairs" in shown
    assert shown.count("<tr>") == 1 + len(low.record.data_vars) and "<b>low</b>" in shown
    assert "<td>altitude</td><td>80</td><td>m</td>" in shown
    assert len(low.plot().axes) >= 1


def judged(monkeypatch, flight, noise=None, told=("told",), shown=("shown",)):
    """What a flight's plausibility asks: arguments of its steps, and the noise that it tells."""
    asked = {}

    def kept(name, answer):
        return lambda *given, **more: asked.__setitem__(name, given) or answer

    monkeypatch.setattr(plausible, "window_used", lambda *given: asked.__setitem__("window", given) or plausible.DescentWindow(1.0, 9.0, ()))  # fmt: skip
    monkeypatch.setattr(plausible, "axes_said", kept("axes", "x y z"))
    monkeypatch.setattr(plausible, "judge", kept("judge", "verdict"))
    monkeypatch.setattr(plausible, "noise_told", kept("told", list(told)))
    monkeypatch.setattr(plausible, "noise_shown", kept("shown", list(shown)))
    return flight.plausibility(noise), asked


def test_a_record_is_judged_as_read_over_what_is_used(monkeypatch, low):
    wind = wind_profile([0.0, 100.0], [1.0, 2.0], [0.0, 0.0])
    flight = low.changed(wind=wind, capsule_mass=5.0, skip_first=2.0, accept_implausible=("clock",))
    made, asked = judged(monkeypatch, flight)
    record = made.record
    assert record.equals(stage_data.as_read(flight.spec)) and (made.name, made.verdict) == ("low", "verdict")
    assert asked["judge"] == (record, None, 5.0, (1.0, 9.0), wind, "x y z")
    assert asked["window"] == (record, None, 2.0, ("identify", "predict"))
    assert asked["axes"] == (record, flight.spec.path, flight.spec.conventions)
    assert made.accepted == ("clock",) and made.noise == ("told",) and asked["told"][1] is low.study.noise


def test_a_virtual_drop_is_judged_as_flown_by_the_vehicles_laws(monkeypatch, drop, low):
    short = replace(drop.study, model="cluster")
    flight = Flight.of_study(short, drop.spec)
    object.__setattr__(flight, "_prepared", (low.record, None))
    made, asked = judged(monkeypatch, flight)
    mass = drop.spec.capsule_mass
    assert made.record is low.record and asked["judge"] == (low.record, drop.vehicle, mass, None, None, None)
    assert asked["window"][3] == () and "axes" not in asked
    descent = Flight.of_study(replace(short, model="descent"), drop.spec)
    object.__setattr__(descent, "_prepared", (low.record, None))
    assert judged(monkeypatch, descent)[1]["judge"][1] is None


def test_noise_is_told_of_what_is_fitted(monkeypatch, low, raw):
    """By the noise that is given, else by the study file's; what the record shows where there is none."""
    given = bc.noise({"descent_rate": {"white": "3 m/s", "correlated": "1 m/s", "time_constant": "3 s"}})
    made, asked = judged(monkeypatch, low, given)
    assert made.noise == ("told",) and asked["told"][1] is given
    made, asked = judged(monkeypatch, Flight(raw))
    assert made.noise == ("shown",) and "told" not in asked
    predicted = low.changed(roles=("predict",))
    made, asked = judged(monkeypatch, predicted)
    assert made.noise == () and "told" not in asked and "shown" not in asked
    assert judged(monkeypatch, predicted, given)[0].noise == ("told",)


def test_a_truth_is_that_of_the_drop(drop, low, monkeypatch):
    monkeypatch.setattr(stage_data, "ingest_flight", lambda job, spec, raw: low.record)
    monkeypatch.setattr(module, "load_truth", lambda job, name: f"truth of {name}")
    assert drop.changed(name="again").truth == "truth of again"


def test_flights_by_name_and_by_place(sondes):
    flights = sondes.flights
    low, high = flights
    assert isinstance(flights, Flights) and len(flights) == 2 and [low.name, high.name] == ["low", "high"]
    assert flights["high"] is flights[1] is flights[-1] is high and flights[:1] == (low,) and low in flights
    assert repr(flights) == "Flights(low, high)" and len(Flights([])) == 0
    with pytest.raises(KeyError, match="no flight 'middle'; there are low, high"):
        flights["middle"]
    with pytest.raises(IndexError):
        flights[2]
    assert flight_rows([high]) == [("high", "identify, predict", "high.csv")]
    shown = flights._repr_html_()
    assert "<b>Flights</b>" in shown and shown.count("<td>high") == 2


def test_a_vehicle_may_be_told_by_its_file(drop, raw, tmp_path):
    bc.copy_templates(tmp_path)
    path = tmp_path / "vehicle.toml"
    assert drop.changed(vehicle=path).vehicle == drop.changed(vehicle=str(path)).vehicle == bc.load_vehicle(path)
    assert Flight(raw, path).vehicle == bc.load_vehicle(path)
    with pytest.raises(InputError, match=r"none\.toml"):
        drop.changed(vehicle=tmp_path / "none.toml")
