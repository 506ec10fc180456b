from __future__ import annotations

from math import comb

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.orthogonal import select
from bayeschute.structure.candidates import (
    decimal_index,
    exponent_tuples,
    product_pool,
    spline,
)


def test_the_report_pool_has_120_candidates():
    rng = np.random.default_rng(0)
    pool = product_pool({f"v{k}": rng.normal(size=5) for k in range(1, 15)}, 2)
    assert len(pool) == 120 == len(set(pool.names)) == len(set(pool.indices))
    named = dict(zip(pool.indices, pool.names, strict=True))
    assert named["0"] == "1" and named["1000"] == "v4" and named["2"] == "v1^2"
    assert named["10010000000000"] == "v11*v14" and named["200"] == "v3^2"


@pytest.mark.parametrize(("n", "order"), [(1, 5), (3, 0), (3, 4), (6, 3)])
def test_exponents_are_all_different_and_complete(n, order):
    rows = exponent_tuples(n, order)
    assert rows.shape == (comb(n + order, order), n)
    assert len({tuple(r) for r in rows}) == len(rows) and rows.sum(axis=1).max() == order
    assert (np.diff(rows.sum(axis=1)) >= 0).all()
    assert len(exponent_tuples(n, order, constant=False)) == len(rows) - 1


def test_columns_are_the_products_their_names_say():
    rng = np.random.default_rng(1)
    values = {"alpha": rng.normal(size=20), "q": rng.normal(size=20)}
    pool = product_pool(values, 3, extra={"shear": np.arange(20.0)})
    matrix = pool.matrix()
    for j, (name, column) in enumerate(pool.columns()):
        np.testing.assert_array_equal(matrix[:, j], column)
        expected = eval(name.replace("^", "**"), {**values, "shear": np.arange(20.0)})
        np.testing.assert_allclose(column, expected * np.ones(20), rtol=1e-13)
    assert pool.indices[-1] == "u1" and pool.names[-1] == "shear"
    np.testing.assert_array_equal(pool.matrix([4, 0]), matrix[:, [4, 0]])
    with pytest.raises(InputError):
        pool.column(len(pool))


def test_splines():
    x = np.array([-1.0, 0.5, 0.8, 2.0, np.nan])
    np.testing.assert_allclose(spline(x, 0.8), [0, 0, 0, 1.2, np.nan])
    np.testing.assert_allclose(spline(x, 0.8, side="below", power=2), [3.24, 0.09, 0, 0, np.nan])
    np.testing.assert_allclose(spline(x, 0.8, power=0), [0, 0, 0, 1, np.nan])
    for bad in ({"side": "left"}, {"power": -1}):
        with pytest.raises(InputError):
            spline(x, 0.8, **bad)
    with pytest.raises(InputError):
        spline(x, np.nan)


def test_products_of_disjoint_splines_are_dropped_by_the_selection():
    x = np.linspace(0, 2, 200)
    variables = {"low": spline(x, 0.8, side="below"), "high": spline(x, 1.2)}
    pool = product_pool(variables, 2)
    s = select(pool.matrix(), 1 + variables["high"], pool.names, indices=pool.indices, sigma_max2=1e-8)
    assert "low*high" in dict(s.dropped) and set(s.terms) == {"1", "high"}


def test_index_of_high_powers_stays_readable():
    assert decimal_index([0, 12, 3]) == "3(12)0" and decimal_index([0, 0]) == "0"


@pytest.mark.parametrize(
    ("variables", "order", "options"),
    [
        ({}, 1, {}),
        ({"a": np.ones(3)}, -1, {}),
        ({"a": np.ones(3)}, 1.5, {}),
        ({"a": np.ones(3), "b": np.ones(4)}, 1, {}),
        ({"a": np.ones((3, 1))}, 1, {}),
        ({"a": np.array(["x"])}, 1, {}),
        ({"a": np.ones(3)}, 1, {"extra": {"a": np.ones(3)}}),
        ({"a": np.ones(3)}, 2, {"extra": {"a^2": np.ones(3)}}),
        ({f"v{k}": np.ones(3) for k in range(40)}, 8, {}),
    ],
)
def test_bad_pools_are_refused(variables, order, options):
    with pytest.raises(InputError):
        product_pool(variables, order, **options)
