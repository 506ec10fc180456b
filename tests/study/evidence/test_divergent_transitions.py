"""The check of divergent transitions: of populations alone, against its bound, and what it takes from a posterior."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.report.check_words import wanted
from bayeschute.study.assembly.populations import DIVERGING
from bayeschute.study.evidence.divergent_transitions import MOST_DIVERGENT, divergences_check


def _stats(diverged: int, of: int = 1000) -> dict[str, np.ndarray]:
    return {DIVERGING: (np.arange(of) < diverged).reshape(2, -1)}


@pytest.mark.parametrize(("diverged", "passed"), [(0, True), (10, True), (11, False), (400, False)])
def test_more_than_a_hundredth_of_the_transitions_fail(diverged: int, passed: bool):
    (found,) = divergences_check(_stats(diverged)).values()
    assert found["passed"] is passed and found["value"] == pytest.approx(diverged / 1000)
    assert f"{diverged} of 1,000 transitions" in found["detail"]
    assert wanted("divergences", found["bound"]) == f"at most {MOST_DIVERGENT:.4f}"


def test_the_walk_on_a_surrogate_is_not_judged():
    assert divergences_check({"diverging": np.ones((2, 10), bool)}) == divergences_check({}) == {}
