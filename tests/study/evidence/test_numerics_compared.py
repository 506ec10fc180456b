"""Stored results of other numerics count where both were compared on the same studies, directly, within the bounds."""

from __future__ import annotations

import json

import pytest
from pydantic import ValidationError

from bayeschute.study.evidence.numerics_compared import (
    BOUNDS,
    LEAST_STUDIES,
    Comparison,
    Figures,
    comparisons,
    same_as,
)
from bayeschute.study.evidence.numerics_hash import PACKAGE, engine, hash_of


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


def test_shipped_comparisons_are_with_the_present_numerics_and_pass():
    """Others have no use any more. The engine may be another: a result speaks for the one it had."""
    for one in comparisons():
        assert hash_of(PACKAGE, engine(one.provenance["versions"])) in (one.before, one.after)
        assert all(one.same(row.configuration) for row in one.studies)
        assert all(one.provenance[key] for key in ("command", "commit", "date", "machine", "versions"))
