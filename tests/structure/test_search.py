from __future__ import annotations

import json

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.records.sensors import ornstein_uhlenbeck
from bayeschute.regression.equation_error import fit
from bayeschute.regression.propagation import Propagated
from bayeschute.regression.stacked import stack_components, stack_records
from bayeschute.structure import structure_entry
from bayeschute.structure.search import CEILINGS, Search, identify, search
from bayeschute.structure.structure_entry import entry, plain

DT = 0.1
NAMES = ["1", "swing", "copy", "slow", "noise"]


def regression(seed, n=1200, sd=0.1):
    rng = np.random.default_rng(seed)
    t = DT * np.arange(n)
    swing = np.sin(2 * np.pi * 0.07 * t + seed)
    copy = swing + 0.3 * np.sin(2 * np.pi * 0.23 * t)
    X = np.column_stack([np.ones(n), swing, copy, np.cos(0.1 * t), rng.normal(size=n)])
    z = X[:, :2] @ [0.9, 0.3] + ornstein_uhlenbeck(sd, 0.5, DT, (n,), rng)
    return stack_components(X[:, None, :], z[:, None])


@pytest.fixture(scope="module")
def found():
    return identify(regression(0), NAMES, DT, Search(sigma_max=3.0, replicates=40), np.random.default_rng(1))


def test_true_terms_are_found_with_sound_errors(found):
    assert set(found.fit.names) == {"1", "swing"}
    assert (np.abs(found.fit.estimate - [0.9, 0.3]) < 3 * found.fit.se).all()
    assert (found.fit.se > 2 * found.fit.white_se).all()
    assert found.bootstrap is not None and np.abs(found.bootstrap.se / found.fit.se - 1).max() < 0.4


def test_the_structure_is_told_as_uncertain(found):
    share = dict(zip(found.frequency.names, found.frequency.frequency, strict=True))
    assert share["1"] == 1.0 and share["swing"] + share["copy"] >= 1.0
    best = found.structures[0]
    assert best.terms == ("1", "swing") and best.share == max(s.share for s in found.structures)
    assert sum(s.share for s in found.structures) <= 1.0 + 1e-9
    np.testing.assert_allclose(best.estimate, found.fit.estimate)
    assert found.frequency.by_sigma_max.shape == (len(CEILINGS), 5)
    kept = found.frequency.by_sigma_max.sum(axis=1)
    assert (np.diff(kept) <= 0).all()  # a higher ceiling keeps fewer terms


def test_options_reach_the_search():
    stack = regression(0)
    given = search(stack, NAMES, DT, Search(sigma_max=2.0, noise="given", sigma=0.5, penalty_factor=1.0))
    assert given.selection.ceiling.value == pytest.approx(0.5) and given.selection.penalty_factor == 1.0
    forced = search(stack, NAMES, DT, Search(sigma_max=3.0, first=("slow",)))
    assert forced.selection.terms[0] == "slow" and 3 in forced.columns
    changed = search(stack, NAMES, DT, Search(sigma_max=3.0, exchange=True))
    assert changed.exchanged is not None and set(changed.columns) == {0, 1}
    with pytest.raises(InputError, match="fast"):
        search(stack, NAMES, DT, Search(first=("fast",)))
    with pytest.raises(InputError, match="no term that lowers"):
        identify(stack, NAMES, DT, Search(sigma_max=1e9), np.random.default_rng(0))


def test_several_records_are_one_regression():
    both = stack_records([regression(0), regression(1)])
    one = identify(regression(0), NAMES, DT, Search(sigma_max=3.0), np.random.default_rng(0))
    two = identify(both, NAMES, DT, Search(sigma_max=3.0), np.random.default_rng(0))
    assert two.frequency is None and two.structures == ()
    assert two.fit.se[0] == pytest.approx(one.fit.se[0] / np.sqrt(2), rel=0.4)


def test_the_entry_is_json_and_tells_what_was_found(found):
    how = Search(sigma_max=3.0, replicates=40)
    moved = Propagated(0.1, 0.02, np.array([0.01, 0.02]), np.array([0.0, -0.01]), 8)
    other = regression(2)
    told = entry(found, NAMES, how, DT, checks={"other": other}, units=["1", "s", "s", "1", "1"], propagated=moved)
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    first, second = told["selected"]
    assert (first["term"], second["term"], second["unit"]) == ("1", "swing", "s")
    assert second["differentiation_sd"] == 0.02 and second["frequency"] > 0.5 and second["bootstrap_se"] > 0
    assert told["check"]["other"]["rms_ratio"] == pytest.approx(1.0, abs=0.2)
    rest = other.z - other.X[:, [0, 1]] @ found.fit.estimate
    assert told["check"]["other"]["rms"] == pytest.approx(np.sqrt(np.mean(rest**2)))
    assert told["snr"] == pytest.approx(np.std(found.stack.z) / max(found.noise.sd, 0.02))
    assert told["press"]["ratio"] == pytest.approx(1.0, abs=0.1) and told["press"]["reason"] is None
    assert told["null_models"][0]["name"] == "constant" and told["noise"]["memory"] > 3
    assert {r["term"]: r["rival"] for r in told["rivals"]}["swing"] == "copy"
    (used,) = (step for step in told["sensitivity"] if step["low"] <= told["sigma_max2"] < (step["high"] or np.inf))
    assert used["terms"] == ["1", "swing"]
    penalty = [(row["pe"] ** 2 - row["mse"]) / row["n"] for row in told["ranking"]]
    np.testing.assert_allclose(penalty, 2 * told["sigma_max2"] / told["samples"], rtol=1e-9)


