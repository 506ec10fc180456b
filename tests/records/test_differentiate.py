"""Smooth differentiation: exact on polynomials, honest about gaps, with the printed weights."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayeschute.core.errors import InputError
from bayeschute.records.differentiate import savitzky_golay


def response(f, n=9):
    """Matrix of a linear operator on n samples."""
    return np.stack([f(row) for row in np.eye(n)], axis=1)


def test_weights_are_the_printed_ones():
    dt = 0.1
    m = response(lambda x: savitzky_golay(x, dt))
    np.testing.assert_allclose(m[4, 2:7] * 10 * dt, [-2, -1, 0, 1, 2], atol=1e-12)
    np.testing.assert_allclose(m[0, :5] * 70 * dt, [-54, 13, 40, 27, -26], atol=1e-11)
    np.testing.assert_allclose(m[1, :5] * 70 * dt, [-34, 3, 20, 17, -6], atol=1e-11)
    np.testing.assert_allclose(m[-1, -5:] * 70 * dt, [26, -27, -40, -13, 54], atol=1e-11)


@pytest.mark.parametrize(("window", "degree"), [(5, 2), (7, 3), (11, 4), (9, 1)])
def test_exact_on_polynomials_up_to_its_degree(window, degree):
    t = np.arange(40) * 0.05
    p = np.polynomial.Polynomial(np.arange(1.0, degree + 2))
    for order in range(degree + 1):
        want = p.deriv(order)(t) if order else p(t)
        np.testing.assert_allclose(savitzky_golay(p(t), 0.05, window, order, degree), want, rtol=1e-6, atol=1e-6)


def test_agrees_with_scipy():
    scipy_signal = pytest.importorskip("scipy.signal")
    x = np.random.default_rng(0).standard_normal((50, 3))
    want = scipy_signal.savgol_filter(x, 11, 3, deriv=1, delta=0.2, axis=0, mode="interp")
    np.testing.assert_allclose(savitzky_golay(x, 0.2, 11, 1, 3), want, atol=1e-12)


@given(
    hole=st.integers(0, 29),
    window=st.sampled_from([5, 7, 11]),
    x=st.lists(st.floats(-1e3, 1e3), min_size=30, max_size=30),
)
@settings(max_examples=60, deadline=None)
def test_a_window_that_touches_a_gap_gives_nan_and_no_other_changes(hole, window, x):
    whole = np.array(x)
    holed = whole.copy()
    holed[hole] = np.nan
    a, b = savitzky_golay(whole, 0.1, window), savitzky_golay(holed, 0.1, window)
    half = window // 2
    starts = np.clip(np.arange(30) - half, 0, 30 - window)
    touched = (starts <= hole) & (hole < starts + window)
    assert (np.isnan(b) == touched).all()
    np.testing.assert_array_equal(a[~touched], b[~touched])


@pytest.mark.parametrize(
    ("kwargs", "word"),
    [
        ({"dt": 0.0}, "positive"),
        ({"dt": float("nan")}, "positive"),
        ({"window": 4}, "odd"),
        ({"window": 5, "degree": 5}, "degree"),
        ({"window": 31}, "at least 31"),
    ],
)
def test_unfit_input_is_refused(kwargs, word):
    with pytest.raises(InputError, match=word):
        savitzky_golay(np.zeros(20), **{"dt": 0.1, **kwargs})
