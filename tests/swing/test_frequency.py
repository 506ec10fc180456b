"""Least squares and output error on transforms, apart from any pendulum."""

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.swing.fourier import finite_transform, harmonics
from bayeschute.swing.frequency import frequency_least_squares, frequency_output_error

rng = np.random.default_rng(4)
F = np.arange(1, 31) / 20.0


def complex_normal(shape, rng=rng):
    return rng.standard_normal(shape) + 1j * rng.standard_normal(shape)


def test_least_squares_is_that_of_stacked_real_and_imaginary_parts():
    X, b = complex_normal((30, 3)), np.array([1.0, -2.0, 0.5])
    z = X @ b + 0.1 * complex_normal(30)
    made = frequency_least_squares(X, z, ["a", "b", "c"], F, 20.0)
    A, y = np.vstack([X.real, X.imag]), np.r_[z.real, z.imag]
    wanted, rest = np.linalg.lstsq(A, y, rcond=None)[:2]
    np.testing.assert_allclose(made.estimate, wanted)
    np.testing.assert_allclose(made.covariance, rest[0] / 57 * np.linalg.inv(A.T @ A))
    assert made.value("b") == made.estimate[1] and made.error("c") == made.se[2]


def test_intervals_of_least_squares_cover():
    X, b, inside = complex_normal((30, 2)), np.array([1.0, -2.0]), 0
    for _ in range(400):
        made = frequency_least_squares(X, X @ b + complex_normal(30), ["a", "b"], F, 20.0)
        inside += abs(made.estimate[0] - 1.0) < 1.672 * made.se[0]
    assert 0.86 < inside / 400 < 0.94


def decay(theta, n=200, dt=0.05):
    """Not linear in its parameters, two outputs."""
    t = np.arange(n) * dt
    x = theta[0] * np.exp(-theta[1] * t) * np.cos(theta[2] * t)
    return np.column_stack([x, x**3])


def test_output_error_of_a_nonlinear_model():
    truth, z = np.array([1.0, 0.2, 4.0]), []
    band = harmonics(199 * 0.05, 0.1, 3.0)
    for seed in range(40):
        noise = np.random.default_rng(seed).standard_normal((200, 2)) * [0.05, 0.1]
        start = truth * [0.9, 1.4, 1.02]
        made = frequency_output_error(decay, start, decay(truth) + noise, 0.05, band, ["a", "b", "w"])
        assert made.converged
        z.append((made.estimate - truth) / made.se)
    assert (np.abs(np.mean(z, axis=0)) < 0.55).all() and (np.abs(np.std(z, axis=0) - 1.0) < 0.35).all()
    # The noise of a transform's harmonics has variance sd^2 dt T.
    wanted = np.array([0.05, 0.1]) ** 2 * 0.05 * 199 * 0.05
    np.testing.assert_allclose(np.diag(made.noise).real, wanted, rtol=0.6)


def test_residual_is_data_minus_model():
    truth, band = np.array([1.0, 0.2, 4.0]), harmonics(199 * 0.05, 0.1, 3.0)
    data = decay(truth) + 0.05 * np.random.default_rng(0).standard_normal((200, 2))
    made = frequency_output_error(decay, truth, data, 0.05, band, ["a", "b", "w"])
    wanted = finite_transform(data - decay(made.estimate), 0.05, band)
    np.testing.assert_allclose(made.residual, wanted, atol=1e-10)


def test_what_does_not_converge_says_so():
    data = decay(np.array([1.0, 0.2, 4.0]))
    band = harmonics(199 * 0.05, 0.1, 3.0)
    made = frequency_output_error(decay, [0.5, 0.5, 3.7], data, 0.05, band, ["a", "b", "w"], max_iterations=1)
    assert not made.converged and made.iterations == 1


def test_bad_input():
    X = complex_normal((30, 2))
    with pytest.raises(InputError, match="depend on each other"):
        frequency_least_squares(np.column_stack([X, X[:, 0]]), X[:, 1], ["a", "b", "c"], F, 20.0)
    with pytest.raises(InputError, match="Widen the band"):
        frequency_least_squares(X[:1], X[:1, 0], ["a", "b"], F[:1], 20.0)
    with pytest.raises(InputError, match="not finite"):
        frequency_least_squares(X, np.full(30, np.nan), ["a", "b"], F, 20.0)
    with pytest.raises(InputError, match="a start that flies"):
        band = harmonics(199 * 0.05, 0.1, 3.0)
        frequency_output_error(lambda p: decay(p) * np.nan, np.ones(3), decay(np.ones(3)), 0.05, band, ["a", "b", "w"])
