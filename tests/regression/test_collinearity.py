from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.regression.collinearity import collinearity


def two_columns(r, n=500):
    rng = np.random.default_rng(0)
    pair = rng.normal(size=(n, 2))
    pair = np.linalg.qr(pair - pair.mean(axis=0))[0]
    return np.column_stack([3.0 + pair[:, 0], -1.0 + r * pair[:, 0] + np.sqrt(1 - r**2) * pair[:, 1]])


@pytest.mark.parametrize("r", [-0.95, 0.0, 0.5, 0.99])
def test_vif_of_two_columns_is_closed(r):
    c = collinearity(two_columns(r), ["a", "b"])
    assert c.correlation[0, 1] == pytest.approx(r, abs=1e-9) and c.max_correlation == pytest.approx(abs(r), abs=1e-9)
    np.testing.assert_allclose(c.vif, 1 / (1 - r**2), rtol=1e-8)
    assert ("correlation" in c.flags) == (abs(r) > 0.9) and ("vif" in c.flags) == (r**2 > 0.9)
    assert c.pair == ("a", "b") and c.sentences


def test_vif_is_the_inverse_correlation_matrix_and_constants_have_none():
    rng = np.random.default_rng(1)
    X = rng.normal(size=(100, 4)) @ rng.normal(size=(4, 4)) + 5.0
    c = collinearity(np.column_stack([np.ones(100), X]))
    np.testing.assert_allclose(c.vif[1:], np.diag(np.linalg.inv(np.corrcoef(X.T))), rtol=1e-8)
    assert np.isnan(c.vif[0]) and np.isnan(c.correlation[0]).all()
    np.testing.assert_allclose(c.correlation[1:, 1:], np.corrcoef(X.T), atol=1e-12)


def test_condition_index_of_nearly_equal_columns():
    angle = 0.01
    X = np.zeros((4, 2))
    X[:2] = [[1.0, np.cos(angle)], [0.0, np.sin(angle)]]
    c = collinearity(X, ["a", "b"], centred=False)
    assert c.condition_index == pytest.approx(1 / np.tan(angle / 2), rel=1e-9) and "condition" in c.flags
    assert c.correlation[0, 1] == pytest.approx(np.cos(angle))


def test_a_dependent_set_is_flagged_as_infinite():
    rng = np.random.default_rng(2)
    x = rng.normal(size=(60, 3))
    c = collinearity(np.column_stack([x, x[:, 0] + x[:, 1]]), ["a", "b", "c", "sum"])
    assert np.isinf(c.vif[[0, 1, 3]]).all() and c.vif[2] < 2 and c.max_vif == np.inf and c.flagged
    assert c.condition_index > 1e8 and any("a, b, sum" in s for s in c.sentences)
    wide = collinearity(rng.normal(size=(5, 9)))
    assert wide.condition_index == np.inf and wide.max_vif == np.inf


def test_good_regressors_raise_no_flag():
    c = collinearity(np.random.default_rng(3).normal(size=(500, 3)))
    assert not c.flagged and len(c.sentences) == 1
    alone = collinearity(np.ones((5, 1)))
    assert alone.pair == ("", "") and alone.max_vif == 1.0 and not alone.flagged


def test_collinearity_refuses_bad_columns():
    for bad in (np.zeros((5, 2)), np.ones(5), np.full((5, 2), np.nan), np.full((5, 1), np.inf)):
        with pytest.raises(InputError):
            collinearity(bad)
