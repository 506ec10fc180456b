"""What `bayeschute land` does, step by step: what is asked is checked before anything is flown, and all is said."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pytest

from bayeschute.api.landing import landing_command as module
from bayeschute.api.landing.landing_command import LandingOptions, land_file
from bayeschute.core.errors import Fault, InputError


class Campaign:
    """A campaign that knows how many landings it is of."""

    def __init__(self, landings="as the file says"):
        self.landings = landings

    def with_landings(self, most):
        return Campaign(most)


class Answer:
    """A table, words, and perhaps a figure."""

    def __init__(self, name, drawn):
        self.table, self.words, self.drawn = pd.DataFrame({"a": [name]}), [f"{name} 1", f"{name} 2"], drawn

    def figure(self):
        return f"figure of {self.table['a'][0]}" if self.drawn else None


@pytest.fixture
def done(monkeypatch):
    """Every step, in its order, with what it was given."""
    steps, known = (
        [],
        SimpleNamespace(
            spec="spec", files="files", failed_checks=("rhat",), trust=SimpleNamespace(words="not checked")
        ),
    )
    source, made = SimpleNamespace(plan="plan"), SimpleNamespace(rows="rows", name="n")

    def step(name, answer):
        return lambda *given, **named: steps.append((name, given, named)) or answer

    for name, answer in (
        ("load_campaign", Campaign()), ("check_questions", None), ("source_of", source), ("land", made),
        ("write_landings", ["landed"]), ("write_for_others", ["others"]), ("sensitivity", Answer("shares", True)),
        ("rare_failures", Answer("rare", False)), ("wind_placard", Answer("placard", True)),
        ("drop_ranking", Answer("design", True)), ("write_csv", None), ("save", None),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, step(name, answer))
    monkeypatch.setattr(module, "Posterior", SimpleNamespace(load=step("load", known)))
    return SimpleNamespace(steps=steps, known=known, source=source, made=made)


def asked(done, name):
    return [(given, named) for what, given, named in done.steps if what == name]


def test_without_more_it_lands_and_writes(done):
    assert land_file("p.nc", "c.toml", "out") == ["landed", "others"]
    order = ["load_campaign", "load", "check_questions", "source_of", "land", "write_landings", "write_for_others"]
    assert [name for name, *_ in done.steps] == order
    assert asked(done, "load_campaign") == [(("c.toml", None), {})] and asked(done, "load") == [(("p.nc",), {})]
    (campaign, also, spec, data), _ = asked(done, "check_questions")[0]
    assert (campaign.landings, also, spec, data) == ("as the file says", (), "spec", None)
    assert asked(done, "source_of") == [((campaign, "spec", "files", ("rhat",), 1, None, None, "not checked"), {})]
    assert asked(done, "land") == [((done.source, Path("out")), {})]
    assert asked(done, "write_landings") == [((done.made, Path("out")), {})]
    assert asked(done, "write_for_others") == [((done.known, "plan", Path("out"), "n", 0), {})]


def test_options_go_where_they_belong(done):
    wanted = LandingOptions(640, 3, "tcp://x", (), 5)
    land_file("p.nc", "c.toml", Path("out"), wanted, "data", print)
    assert asked(done, "load_campaign") == [(("c.toml", "data"), {})]
    (campaign, *rest), _ = asked(done, "source_of")[0]
    assert campaign.landings == 640 and rest == ["spec", "files", ("rhat",), 3, "tcp://x", print, "not checked"]
    assert asked(done, "check_questions")[0][0][0].landings == 640 and asked(done, "check_questions")[0][0][3] == "data"
    assert asked(done, "write_for_others")[0][0][4] == 5
    assert LandingOptions() == (None, 1, None, (), 0)


def test_no_landing_is_a_number_of_landings(done):
    """The campaign's tables say that it is too few, not this."""
    land_file("p.nc", "c.toml", "out", LandingOptions(0))
    assert asked(done, "source_of")[0][0][0].landings == 0


def test_questions_are_answered_in_their_order_with_table_and_figure(done):
    lines = land_file("p.nc", "c.toml", "out", LandingOptions(also=("rare", "design", "shares", "placard")), "data")
    names = ("rare", "design", "shares", "placard")
    assert lines == ["landed", "others", *(f"{name} {k}" for name in names for k in (1, 2))]
    assert asked(done, "check_questions")[0][0][1] == names
    assert asked(done, "rare_failures") == asked(done, "wind_placard") == [((done.source,), {})]
    assert asked(done, "sensitivity") == [((done.source, "rows"), {})]
    assert asked(done, "drop_ranking") == [((done.source, "rows"), {"data": "data"})]
    written = [(given[0]["a"][0], given[1]) for given, _ in asked(done, "write_csv")]
    assert written == [(name, Path("out") / f"{name}.csv") for name in names]
    drawn = [(f"figure of {name}", Path("out"), name) for name in ("design", "shares", "placard")]
    assert [given for given, _ in asked(done, "save")] == drawn  # nothing is drawn of rare failures


def test_only_what_is_asked_is_answered(done):
    land_file("p.nc", "c.toml", "out", LandingOptions(also=("placard",)))
    answered = {name for name, *_ in done.steps} & {"sensitivity", "rare_failures", "wind_placard", "drop_ranking"}
    assert answered == {"wind_placard"}


def test_faults_are_told_before_anything_is_flown(done, monkeypatch):
    def refuse(*given):
        raise InputError(Fault("placard", "no placard", "a table"))

    monkeypatch.setattr(module, "check_questions", refuse)
    with pytest.raises(InputError, match="no placard"):
        land_file("p.nc", "c.toml", "out", LandingOptions(also=("placard",)))
    assert [name for name, *_ in done.steps] == ["load_campaign", "load"]


def test_a_campaign_that_is_not_there_is_told_first(tmp_path):
    with pytest.raises(InputError, match="gone.toml"):
        land_file(tmp_path / "none.nc", tmp_path / "gone.toml", tmp_path / "out")
    assert not any(tmp_path.iterdir())
