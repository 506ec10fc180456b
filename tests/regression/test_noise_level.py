from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.records.sensors import ornstein_uhlenbeck
from bayeschute.regression.noise_level import longest_run, noise_level, series_noise
from bayeschute.regression.orthogonal import select
from bayeschute.regression.stacked import stack_components

DT = 0.1


def record(rng, candidates, tau=0.5, sd=0.2, n=6000):
    """Swings of many frequencies, two of them true, in noise that remembers."""
    t = DT * np.arange(n)[:, None]
    X = np.cos(2 * np.pi * rng.uniform(0.05, 0.8, size=candidates) * t + rng.uniform(0, 6, size=candidates))
    X[:, 0] = 1.0
    z = X[:, [0, 1]] @ [2.0, 1.0] + ornstein_uhlenbeck(sd, tau, DT, (n,), rng)
    return stack_components(X[:, None, :], z[:, None]), [f"x{j}" for j in range(candidates)]


@pytest.mark.parametrize("candidates", [6, 60])
def test_colored_level_is_variance_times_memory(candidates):
    rng = np.random.default_rng(candidates)
    phi = np.exp(-DT / 0.5)
    true = 0.04 * (1 + phi) / (1 - phi)
    found = [noise_level(*record(rng, candidates), DT, factor=5.0).variance / true for _ in range(4)]
    assert np.mean(found) == pytest.approx(1.0, abs=0.2)


def test_with_the_colored_level_noise_keeps_no_term_and_with_the_white_one_many():
    rng = np.random.default_rng(1)
    stack, names = record(rng, 40, n=1500)
    colored = noise_level(stack, names, DT, factor=5.0)
    white = noise_level(stack, names, DT, source="smoothing")
    assert colored.memory > 5 > white.memory == 1.0
    kept = [select(stack.X, stack.z, names, sigma_max2=5 * v.variance).minimum for v in (colored, white)]
    assert kept[0] <= 3 and kept[1] > 6


def test_the_other_sources():
    stack, names = record(np.random.default_rng(2), 6)
    assert noise_level(stack, names, DT, source="given", sigma=0.3)[:3] == pytest.approx((0.09, 0.3, 1.0))
    assert noise_level(stack, names, DT, source="variance").variance == pytest.approx(np.var(stack.z))
    for bad in ({"source": "other"}, {"source": "given"}, {"source": "given", "sigma": 0.0}):
        with pytest.raises(InputError):
            noise_level(stack, names, DT, **bad)


def test_data_without_noise_have_no_level():
    X = np.random.default_rng(3).normal(size=(100, 3))
    stack = stack_components(X[:, None, :], (X @ [1.0, 2.0, 3.0])[:, None])
    assert noise_level(stack, list("abc"), DT).variance < 1e-25
    with pytest.raises(InputError, match="above 0"):
        noise_level(stack_components(X[:, None, :], np.zeros((100, 1))), list("abc"), DT)


def test_a_collinear_pool_is_no_obstacle():
    rng = np.random.default_rng(4)
    stack, names = record(rng, 6)
    doubled = stack._replace(X=np.column_stack([stack.X, 3 * stack.X[:, 1]]))
    assert noise_level(doubled, [*names, "copy"], DT).variance == pytest.approx(noise_level(stack, names, DT).variance)


def test_series_noise_uses_the_longest_stretch():
    rng = np.random.default_rng(5)
    z = 3.0 + np.sin(np.arange(600) / 20) + 0.1 * rng.normal(size=600)
    z[100:110] = np.nan
    found = series_noise(stack_components(np.ones((600, 1, 1)), z[:, None]), DT)
    assert found.sd == pytest.approx(0.1, rel=0.15) and found.with_mean > found.about_mean > 5
    assert longest_run(np.isfinite(z)) == slice(110, 600) and longest_run(np.zeros(3, bool)) == slice(0, 0)
    z[::20] = np.nan
    with pytest.raises(InputError, match="40 samples"):
        series_noise(stack_components(np.ones((600, 1, 1)), z[:, None]), DT)
