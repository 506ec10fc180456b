"""What the comparison with reference posteriors computes, on draws whose answer is known."""

from __future__ import annotations

import json

import numpy as np
import pytest
import reference_posteriors as benchmark

from bayeschute.likelihood.priors import Prior


def test_a_weight_counts_like_as_many_draws():
    rng = np.random.default_rng(0)
    x, times = rng.standard_normal(4000), rng.integers(1, 4, 4000)
    weighed, repeated = benchmark.told(x, times / times.sum()), benchmark.told(np.repeat(x, times))
    for key, value in weighed.items():
        assert value == pytest.approx(repeated[key], abs=2e-3)


def test_differences_are_in_standard_deviations_of_the_reference():
    reference = {"parameters": {"a": {"mean": 1.0, "sd": 2.0, "q05": -2.29, "q95": 4.29}}}
    draws = 3.0 + 2.2 * np.random.default_rng(1).standard_normal((200_000, 1))
    row = benchmark.compared(reference, draws, (Prior("a", 0.0, 1.0, False, "1", ""),))["a"]
    assert row["mean"] == pytest.approx(1.0, abs=0.01) and row["sd"] == pytest.approx(0.1, abs=0.01)
    assert row["q95"] == pytest.approx(1.0 + 0.1 * 1.645, abs=0.02)


def test_what_is_stored_can_be_trusted():
    """References rest on weights whose tail is tame, and on simulations that came to rest."""
    files = sorted(benchmark.STORED.glob("*.json"))
    if not files:
        pytest.skip("no reference is stored")
    for file in files:
        made = json.loads(file.read_text(encoding="utf-8"))
        assert made["pareto_k"] < 0.7 and made["effective_draws"] > 100, file.name
        assert made["folded"] <= 1e-3 * made["draws"], file.name
