"""What explains a breach: laws and mistakes made up so that scores, order and severity are known by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.records.plausibility.made_up import evidence

from bayeschute.records.plausibility import verdict as module
from bayeschute.records.plausibility.mistake import Mistake
from bayeschute.records.plausibility.reading import Reading
from bayeschute.records.plausibility.verdict import misfit, readings, verdict


def _law(name: str, channel: str):
    """A law whose excess is the mean of a channel; none where there is no such channel."""

    def law(e):
        values = getattr(e, channel)
        return [] if values is None else [Reading(name, f"{channel} is small", float(np.mean(values)), "got", "wanted")]

    return law


def _without(cause: str, doubt: float = 0.0, **values: float | None) -> Mistake:
    """A mistake whose inverse sets channels; None takes a channel away."""

    def undo(e):
        made = {name: x if x is None else np.full(24, x) for name, x in values.items()}
        return replace(e, **made)

    return Mistake(cause, f"mend {cause}", undo, doubt)


@pytest.fixture
def say(monkeypatch):
    def make(mistakes, **excess: float):
        laws = tuple(_law(name, name) for name in excess)
        monkeypatch.setattr(module, "LAWS", laws)
        monkeypatch.setattr(module, "known_mistakes", lambda: tuple(mistakes))
        monkeypatch.setattr(module, "estimated_mistakes", lambda e, score: [])
        return verdict(evidence(**{name: np.full(24, x) for name, x in excess.items()}))

    return make


def _reading(excess: float) -> Reading:
    return Reading("a", "", excess, "", "")


def test_a_score_is_the_sum_of_logarithms_and_a_law_that_is_lost_costs_two():
    found = {"a": _reading(3.0), "b": _reading(0.5), "c": _reading(1e6)}
    assert misfit(found, ["a"]) == pytest.approx(np.log(10.0))
    assert misfit(found, ["a", "b"]) == pytest.approx(np.log(10.0) + np.log(1.25))
    assert misfit(found, ["lost"]) == pytest.approx(2.0) and misfit(found, []) == 0.0
    assert misfit(found, ["c"]) == pytest.approx(np.log1p(1e6))


def test_a_law_that_gives_no_number_is_no_reading(monkeypatch):
    monkeypatch.setattr(module, "LAWS", (lambda e: [_reading(np.nan), Reading("b", "", 2.0, "", "")],))
    assert [*readings(evidence())] == ["b"]


def test_a_law_is_asked_again_only_where_something_that_it_read_has_changed(monkeypatch):
    """Also where what it reads depends on what it has read."""
    asked = []

    def law(e):
        asked.append(e)
        other = e.altitude if e.density is None else e.density
        return [Reading("a", "", 0.0 if other is None else float(other[0]), "", "")]

    monkeypatch.setattr(module, "LAWS", (law,))
    e = replace(evidence(), density=None, altitude=np.array([3.0]))
    laws = module.Laws(e)
    seen = [e, replace(e, velocity=np.zeros((1, 3))), replace(e, density=np.array([5.0])), replace(e, altitude=None), e]
    assert [laws.readings(one)["a"].excess for one in seen] == [3.0, 3.0, 5.0, 0.0, 3.0] and len(asked) == 3
    other = module.Laws(seen[2])
    assert other.readings(replace(seen[2], altitude=np.array([9.0])))["a"].excess == 5.0 and len(asked) == 4


def test_nothing_is_sought_where_all_laws_hold(say):
    found = say([_without("x", density=0.0)], density=0.69)
    assert found.findings == () and found.causes == () and [r.excess for r in found.readings] == pytest.approx([0.69])


def test_faults_from_one_on_and_warnings_below(say):
    found = say([], density=0.8, pressure=1.0, temperature=3.0, altitude=0.5)
    assert [(f.law, f.severity) for f in found.findings] == [
        ("pressure", "fault"), ("temperature", "fault"), ("density", "warning")
    ]  # fmt: skip
    assert {f.law for f in found.faults} == {"pressure", "temperature"} and found.warnings[0].law == "density"
    assert {f.likely for f in found.findings} == {""} and found.causes == ()
    assert found.findings[1].tests == "temperature is small" and found.findings[1].excess == 3.0


def test_the_mistake_that_explains_most_comes_first_and_near_ones_are_told_as_others(say):
    best, near, far = (_without(w, density=x) for w, x in (("best", 0.1), ("near", 0.9), ("far", 2.0)))
    (only,) = say([far, near, best], density=10.0).findings
    assert only.causes == ("best", "near") and only.do == "mend best" and only.likely == "best"
    many = [_without(f"near {i}", 0.01 * i, density=0.1) for i in range(6)]
    (only,) = say(many[::-1], density=10.0).findings
    assert only.causes == ("near 0", "near 1", "near 2", "near 3")


def test_a_mistake_that_leaves_a_law_as_it_is_is_no_other_cause(say):
    best, idle, other = _without("best", density=0.1), _without("idle", density=1.05), _without("other", density=0.9)
    (only,) = say([idle, best, other], density=1.1).findings
    assert only.causes == ("best", "other")


def test_doubt_puts_a_mistake_behind_one_that_explains_less(say):
    doubted, plain = _without("doubted", 0.4, density=0.0), _without("plain", 0.1, density=0.4)
    (only,) = say([doubted, plain], density=10.0).findings
    assert only.likely == "plain"  # 0.1 + log(1.16) < 0.4


def test_several_mistakes_are_found_one_after_the_other_each_with_its_law(say):
    one, two = _without("one", density=0.0), _without("two", pressure=0.0)
    found = say([two, one], density=30.0, pressure=3.0)
    assert found.causes == ("one", "two")
    assert {f.law: f.likely for f in found.faults} == {"density": "one", "pressure": "two"}
    channels = ("density", "pressure", "temperature", "altitude")
    each = [_without(name, **{name: 0.0}) for name in channels]
    assert len(say(each, **dict.fromkeys(channels, 5.0)).causes) == 3


def test_a_mistake_that_mends_too_little_or_spoils_another_law_is_no_cause(say):
    assert say([_without("little", 0.0, density=2.6)], density=3.0).causes == ()
    assert say([_without("still broken", 0.0, density=1.5)], density=10.0).causes == ()
    worse = _without("worse", density=0.0, pressure=50.0)
    assert say([worse], density=3.0, pressure=0.1).causes == ()


def test_taking_a_channel_away_costs_what_a_lost_law_costs(say):
    away, mends = _without("away", density=None), _without("mends", density=0.9)
    assert say([away, mends], density=20.0).causes == ("mends",)
    assert say([away], density=20.0).causes == ("away",)  # 2 < log(401)
    assert say([away], density=2.0).causes == ()  # log(5) < 2


def test_warnings_alone_have_their_cause_told_and_beside_faults_have_none_of_their_own(say):
    mends = _without("mends", density=0.0)
    (only,) = say([mends], density=0.9).findings
    assert only.severity == "warning" and only.likely == "mends"
    found = say([mends, _without("other", pressure=0.0)], density=0.9, pressure=5.0)
    assert found.causes == ("other",) and found.warnings[0].likely == ""
