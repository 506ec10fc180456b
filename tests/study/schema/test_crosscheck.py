"""Checks across tables, each on a made-up study that breaks its rule by a little, and on one that just keeps it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bayeschute.study.schema import crosscheck as module
from bayeschute.study.schema.belief_schema import PriorsTable
from bayeschute.study.schema.crosscheck import as_far_as_known, crosscheck
from bayeschute.study.schema.draft import Draft
from bayeschute.study.schema.quantities import Cut
from bayeschute.study.schema.reading.strict import UnknownValueError
from bayeschute.study.schema.study_schema import PredictTable

USUAL: dict[str, Any] = dict(
    roles=("identify", "structure"), file="a.csv", virtual=None, vehicle=None, window=None, skip_first=0.0,
    identify_until=None, capsule_mass=None,
)  # fmt: skip


def _flight(name="a", **changes):
    return SimpleNamespace(**(USUAL | {"name": name} | changes))


def _draft(*flights, model="cluster", vehicle=None, own=None, **tables):
    raw = {"flight": [{"name": one.name} for one in flights]}
    return Draft("x.toml", raw, {"model": model} | tables, dict(enumerate(flights)), vehicle, own or {})


def _places(check, draft):
    return [fault.where.removeprefix("x.toml ") for fault in check(draft)]


def _vehicle(number=2, breathes=False, aero=("1", "e")):
    canopies = SimpleNamespace(number=number, breathing=object() if breathes else None)
    told = SimpleNamespace(coefficients=lambda: dict.fromkeys(aero, 0.1))
    return SimpleNamespace(canopies=canopies, aero=told, name="v", capsule=SimpleNamespace(table=None))


def test_names_of_flights_are_those_of_files_and_names_of_requirements_as_written():
    flights = (_flight("Drop"), _flight("b"), _flight("DROP"), _flight("drop"))
    wanted = tuple(SimpleNamespace(name=name) for name in ("soft", "Soft", "hard", "soft"))
    told = _places(module.check_names, _draft(*flights, requirement=wanted))
    assert told == [
        "[flight] name (flight 'DROP')",
        "[flight] name (flight 'drop')",
        "[requirement] name (requirement 4)",
    ]


def test_something_is_fitted_and_something_searched():
    only = _flight(roles=("predict",))
    assert len(_places(module.check_roles, _draft(only))) == 2
    assert len(_places(module.check_roles, _draft(only, model="descent"))) == 1
    assert len(_places(module.check_roles, _draft(_flight(roles=("identify",))))) == 1
    assert _places(module.check_roles, _draft(only, _flight("b"))) == []
    partial = Draft("x.toml", {"flight": [{}, {}]}, {"model": "cluster"}, {0: only})
    assert _places(module.check_roles, partial) == []  # the other may have the role


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"skip_first": 9.9}, []),
        ({"skip_first": 10.0}, ["skip_first"]),
        ({"identify_until": Cut(share=0.5)}, []),
        ({"identify_until": Cut(time=25.0), "skip_first": 4.9}, []),
        ({"identify_until": Cut(time=25.0), "skip_first": 5.0}, ["identify_until"]),
        ({"identify_until": Cut(time=30.0)}, ["identify_until"]),
        ({"identify_until": Cut(time=20.0)}, ["identify_until"]),
        ({"identify_until": Cut(time=5.0)}, ["identify_until"]),  # a time of the record, not of the window
        ({"identify_until": Cut(share=0.3), "skip_first": 3.5}, ["identify_until"]),
    ],
)
def test_cuts_lie_within_the_window(changes, told):
    draft = _draft(_flight(window=(20.0, 30.0), **changes))
    assert [place.split()[1] for place in _places(module.check_times, draft)] == told


@pytest.mark.parametrize(
    ("window", "good"),
    [((0.0, 90.0), True), ((0.0, 90.1), False), ((-0.1, 50.0), False), ((50.0, 50.0), False), ((60.0, 50.0), False)],
)
def test_windows_lie_within_a_virtual_drop(window, good):
    draft = _draft(_flight(window=window, virtual=SimpleNamespace(duration=90.0)))
    assert _places(module.check_times, draft) == ([] if good else ["[flight] window (flight 'a')"])
    alone = _draft(_flight(virtual=SimpleNamespace(duration=90.0), skip_first=90.0))
    assert _places(module.check_times, alone) == ["[flight] skip_first (flight 'a')"]


def test_canopies_named_exist_and_are_named_where_there_are_several():
    def structure(canopies, *said):
        return SimpleNamespace(canopies=canopies, model_fields_set=set(said))

    for number, table, told in (
        (2, structure((1,)), ["[structure] canopies"]),
        (2, structure((1, 2), "canopies"), []),
        (2, structure((1, 3), "canopies"), ["[structure] canopies, item 2"]),
        (1, structure((1,)), []),
    ):
        assert _places(module.check_canopies, _draft(_flight(), vehicle=_vehicle(number), structure=table)) == told


def test_vehicles_of_flights_have_as_many_canopies_and_virtual_ones_fly():
    drop = SimpleNamespace(duration=90.0)
    flights = (
        _flight(vehicle="b.toml"),
        _flight("b", vehicle="c.toml"),
        _flight("c", virtual=drop),
        _flight("d", vehicle="lost"),
    )
    draft = _draft(*flights, vehicle=_vehicle(2), own={0: _vehicle(3), 1: _vehicle(2)})
    assert _places(module.check_vehicles, draft) == ["[flight] vehicle (flight 'a')"]
    still = _vehicle(2)
    still.aero = module.NOT_FLOWN
    assert _places(module.check_vehicles, _draft(flights[2], vehicle=still)) == ["[flight] virtual (flight 'c')"]


@pytest.mark.parametrize(
    ("vehicle", "shape", "good"),
    [(_vehicle(2, True), (0.1, 0.2), True), (_vehicle(2, True), (0.1,), False), (_vehicle(2), (0.1, 0.2), False),
     (_vehicle(2), (), True), (None, (0.1,), True)],
)  # fmt: skip
def test_as_many_shapes_as_canopies_that_breathe(vehicle, shape, good):
    draft = _draft(_flight(virtual=SimpleNamespace(shape=shape)), _flight("b"), vehicle=vehicle)
    assert _places(module.check_shape, draft) == ([] if good else ["[flight.virtual] shape (flight 'a')"])


def test_canopies_differ_in_what_they_fly_with():
    draft = _draft(_flight(virtual=SimpleNamespace(canopy_sd={"1": 0.1, "q": 0.1})), vehicle=_vehicle())
    assert _places(module.check_canopy_sd, draft) == ["[flight.virtual.canopy_sd] q (flight 'a')"]
    assert (
        _places(module.check_canopy_sd, _draft(_flight(virtual=SimpleNamespace(canopy_sd=None)), vehicle=_vehicle()))
        == []
    )


def _priors(**keys):
    return PriorsTable.model_validate(keys)


@pytest.mark.parametrize(
    ("flights", "number", "priors", "told"),
    [
        (2, 2, {"vary": ["1"]}, []),
        (1, 2, {"vary": ["1"]}, ["vary"]),
        (1, 2, {"vary_canopies": ["1"]}, []),
        (1, 1, {"vary_canopies": ["1"]}, ["vary_canopies"]),
        (2, 1, {"vary_canopies": ["1"]}, []),
        (2, 2, {"vary": ["1", "e"], "vary_canopies": ["e"]}, ["vary_canopies"]),
        (2, 2, {"vary": ["1"], "spread": {"1": 0.1}}, []),
        (2, 2, {"vary_canopies": ["1"], "spread": {"1": 0.1, "e": 0.1}}, ["e"]),
        (2, 2, {"spread": {"1": 0.1}}, ["1"]),
    ],
)
def test_populations_are_of_several(flights, number, priors, told):
    given = [_flight(str(i)) for i in range(flights)] + [_flight("p", roles=("predict",))]
    draft = _draft(*given, vehicle=_vehicle(number), priors=_priors(**priors))
    assert [place.split()[-1] for place in _places(module._check_vary, draft)] == told


def test_a_population_is_of_one_structure():
    stack = SimpleNamespace(stack=("a",))
    draft = _draft(
        _flight(), _flight("b"), vehicle=_vehicle(), priors=_priors(vary=["1"], vary_canopies=["e"]), structure=stack
    )
    assert _places(module._check_vary, draft) == ["[priors] vary", "[priors] vary_canopies"]
    stack.stack = None
    assert _places(module._check_vary, draft) == []


def test_a_mass_that_is_fitted_is_that_of_all_fitted_flights():
    mass = {"given": {"capsule_mass": {"mean": "100 kg", "sd": "1 kg"}}}
    flights = (
        _flight(capsule_mass=90.0),
        _flight("b", vehicle="v.toml"),
        _flight("c", capsule_mass=90.0, roles=("predict",)),
    )
    told = _places(module._check_mass, _draft(*flights, priors=_priors(**mass)))
    assert told == ["[flight] capsule_mass (flight 'a')", "[flight] vehicle (flight 'b')"]
    assert _places(module._check_mass, _draft(*flights, priors=_priors())) == []


@pytest.mark.parametrize(
    ("model", "quantities", "wanted", "told"),
    [
        ("descent", ["descent_rate"], "descent_rate", []),
        (
            "descent",
            ["swing_angle"],
            "descent_rate",
            ["[predict] quantities, item 1", "[requirement] quantity (requirement 1)"],
        ),
        ("cluster", ["swing_angle"], "descent_rate", ["[requirement] quantity (requirement 1)"]),
        ("cluster", None, "flyout_angle", []),
        (None, ["swing_angle"], "x", []),
    ],
)
def test_requirements_are_on_what_is_predicted(model, quantities, wanted, told):
    predict = PredictTable.model_validate({} if quantities is None else {"quantities": quantities})
    draft = _draft(_flight(), model=model, predict=predict, requirement=(SimpleNamespace(name="r", quantity=wanted),))
    assert _places(module.check_predictions, draft) == told


def test_a_check_ends_where_a_value_is_not_known_and_its_faults_stay():
    def check():
        yield "one"
        raise UnknownValueError("x")

    assert list(as_far_as_known(check())) == ["one"]

    def broken():
        yield "one"
        raise KeyError("x")

    with pytest.raises(KeyError):
        list(as_far_as_known(broken()))


def test_every_check_is_made(monkeypatch):
    names = (
        "names roles model_cluster canopies vehicles shape canopy_sd polar core stack terms synthetic times predictions knowledge"
    ).split()
    for name in names:
        monkeypatch.setattr(module, f"check_{name}", lambda draft, name=name: iter([name]))
    assert crosscheck(_draft()) == names
    assert crosscheck(_draft(model=None)) == [name for name in names if name != "model_cluster"]
