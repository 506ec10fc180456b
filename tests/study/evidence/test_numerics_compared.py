"""Stored results of other numerics count where both were compared on the same studies, directly, within the bounds."""

from __future__ import annotations

import json

import pytest
from pydantic import ValidationError

from bayeschute.study.evidence.numerics_compared import (
    BOUNDS,
    LEAST_KINDS,
    LEAST_STUDIES,
    Comparison,
    Figures,
    comparisons,
    identical_to,
    same_as,
)


def figures(number: int, **changed: float) -> Figures:
    base = {"study": f"study {number}", "hash": str(number), "configuration": "one", "seconds": (20.0, 10.0)}
    return Figures.model_validate(base | {name: 0.5 * bound for name, bound in BOUNDS._asdict().items()} | changed)


def compared(before: str, after: str, studies: int = LEAST_STUDIES, **changed: float) -> Comparison:
    rows = tuple(figures(n, **(changed if n == studies - 1 else {})) for n in range(studies))
    return Comparison(before=before, after=after, studies=rows, provenance={})


def test_numerics_that_were_compared_count_and_chains_of_them_do_not():
    found = [compared("a", "b"), compared("b", "c")]
    assert same_as("b", "one", found) == {"a", "b", "c"}
    assert same_as("c", "one", found) == {"b", "c"} and same_as("a", "one", found) == {"a", "b"}
    assert same_as("d", "one", found) == {"d"} and same_as("b", "another", found) == {"b"}


def rewritten(before: str, after: str, kinds: int = LEAST_KINDS, **changed: float) -> Comparison:
    none = dict.fromkeys(BOUNDS._fields, 0.0)
    rows = tuple(
        figures(n, **none | (changed if n == 0 else {})).model_copy(update={"configuration": f"kind {n}"})
        for n in range(kinds)
    )
    return Comparison(before=before, after=after, studies=rows, provenance={})


def test_identical_numerics_count_for_everything_along_chains_and_past_a_comparison():
    found = [rewritten("c", "d"), rewritten("b", "c"), rewritten("x", "y")]
    assert identical_to("b", found) == identical_to("d", found) == {"b", "c", "d"}
    assert identical_to("x", found) == {"x", "y"} and identical_to("q", found) == {"q"}
    assert same_as("d", "any", found) == {"b", "c", "d"}
    small = [*found, compared("a", "b"), rewritten("z", "a"), compared("w", "z")]
    assert same_as("d", "one", small) == {"z", "a", "b", "c", "d"}  # the second small change is not counted
    assert same_as("d", "another", small) == {"b", "c", "d"}


@pytest.mark.parametrize("name", BOUNDS._fields)
def test_more_than_rounding_and_too_few_kinds_are_not_identical(name):
    assert rewritten("a", "b", **{name: 0.9e-3}).identical
    assert not rewritten("a", "b", **{name: 1.1e-3}).identical
    assert not rewritten("a", "b", **{name: float("nan")}).identical
    assert not rewritten("a", "b", LEAST_KINDS - 1).identical
    assert rewritten("a", "b", LEAST_KINDS + 1).identical


@pytest.mark.parametrize("name", BOUNDS._fields)
def test_one_figure_beyond_its_bound_is_enough_for_another_result(name):
    bound = getattr(BOUNDS, name)
    assert compared("a", "b", **{name: bound}).same("one")
    assert not compared("a", "b", **{name: 1.01 * bound}).same("one")
    assert same_as("b", "one", [compared("a", "b", **{name: 1.01 * bound})]) == {"b"}


def test_few_studies_and_the_same_one_twice_are_not_enough():
    assert not compared("a", "b", LEAST_STUDIES - 1).same("one")
    twice = compared("a", "b")
    assert not twice.model_copy(update={"studies": (*twice.studies[:-1], twice.studies[0])}).same("one")


def test_a_file_that_is_no_comparison_is_refused(tmp_path):
    (tmp_path / "one.json").write_text(json.dumps({"before": "a", "after": "b"}))
    with pytest.raises(ValidationError):
        comparisons(tmp_path)
