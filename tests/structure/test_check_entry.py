from __future__ import annotations

import numpy as np
import pytest

from bayeschute.regression.stacked import stack_components
from bayeschute.structure.check_entry import check_entries
from bayeschute.structure.search import Search, identify

NAMES = ["1", "swing", "chance"]
TRUE = {"1": 0.8, "swing": -0.5}


def regression(seed, chance, n=1500, noise=0.05):
    """Two true terms and one whose coefficient is another on every record."""
    rng = np.random.default_rng(seed)
    X = np.column_stack([np.ones(n), np.sin(0.05 * np.arange(n)), np.cos(0.013 * np.arange(n))])
    z = X @ [*TRUE.values(), chance] + noise * rng.normal(size=n)
    return stack_components(X[:, None, :], z[:, None])


@pytest.fixture(scope="module")
def checks():
    made = identify(regression(0, 0.1), NAMES, 0.1, Search(sigma_max=3.0), np.random.default_rng(0))
    assert set(made.fit.names) == set(NAMES)
    others = {"same": regression(1, 0.1), "other": regression(2, -0.1), "noisy": regression(3, 0.1, noise=0.1)}
    return made, others, check_entries(made, NAMES, others, TRUE)


def test_the_term_to_blame_is_named(checks):
    _, _, found = checks
    assert found["same"]["without"] is None and found["noisy"]["without"] is None
    assert found["other"]["without"]["term"] == "chance"
    assert found["other"]["without"]["rms_ratio"] < found["other"]["rms_ratio"]
    # Left out, what remains is the term's own size beside the noise.
    assert found["other"]["without"]["rms_ratio"] == pytest.approx(np.hypot(0.05, 0.1 / np.sqrt(2)) / 0.05, rel=0.05)
    assert found["other"]["least_ratio"] == pytest.approx(1.0, abs=0.05)


def test_a_noisy_record_is_no_fault_of_the_model(checks):
    _, _, found = checks
    noisy = found["noisy"]
    assert noisy["rms_ratio"] == pytest.approx(2.0, rel=0.05)
    assert noisy["least_ratio"] == pytest.approx(noisy["rms_ratio"], rel=0.01)
    assert 1.0 < noisy["expected_ratio"] < 1.05


def test_true_coefficients_where_someone_knows(checks):
    made, others, found = checks
    rest = others["other"].z - others["other"].X @ [0.8, -0.5, 0.0]
    assert found["other"]["true_ratio"] == pytest.approx(np.sqrt(np.mean(rest**2)) / made.fit.rms)
    assert check_entries(made, NAMES, others)["other"]["true_ratio"] is None
    assert check_entries(made, NAMES, others, {"unheard of": 1.0})["other"]["true_ratio"] is None


def test_gaps_and_a_single_term():
    stack = regression(0, 0.0)
    stack.z[10:20] = np.nan
    made = identify(stack, NAMES, 0.1, Search(sigma_max=1e5), np.random.default_rng(0))
    assert made.fit.names == ("1",)
    other = regression(1, 0.0)
    other.X[5, 0] = np.nan
    (told,) = check_entries(made, NAMES, {"other": other}, {"1": 0.8}).values()
    assert told["without"] is None and told["samples"] == 1499 and np.isfinite(told["true_ratio"])
