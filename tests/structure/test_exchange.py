from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.orthogonal import select
from bayeschute.structure.exchange import compress, exchange


def trap(n=400):
    """A third column that looks like the sum of the two true ones, so that the greedy choice begins with it."""
    rng = np.random.default_rng(0)
    a, b, other = rng.normal(size=(3, n))
    X = np.column_stack([a, b, (a + b) / np.sqrt(2.0) + 0.1 * other, rng.normal(size=(n, 4))])
    return X, a + b + 0.01 * rng.normal(size=n)


def pse(X, z, columns, per_term):
    rest = z - X[:, columns] @ np.linalg.lstsq(X[:, columns], z, rcond=None)[0] if columns else z
    return float(rest @ rest + per_term * len(columns)) / z.size


def test_a_compromise_that_was_chosen_first_is_taken_out():
    X, z = trap()
    s = select(X, z, sigma_max2=0.01)
    assert s.order[0] == 2 and 2 in s.selected
    found = exchange(s, X, z)
    assert set(found.terms) == {"x1", "x2"} and [m.removed for m in found.moves] == ["x3"]
    assert found.pse == pytest.approx(pse(X, z, [0, 1], 2.0 * 0.01), rel=1e-9) and found.pse < found.start
    assert found.start == pytest.approx(s.rows[s.minimum - 1].pse, rel=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_no_single_change_improves_the_set(seed):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(60, 3)) @ rng.normal(size=(3, 9)) + 0.3 * rng.normal(size=(60, 9))
    z = X[:, [1, 4, 7]] @ [1.0, -1.0, 0.5] + 0.3 * rng.normal(size=60)
    s = select(X, z, sigma_max2=0.3)
    found = exchange(s, X, z)
    here = pse(X, z, list(found.columns), 0.6)
    assert found.pse == pytest.approx(here, rel=1e-9) and here <= s.rows[s.minimum - 1].pse * (1 + 1e-9)
    neighbours = []
    for n in range(len(found.columns) - 1, len(found.columns) + 2):
        for other in combinations(range(9), n):
            if len(set(other) ^ set(found.columns)) <= 2:
                neighbours.append(pse(X, z, list(other), 0.6))
    assert here <= min(neighbours) * (1 + 1e-9)


def test_a_sound_selection_stays_and_is_told_in_order_of_merit():
    rng = np.random.default_rng(1)
    X = rng.normal(size=(300, 10))
    z = X[:, [3, 6]] @ [1.0, 3.0] + 0.1 * rng.normal(size=300)
    s = select(X, z, noise_variance=0.01)
    found = exchange(s, X, z)
    assert found.moves == () and found.columns == s.selected == (6, 3)
    nothing = exchange(select(X, z, sigma_max2=1e9), X, z)
    assert nothing.columns == () and nothing.pse == pytest.approx(np.mean(z**2))


def test_forced_terms_stay_first():
    X, z = trap()
    found = exchange(select(X, z, sigma_max2=0.01, forced=[5]), X, z)
    assert found.terms[0] == "x6" and set(found.terms[1:]) == {"x1", "x2"}


def test_more_candidates_than_half_the_rows_and_copies():
    rng = np.random.default_rng(2)
    X = rng.normal(size=(40, 30))
    X = np.column_stack([X, X[:, 3], np.zeros(40)])
    z = 2.0 * X[:, 3] + 0.05 * rng.normal(size=40)
    found = exchange(select(X, z, noise_variance=0.0025), X, z)
    assert found.columns in ((3,), (30,))


def test_rows_with_missing_values_are_left_out_and_bad_options_refused():
    X, z = trap()
    z[3], X[9, 1] = np.nan, np.nan
    s = select(X, z, sigma_max2=0.01)
    assert set(exchange(s, X, z).terms) == {"x1", "x2"}
    assert exchange(s, X, z, most_moves=0).columns == s.selected
    for bad in ({"most_moves": -1}, {"tolerance": 0.0}):
        with pytest.raises(InputError):
            exchange(s, X, z, **bad)
    with pytest.raises(InputError):
        exchange(s, X[:, :3], z)


def test_candidates_compressed_beforehand_give_the_same():
    X, z = trap()
    z[7] = np.nan
    packed = compress(X, z)
    assert packed.columns.shape == (7, 7) and packed.basis is not None
    for response in (z, z + X[:, 3]):
        s = select(X, response, sigma_max2=0.01)
        assert exchange(s, X, response, compressed=packed) == exchange(s, X, response)
    full = np.where(np.isnan(z), 0.0, z)  # other rows: compressed again, not taken as they are
    s = select(X, full, sigma_max2=0.01)
    assert exchange(s, X, full, compressed=packed) == exchange(s, X, full)
    assert compress(X[:10], z[:10]).basis is None
