"""Latent states by machine code against the recursion in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.likelihood.filter_code.latent_pass import latent_states

pytest.importorskip("llvmlite")


@pytest.mark.parametrize("size", [1, 2, 7])
@pytest.mark.parametrize("columns", [1, 3, 4, 50, 101])
def test_states_follow_the_recursion(size, columns):
    rng = np.random.default_rng(size * columns)
    transition, driven = rng.standard_normal((size, size)) / size, rng.standard_normal((12, size, columns))
    kept, wanted = driven.copy(), [driven[0]]
    for row in driven[1:]:
        wanted.append(transition @ wanted[-1] + row)
    np.testing.assert_allclose(latent_states(transition, driven), wanted, rtol=1e-13, atol=1e-13)
    np.testing.assert_array_equal(driven, kept)


def test_one_sample_is_driven_alone():
    driven = np.arange(6.0).reshape(1, 2, 3)
    np.testing.assert_array_equal(latent_states(np.full((2, 2), np.nan), driven), driven)


def test_a_failed_column_leaves_the_others():
    driven = np.ones((5, 2, 3))
    driven[2, 0, 1] = np.nan
    made = latent_states(np.array([[0.5, 0.1], [0.0, 0.9]]), driven)
    assert np.isfinite(made[..., [0, 2]]).all()
    np.testing.assert_array_equal(
        np.isfinite(made[:, :, 1]), [[True, True]] * 2 + [[False, True]] + [[False, False]] * 2
    )


@pytest.mark.parametrize("shape", [(4, 0, 3), (4, 2, 0)])
def test_no_state_and_no_column_are_no_fault(shape):
    assert latent_states(np.zeros((shape[1], shape[1])), np.zeros(shape)).shape == shape
