"""What a regression is given: rows in use, variances within groups, labels, and every fault at once."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.problem import group_variance, out_of_range, positive, read_problem, row_labels


def test_rows_with_a_missing_value_are_left_out():
    rng = np.random.default_rng(0)
    X, z = rng.standard_normal((9, 2)), rng.standard_normal(9)
    whole = read_problem(X, z, None, "fit")
    assert whole.X is X and whole.names == ("x1", "x2") and whole.used.all()
    X[2, 1] = z[6] = np.nan
    made = read_problem(X, z, ("a", "b"), "fit")
    keep = [0, 1, 3, 4, 5, 7, 8]
    np.testing.assert_array_equal(np.flatnonzero(made.used), keep)
    np.testing.assert_array_equal(made.X, X[keep])
    np.testing.assert_array_equal(made.z, z[keep])
    assert made.names == ("a", "b")


@pytest.mark.parametrize(
    ("size", "out"),
    [(0.0, False), (1e-59, False), (1e59, False), (1e-61, True), (1e61, True), (np.inf, True), (np.nan, False)],
)
def test_magnitudes_whose_squares_leave_double_precision(size, out):
    assert out_of_range(size) is out
    if np.isnan(size):
        return
    for sign in (-1.0, 1.0):
        X, z = np.full((3, 1), sign * size), np.full(3, sign * size)
        if out:
            with pytest.raises(InputError) as caught:
                read_problem(X, z, ("a",), "fit")
            assert [f.where for f in caught.value.faults] == ["fit column 'a'", "fit z"]
        else:
            assert read_problem(X, z, None, "fit").z[0] == sign * size


def test_all_faults_are_told():
    X = np.array([[np.inf, 1.0, np.nan], [1.0, 1e-70, np.nan]])
    with pytest.raises(InputError) as caught:
        read_problem(X, np.array([1.0, -np.inf]), ("a", "b", "c"), "fit")
    said = [str(f) for f in caught.value.faults]
    assert len(said) == 3 or len(said) == 4
    for word in ("column 'a'", "an infinite value of inf"), ("fit z", "an infinite"), ("no row", "'c' wholly missing"):
        assert any(all(w in s for w in word) for s in said), said


@pytest.mark.parametrize(
    ("X", "z", "names", "word"),
    [
        (np.ones((3, 2)), np.ones(4), None, r"X \(3, 2\) and z \(4,\)"),
        (np.ones((0, 2)), np.ones(0), None, "at least one column and row"),
        (np.ones((3, 2)), np.ones(3), ("a", "a"), "1 different names"),
        (np.ones((3, 2)), np.ones(3), ("a",), "1 different names"),
        (np.ones(3), np.ones(3), None, "1 dimensions"),
        (np.ones((3, 2), complex), np.ones(3), None, "real numbers in 2"),
        (np.ones((3, 1)), ["a", "b", "c"], None, "real numbers in 1"),
        ([[1.0], [1.0, 2.0]], np.ones(2), None, "unequal length"),
    ],
)
def test_what_is_no_regression_is_refused(X, z, names, word):
    with pytest.raises(InputError, match=word):
        read_problem(X, z, names, "fit")


def test_integers_and_truths_are_numbers():
    made = read_problem(np.array([[True], [False]]), np.array([1, 2]), None, "fit")
    assert made.X.dtype == made.z.dtype == np.float64 and made.X[:, 0].tolist() == [1.0, 0.0]


def test_variance_within_groups_is_that_of_a_loop():
    rng = np.random.default_rng(1)
    labels = rng.choice([0, 2, 3], 50)  # one number is not used
    z = rng.standard_normal(50) * 3.0 + np.array([5.0, 0.0, -400.0, 2.0])[labels]
    wanted = sum(np.sum((z[labels == g] - z[labels == g].mean()) ** 2) for g in (0, 2, 3)) / 50
    assert group_variance(z, labels) == pytest.approx(wanted)
    assert group_variance(10.0 * z + 7.0, labels) == pytest.approx(100.0 * wanted)
    one = np.zeros(50, int)
    assert group_variance(z, one) == pytest.approx(z.var())


def test_rounding_is_no_variance():
    z = np.full(40, 0.1) * np.array([1.0, 3.0])[np.arange(40) % 2]
    assert 0.0 < np.abs(z[::2] - z[::2].mean()).max() < 1e-15  # sums are rounded
    assert group_variance(z, np.arange(40) % 2) == 0.0
    assert group_variance(z, np.zeros(40, int)) == pytest.approx(0.01)


def test_labels_are_numbered_as_they_appear():
    assert row_labels(["b", "a", "b", ("c", 1)], 4, "g").tolist() == [0, 1, 0, 2]
    assert row_labels(np.array([7, 7, -1]), 3, "g").tolist() == [0, 0, 1]
    assert row_labels(None, 3, "g").tolist() == [0, 0, 0]
    for bad in (["a"], np.zeros((3, 1))):
        with pytest.raises(InputError, match="one for each of the 3 rows"):
            row_labels(bad, 3, "g")


def test_positive_numbers():
    positive("dt", 1e-300)
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="a finite number above 0"):
            positive("dt", bad)


@pytest.mark.parametrize("rows", [999, 1001, 3001])
def test_rounding_of_a_mean_is_no_variance_however_large_the_values(rows):
    same = np.full(rows, 1e8 + 0.1)
    labels = np.zeros(rows, int)
    assert np.mean((same - np.bincount(labels, weights=same) / rows) ** 2) > 0.0
    assert group_variance(same, labels) == 0.0
    assert group_variance(1e-12 * same, labels) == 0.0
