from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from bayeschute.core.errors import InputError
from bayeschute.regression.bootstrap import block_bootstrap
from bayeschute.regression.equation_error import fit


def ar1(rng, n, phi, series=1):
    start = 300
    noise = lfilter([1.0], [1.0, -phi], rng.normal(size=(series, n + start)), axis=1)[:, start:]
    return noise[0] if series == 1 else noise


def pendulum(n):
    t = np.arange(n) / 10
    return np.column_stack([np.ones(n), np.sin(2 * np.pi * t / 15), np.cos(2 * np.pi * t / 15) ** 2, np.sin(t / 5.6)])


def test_bootstrap_agrees_with_the_covariance():
    rng = np.random.default_rng(7)
    X = pendulum(1200)
    ratios = []
    for _ in range(6):
        z = X @ [1.0, 2.0, 0.0, -1.0] + ar1(rng, 1200, 0.9)
        f = fit(X, z)
        draws = block_bootstrap(X, z, rng=rng, replicates=150)
        ratios.append(draws.se / f.se)
    assert draws.block_length == 120 and draws.estimates.shape == (150, 4)
    assert (np.abs(np.mean(ratios, 0) - 1.0) < 0.25).all()
    pairs = block_bootstrap(X, z, rng=rng, replicates=100, kind="pairs")
    assert (pairs.se > 2.0 * f.white_se).all()


def test_bootstrap_is_reproducible_and_draws_components_together():
    rng = np.random.default_rng(8)
    e = ar1(rng, 60, 0.5)
    X = np.column_stack([np.repeat([1.0, 0.0], 60), np.repeat([0.0, 1.0], 60)])
    z = np.concatenate([e, e])
    z[7] = np.nan
    layout = {"blocks": np.repeat([0, 1], 60), "groups": np.zeros(120)}
    one = block_bootstrap(X, z, rng=np.random.default_rng(1), replicates=50, **layout)
    two = block_bootstrap(X, z, rng=np.random.default_rng(1), replicates=50, **layout)
    np.testing.assert_array_equal(one.estimates, two.estimates)
    assert np.corrcoef(one.estimates.T)[0, 1] > 0.9
    apart = block_bootstrap(X, z, rng=np.random.default_rng(1), replicates=50, blocks=layout["blocks"])
    assert abs(np.corrcoef(apart.estimates.T)[0, 1]) < 0.5


def test_bad_options_are_refused():
    rng, X, z = np.random.default_rng(0), np.ones((20, 1)), np.arange(20.0)
    for options in ({"kind": "x"}, {"replicates": 1}, {"block_length": 0}):
        with pytest.raises(InputError):
            block_bootstrap(X, z, rng=rng, **options)
    with pytest.raises(InputError, match="depend"):
        block_bootstrap(np.ones((20, 2)), z, rng=rng)
    z2 = np.where(np.arange(20) < 10, np.nan, z)
    z2 = np.r_[z2, np.where(np.arange(20) < 10, z, np.nan)]
    with pytest.raises(InputError, match="never complete"):
        block_bootstrap(np.ones((40, 1)), z2, rng=rng, blocks=np.repeat([0, 1], 20), groups=np.zeros(40))
