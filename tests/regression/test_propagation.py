from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bayeschute.core.errors import InputError
from bayeschute.records.differentiate import savitzky_golay
from bayeschute.regression.propagation import position_noise, propagate
from bayeschute.regression.stacked import stack_components

DT, SD = 0.1, 0.05


def second_derivative(x):
    return savitzky_golay(savitzky_golay(x, DT, 11), DT, 11)


def record(seed=0, n=900):
    """One canopy that swings, its positions seen with white noise."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(n)
    x = np.stack([20 * np.sin(0.44 * t), 10 * np.cos(0.44 * t), 10 * t], axis=1)[:, None]
    return xr.Dataset(
        {"canopy_position": (("time", "canopy", "axis"), x + SD * rng.normal(size=x.shape), {"units": "m"})},
        {"time": t},
    )


def rebuild(records):
    """Acceleration north as response; constant and a swing known without error as regressors."""
    t = records[0]["time"].values
    a = second_derivative(records[0]["canopy_position"].values[:, 0, 0])
    X = np.column_stack([np.ones(t.size), np.sin(0.44 * t)])
    return {"a": stack_components(X[:, None, :], a[:, None])}


def test_noise_of_the_positions_is_found():
    assert position_noise(record()) == pytest.approx(SD, rel=0.1)
    broken = record()
    broken["canopy_position"].values[::15] = np.nan
    assert position_noise(broken) == 0.0


def test_spread_of_the_coefficients_is_that_of_the_linear_algebra():
    one = record()
    found = propagate([one], rebuild, {"a": [0, 1]}, np.random.default_rng(1), replicates=120)["a"]
    stack = rebuild([one])["a"]
    # the response is linear in the positions: its noise is D e, and the estimates' covariance pinv(X) D D' pinv(X)' s^2
    D = second_derivative(np.eye(900))
    exact = found.position_sd * np.sqrt(np.sum((np.linalg.pinv(stack.X) @ D) ** 2, axis=1))
    np.testing.assert_allclose(found.sd, exact, rtol=0.25)
    assert (np.abs(found.shift) < 4 * exact / np.sqrt(120)).all()
    assert found.response_sd == pytest.approx(found.position_sd * np.linalg.norm(D[450]), rel=0.1)


def test_noisy_regressors_shift_the_estimates_as_theory_says():
    def noisy_regressor(records):
        x = records[0]["canopy_position"].values[:, 0, 0]
        clean = 20 * np.sin(0.44 * records[0]["time"].values)
        return {"a": stack_components((x / 10.0)[:, None, None], (clean / 10.0)[:, None])}

    rough = record()
    rng = np.random.default_rng(2)
    rough["canopy_position"].values[:] += 3.0 * rng.normal(size=rough["canopy_position"].shape)
    found = propagate([rough], noisy_regressor, {"a": [0]}, rng, replicates=20)["a"]
    power, noise = 0.5 * 20**2, found.position_sd**2
    once, twice = power / (power + noise), power / (power + 2 * noise)  # attenuation by noise once and twice
    assert found.shift[0] == pytest.approx(twice - once, rel=0.15)


def test_the_record_stays_as_it_was_and_few_replicates_are_refused():
    one = record()
    before = one["canopy_position"].values.copy()
    propagate([one], rebuild, {"a": [0]}, np.random.default_rng(0), replicates=2)
    np.testing.assert_array_equal(one["canopy_position"].values, before)
    with pytest.raises(InputError):
        propagate([one], rebuild, {"a": [0]}, np.random.default_rng(0), replicates=1)
