"""Parts of a coefficient's entry on made-up results: numbers that a reader would work out by hand, or by refitting."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.regression.orthogonal import select
from bayeschute.regression.propagation import Propagated
from bayeschute.regression.stacked import Stack, stack_components, stack_records
from bayeschute.structure import structure_entry as module
from bayeschute.structure.exchange import Exchanged
from bayeschute.structure.search import CEILINGS

RNG = np.random.default_rng(4)


def _stack(z, blocks) -> Stack:
    blocks = np.asarray(blocks)
    return Stack(np.ones((len(z), 1)), np.asarray(z, float), blocks, 0 * blocks, 0 * blocks)


def test_signal_over_noise_is_about_the_mean_of_every_series():
    """Two series far apart, each of sd 2 and 4: rms sd sqrt(10), whatever lies between their means."""
    z = np.r_[100.0 + 2.0 * np.tile([1.0, -1.0], 50), -7.0 + 4.0 * np.tile([1.0, -1.0], 20), np.nan]
    found = SimpleNamespace(stack=_stack(z, np.r_[np.zeros(100), np.ones(41)]), noise=SimpleNamespace(sd=0.5))
    assert module._signal_to_noise(found, None) == pytest.approx(np.sqrt(10.0) / 0.5)
    for response, noise in ((0.1, 0.5), (2.0, 2.0)):  # the larger of both floors counts
        moved = Propagated(0.1, response, np.zeros(1), np.zeros(1), 8)
        assert module._signal_to_noise(found, moved) == pytest.approx(np.sqrt(10.0) / noise)


def test_tenths_of_each_series_are_predicted_from_the_rest_simultaneous_ones_left_out_together():
    T = 53
    X = np.stack([np.ones((T, 2)), RNG.normal(size=(T, 2))], axis=2)
    one = stack_components(X, X @ [1.0, 0.5] + 0.3 * RNG.normal(size=(T, 2)))
    other = stack_components(X[:31, :1] + 0.1, X[:31, :1] @ [1.0, 0.5] + 0.3 * RNG.normal(size=(31, 1)))
    stack = stack_records([one, other])
    tenth = [i * 10 // T for i in range(T)]
    fold = np.array([*tenth, *tenth, *(10 + i * 10 // 31 for i in range(31))])
    rest = np.empty(fold.size)
    for k in range(20):
        out = fold == k
        fitted = np.linalg.lstsq(stack.X[~out], stack.z[~out], rcond=None)[0]
        rest[out] = stack.z[out] - stack.X[out] @ fitted
    inside = stack.z - stack.X @ np.linalg.lstsq(stack.X, stack.z, rcond=None)[0]
    told = module._press(stack, [0, 1])
    assert told["ratio"] == pytest.approx(np.sqrt(np.mean(rest**2) / np.mean(inside**2))) and told["reason"] is None
    assert module._press(stack, [0])["r2"] < told["r2"]


def test_structures_by_ceiling_are_told_up_to_a_dozen_terms_or_some_more_than_kept(monkeypatch):
    X = RNG.normal(size=(200, 20))
    s = select(X, X @ np.geomspace(1.0, 0.01, 20) + 0.01 * RNG.normal(size=200), sigma_max2=1.0, penalty_factor=1.0)
    told = module._sensitivity(s)
    longest = max(12, s.minimum + 6)
    assert [len(one["terms"]) for one in told] == [one.n for one in s.sensitivity() if one.n <= longest]
    assert len(told) < len(s.sensitivity()) and told[-1]["terms"] == []
    few = module._sensitivity(s.with_ceiling(s.ceiling._replace(value=1e-5)))
    assert max(len(one["terms"]) for one in few) > 12


def test_terms_that_are_often_kept_under_any_ceiling_are_told():
    shares = np.array([[1.0, 0.0, 0.04, 0.0]] * len(CEILINGS))
    shares[1, 3], shares[2, 1] = 0.05, 0.049
    frequency = SimpleNamespace(
        names=("a", "b", "c", "d"), frequency=np.array([0.9, 0.0, 0.04, 0.01]), by_sigma_max=shares, replicates=40
    )
    told = module._frequency(SimpleNamespace(frequency=frequency))
    assert told["terms"] == {"a": 0.9, "d": 0.01} and told["ceilings"] == [0.25, 0.5, 2.0, 4.0]
    np.testing.assert_array_equal(told["by_ceiling"]["d"], [0.0, 0.05, 0.0, 0.0])
    assert module._frequency(SimpleNamespace(frequency=None)) is None


def test_what_was_selected_has_the_numbers_of_its_own_column():
    """Columns kept are the third and the first of the candidates."""
    fitted = SimpleNamespace(names=("c", "a"), estimate=[3.0, 1.0], se=[0.3, 0.1], white_se=[0.03, 0.01])
    made = SimpleNamespace(
        fit=fitted, found=SimpleNamespace(columns=(2, 0)), bootstrap=SimpleNamespace(se=[0.33, 0.11]),
        frequency=SimpleNamespace(frequency=np.array([0.1, 0.2, 0.3])),
    )  # fmt: skip
    moved = Propagated(0.1, 0.02, np.array([0.5, 0.6]), np.array([-0.1, 0.2]), 8)
    first, second = module._selected(made, ["s", "m", "kg"], moved)
    assert first == {
        "term": "c", "estimate": 3.0, "se": 0.3, "white_se": 0.03, "unit": "kg", "bootstrap_se": 0.33, "frequency": 0.3,
        "differentiation_sd": 0.5, "differentiation_shift": -0.1,
    }  # fmt: skip
    assert second["unit"] == "s" and second["frequency"] == 0.1 and second["differentiation_shift"] == 0.2
    made.bootstrap = made.frequency = None
    (bare, _) = module._selected(made, None, None)
    assert bare == {"term": "c", "estimate": 3.0, "se": 0.3, "white_se": 0.03, "unit": "1"}


def test_an_exchange_tells_what_it_gained():
    assert module._exchanged(SimpleNamespace(found=SimpleNamespace(exchanged=None))) is None
    given = dict.fromkeys(Exchanged._fields) | {"pse": 1.0, "start": 2.0, "moves": ()}
    told = module._exchanged(SimpleNamespace(found=SimpleNamespace(exchanged=Exchanged(**given))))
    assert told == {"pse": 1.0, "pse_before": 2.0, "moves": []}


def test_candidates_that_are_zero_throughout_are_not_fitted_and_rows_that_lack_hide_none():
    X = np.column_stack([np.ones(60), np.zeros(60), RNG.normal(size=60)])
    X[:5, 1:] = np.nan
    stack = stack_components(X[:, None, :], (2.0 + X[:, 2] * 3.0)[:, None])
    whole = module._whole(stack, ["1", "never", "x"])
    assert whole is not None and list(whole.names) == ["1", "x"]
    np.testing.assert_allclose(whole.estimate, [2.0, 3.0], atol=1e-9)
    together = module._together(whole, ["1", "never", "x"], X)
    np.testing.assert_allclose(together["rms"], [1.0, 0.0, np.sqrt(np.mean(X[5:, 2] ** 2))])
    assert together["fitted"] == ["1", "x"]
    assert [one["term"] for one in module._left_out(whole, ["1"])] == ["x"]
    assert module._whole(stack._replace(X=0.0 * stack.X), ["1", "never", "x"]) is None
    assert module._left_out(None, ["1"]) == []


def test_the_ranking_has_every_column_of_a_row_up_to_a_length():
    s = select(RNG.normal(size=(30, 5)), RNG.normal(size=30), sigma_max2=1.0)
    told = module.ranking(s, 3)
    assert len(told) == 3 and len(module.ranking(s)) == 5
    assert told[2] == vars(s.rows[2])
