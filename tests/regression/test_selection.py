"""Structures kept under a ceiling, against trying every length, on paths of random mean squared errors."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.noise_ceiling import noise_ceiling
from bayeschute.regression.orthogonal import select
from bayeschute.regression.selection import least_pse

N, P = 60, 9


@pytest.fixture(scope="module", params=range(3))
def path(request):
    rng = np.random.default_rng(request.param)
    X = rng.normal(size=(N, P)) + rng.normal(size=(N, 1))
    z = X[:, :3] @ [1.0, 0.5, 0.2] + rng.normal(size=N)
    return X, z, select(X, z, sigma_max2=2.0, penalty_factor=1.5)


def _best(mse: np.ndarray, cost: float) -> int:
    best = 0
    for n in range(len(mse)):
        if mse[n] + cost * n < mse[best] + cost * best:
            best = n
    return best


def test_the_least_of_all_lengths_is_kept(path):
    X, z, s = path
    mse = [np.mean(z**2)]
    for n in range(1, P + 1):
        columns = X[:, s.order[:n]]
        mse.append(np.mean((z - columns @ np.linalg.lstsq(columns, z, rcond=None)[0]) ** 2))
    np.testing.assert_allclose(s.mean_squared_errors(), mse, rtol=1e-9)
    for value in np.geomspace(1e-3, 1e3, 60):
        found = s.at(value)
        assert found.n == _best(np.array(mse), 1.5 * value / N) and found.sigma_max2 == value
        assert found.low <= value < found.high and found.terms == tuple(s.names[j] for j in s.order[: found.n])


def test_every_structure_is_told_once_with_the_range_that_keeps_it(path):
    _, _, s = path
    told = s.sensitivity()
    sizes = [one.n for one in told]
    assert sizes == sorted(sizes, reverse=True) and sizes[-1] == 0
    assert {s.at(value).n for value in np.geomspace(1e-4, 1e4, 400)} <= set(sizes)
    assert told[0].low == 0.0 and told[-1].high == np.inf
    for one, other in zip(told[:-1], told[1:], strict=True):
        assert one.high == pytest.approx(other.low)
        assert s.at(one.high * (1 - 1e-9)).n == one.n and s.at(one.high * (1 + 1e-9)).n == other.n
    for one in told:
        assert one.low < one.sigma_max2 < one.high and s.at(one.sigma_max2).n == one.n
    some = s.sensitivity([0.5, 3.0])
    assert [one.sigma_max2 for one in some] == [0.5, 3.0] and [one.n for one in some] == [s.at(0.5).n, s.at(3.0).n]


@pytest.mark.parametrize("factor", [None, 3.0])
def test_another_ceiling_on_the_same_path_is_a_selection_anew(path, factor):
    X, z, s = path
    made = s.with_ceiling(noise_ceiling(None, sigma_max2=5.0), factor)
    anew = select(X, z, sigma_max2=5.0, penalty_factor=factor or 1.5)
    assert made.minimum == anew.minimum and made.terms == anew.terms and made.penalty_factor == anew.penalty_factor
    np.testing.assert_allclose(made.estimate, anew.estimate)
    assert made.rows == anew.rows


def test_coefficients_are_those_of_a_refit_and_lengths_beyond_the_path_are_refused(path):
    X, z, s = path
    for n in range(P + 1):
        wanted = np.linalg.lstsq(X[:, s.order[:n]], z, rcond=None)[0]
        np.testing.assert_allclose(s.coefficients(n), wanted, atol=1e-10)
    for n in (-1, P + 1):
        with pytest.raises(InputError, match=f"0 to {P}"):
            s.coefficients(n)
    with pytest.raises(InputError):
        s.at(0.0)
    with pytest.raises(InputError):
        s.with_ceiling(s.ceiling, 0.0)


def test_a_cut_path_is_certain_where_no_longer_one_could_pay():
    """An error can't fall below 0, so a path one longer costs at least the price of its length."""
    mse = np.array([9.0, 4.0, 1.0])
    assert least_pse(mse, 0.5, 0, True) == (2, True)
    assert least_pse(mse, 0.99, 0, False) == (2, False)  # 3 * 0.99 < 1 + 2 * 0.99
    assert least_pse(mse, 1.0, 0, False) == (2, True)
    assert least_pse(mse, 10.0, 0, False) == (0, True)
    assert least_pse(mse, 10.0, 1, False) == (1, True)
    assert least_pse(np.array([2.0, 2.0, 2.0]), 0.0, 0, False) == (0, False)


def test_a_structure_of_a_cut_path_says_so(path):
    X, z, _ = path
    cut = select(X, z, sigma_max2=2.0, penalty_factor=1.5, max_terms=2)
    assert not cut.at(1e-6).certain and cut.at(1e4).certain and not cut.sensitivity()[0].certain
    for value in np.geomspace(0.01, 100.0, 30):
        n, certain = least_pse(cut.mean_squared_errors(), 1.5 * value / N, 0, False)
        assert cut.at(value).n == n and cut.at(value).certain == certain


def test_forced_terms_stay_at_any_ceiling(path):
    X, z, _ = path
    held = select(X, z, sigma_max2=1e6, forced=(7, 8))
    assert held.minimum == 2 and held.order[:2] == (7, 8)
    assert min(one.n for one in held.sensitivity()) == 2 and held.at(1e9).n == 2


def test_the_print_out_marks_the_minimum_and_names_the_rule(path):
    _, _, s = path
    head, *rows, foot = s.print_out(4).splitlines()
    assert len(rows) == 4 and "sqrt(mse)" in head
    marked = [i + 1 for i, row in enumerate(rows) if row.endswith("<- minimum")]
    assert marked == ([s.minimum] if s.minimum <= 4 else [])
    assert float(rows[0].split()[2]) == pytest.approx(np.sqrt(s.rows[0].mse), rel=1e-3)
    assert all(row.term in line for row, line in zip(s.rows, rows, strict=False))
    assert foot == f"penalty 1.5 sigma_max^2 n/N, N = {N}; {s.ceiling.sentence}"