def _told(found, names=NAMES):
    return entry(found, names, Search(sigma_max=3.0), DT, checks={})


def test_all_candidates_are_told_together(found):
    """With the colored covariance of their fit, of which what is told of those left out is a part."""
    told, X = _told(found), found.stack.X
    whole = fit(X, found.stack.z, NAMES)
    together = told["together"]
    assert together["terms"] == NAMES
    np.testing.assert_allclose(together["estimate"], whole.estimate, rtol=1e-9)
    np.testing.assert_allclose(together["covariance"], whole.covariance, rtol=1e-9)
    np.testing.assert_allclose(together["rms"], np.sqrt(np.mean(X**2, axis=0)), rtol=1e-9)
    np.testing.assert_allclose(told["covariance"], found.fit.covariance, rtol=1e-12)
    assert [row["term"] for row in told["left_out"]] == ["copy", "slow", "noise"]
    np.testing.assert_allclose([row["estimate"] for row in told["left_out"]], whole.estimate[2:], rtol=1e-9)
    np.testing.assert_allclose([row["se"] for row in told["left_out"]], whole.se[2:], rtol=1e-9)


def test_sizes_are_those_of_the_rows_that_are_there():
    stack = regression(0)
    X = stack.X.copy()
    X[:100] = np.nan
    found = identify(stack._replace(X=X), NAMES, DT, Search(sigma_max=3.0), np.random.default_rng(1))
    np.testing.assert_allclose(_told(found)["together"]["rms"], np.sqrt(np.mean(stack.X[100:] ** 2, axis=0)), rtol=1e-9)


def test_candidates_that_can_not_be_told_apart_are_not_told_together():
    """A candidate twice: sizes alone, and what was selected."""
    stack, names = regression(0), [*NAMES, "swing again"]
    stack = stack._replace(X=np.column_stack([stack.X, stack.X[:, 1]]))
    found = identify(stack, names, DT, Search(sigma_max=3.0), np.random.default_rng(1))
    told = _told(found, names)
    assert told["together"]["estimate"] is None and told["together"]["covariance"] is None
    assert told["together"]["terms"] == names and len(told["together"]["rms"]) == 6 and told["left_out"] == []
    assert np.shape(told["covariance"]) == (2, 2)


def test_a_large_pool_is_not_told_together(found, monkeypatch):
    monkeypatch.setattr(structure_entry, "_WHOLE", 4)
    told = _told(found)
    assert told["together"]["estimate"] is None and told["left_out"] == []


def test_a_force_that_only_restates_the_weight_is_seen(found):
    q = 57.0 * (1 + 0.1 * np.sin(np.arange(1200) / 30))
    stack = regression(0)._replace(z=48.0 / q)
    stack = stack._replace(z=stack.z + 0.002 * np.random.default_rng(0).normal(size=1200))
    again = identify(stack, NAMES, DT, Search(sigma_max=1.0), np.random.default_rng(0))
    told = entry(again, NAMES, Search(sigma_max=1.0), DT, checks={}, pressure=q)
    assert told["null_model"]["name"] == "constant force" and told["null_model"]["r2"] > 0.99 > told["r2"]


def test_a_block_that_alone_carries_a_term_is_told_not_hidden():
    n = 400
    X = np.column_stack([np.ones(n), np.r_[np.ones(20), np.zeros(n - 20)]])
    z = X @ [1.0, 1.0] + 0.05 * np.random.default_rng(0).normal(size=n)
    stack = stack_components(X[:, None, :], z[:, None])
    how = Search(sigma_max=3.0)
    told = entry(identify(stack, ["1", "start"], DT, how, np.random.default_rng(0)), ["1", "start"], how, DT, checks={})
    assert told["press"]["ratio"] is None and "alone carry" in told["press"]["reason"]


def test_plain_values():
    assert plain({"a": np.array([1.0, np.nan]), "b": (np.int64(2), None), "c": np.inf, "d": True}) == {
        "a": [1.0, None],
        "b": [2, None],
        "c": None,
        "d": True,
    }
