from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.orthogonal import select
from bayeschute.structure.confusable_terms import rivals


def pair(rng, n, r):
    """Two columns whose parts across a third correlate with r."""
    q = np.linalg.qr(rng.normal(size=(n, 3)))[0] * np.sqrt(n)
    return np.column_stack([q[:, 0], q[:, 1], r * q[:, 1] + np.sqrt(1 - r**2) * q[:, 2] + 0.7 * q[:, 0]])


def test_correlation_and_chance_are_those_of_the_formula():
    X = pair(np.random.default_rng(0), 400, 0.96)
    other, mine = rivals(X, ["a", "b", "c"], [0, 1], np.array([2.0, 0.5]), 4.0)
    assert (mine.term, mine.rival) == ("b", "c") and mine.correlation == pytest.approx(0.96)
    assert mine.strength == pytest.approx(0.5 * 20 / 2)
    assert mine.chance == pytest.approx(0.2398, abs=1e-4)  # Phi(-5 sqrt(0.02))
    assert other.term == "a" and other.chance < mine.chance


@pytest.mark.parametrize("r", [0.9, 0.98])
def test_chance_is_how_often_noise_picks_the_rival(r):
    rng = np.random.default_rng(1)
    X = pair(rng, 200, r)
    signal = 1.0 * X[:, 0] + 0.4 * X[:, 1]
    chance = rivals(X, ["a", "b", "c"], [0, 1], np.array([1.0, 0.4]), 1.0)[1].chance
    wrong = sum(
        select(X, signal + rng.normal(size=200), sigma_max2=0.1, max_terms=2, forced=[0]).order[1] == 2
        for _ in range(400)
    )
    assert wrong / 400 == pytest.approx(chance, abs=4 * np.sqrt(0.25 / 400) * 0.9)


def test_copies_can_never_be_told_apart_and_orthogonal_terms_always():
    rng = np.random.default_rng(2)
    X = np.linalg.qr(rng.normal(size=(100, 4)))[0] * 10
    copied = np.column_stack([X, -2.0 * X[:, 1]])
    first, second = rivals(copied, list("abcde"), [0, 1], np.array([5.0, 5.0]), 1.0)
    assert first.chance < 1e-6 and first.correlation < 1e-9
    assert (
        second.rival == "e"
        and second.correlation == pytest.approx(1.0)
        and second.chance == pytest.approx(0.5, abs=1e-4)
    )
    alone = rivals(X[:, :1], ["a"], [0], np.array([1.0]), 1.0)
    assert alone[0].rival == "" and alone[0].chance == 0.0


def test_bad_input_is_refused():
    X = np.random.default_rng(3).normal(size=(20, 3))
    for kept, estimate, variance in (([0], [1.0, 2.0], 1.0), ([5], [1.0], 1.0), ([0], [1.0], 0.0)):
        with pytest.raises(InputError):
            rivals(X, list("abc"), kept, np.array(estimate), variance)
