"""Runge-Kutta methods: conditions of order, stability, and the plan of their stages gone through by hand."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler.runge_kutta import CLASSICAL, EXTENDED, Stepping, advanced
from bayeschute.core import numerics as numerics  # 64 bits

METHODS = pytest.mark.parametrize("method", [CLASSICAL, EXTENDED], ids=["classical", "extended"])
SUBSTEPS = pytest.mark.parametrize("substeps", [1, 3])


def tableau(method):
    """Butcher's matrix: every stage needs the one before."""
    return np.diag(method.ways, -1), np.array(method.weights), np.array([0.0, *method.ways])


def gone(method, rate, x, dt, substeps):
    """Through a sample as the machine code goes: begin, stage and sum; `rate` of state and share of the sample."""
    way, weight, place = Stepping(substeps, method).plan(dt)
    for step in range(substeps):
        begin, stage, total = x, x, x
        for k in range(len(weight)):
            slope = rate(stage, step / substeps + place[k])
            stage, total = begin + way[k] * slope, total + weight[k] * slope
        x = total
    return x


@METHODS
def test_the_eight_conditions_of_fourth_order(method):
    """Hairer, Norsett and Wanner 1993, table II.2.1."""
    a, b, c = tableau(method)
    np.testing.assert_allclose(a.sum(axis=1), c)
    made = [b.sum(), b @ c, b @ c**2, b @ a @ c, b @ c**3, b @ (c * (a @ c)), b @ a @ c**2, b @ a @ a @ c]
    np.testing.assert_allclose(made, [1, 1 / 2, 1 / 3, 1 / 6, 1 / 4, 1 / 8, 1 / 12, 1 / 24], atol=1e-15)


@METHODS
def test_growth_is_what_a_step_does_to_a_linear_flight(method):
    """R(z) = 1 + z b (I - z A)^-1 1 (Hairer and Wanner 1996, IV.3.2)."""
    a, b, _ = tableau(method)
    for z in (-7.0, -0.3, 0.4 + 2.0j):
        grown = 1.0 + z * b @ np.linalg.solve(np.eye(len(b)) - z * a, np.ones(len(b)))
        assert np.polyval(method.growth[::-1], z) == pytest.approx(grown, rel=1e-12)
        assert gone(method, lambda x, s, z=z: z * x, 1.0, 1.0, 1) == pytest.approx(grown, rel=1e-12)


def test_a_stepping_is_made_finer_and_classical():
    long = Stepping(2, EXTENDED, classical=5)
    assert (long.stages, Stepping(5).stages) == (12, 20)
    assert long.finer() == Stepping(4, EXTENDED, 5) and long.finer(10).substeps == 20
    assert long.in_classical_steps() == Stepping(5, CLASSICAL, 5)
    assert Stepping(3).in_classical_steps() == Stepping(3)  # nobody has asked how many are stable


@pytest.mark.parametrize(("method", "real", "imaginary"), [(CLASSICAL, 2.785, 2.828), (EXTENDED, 8.70, 3.55)])
def test_stability_ends_where_it_is_said_to(method, real, imaginary):
    def size(z):
        return np.abs(np.polyval(method.growth[::-1], z))

    for way, limit in ((-1.0, real), (1.0j, imaginary)):
        assert (size(way * np.linspace(0.0, limit, 4001)) <= 1.0 + 1e-12).all()
        assert size(way * 1.01 * limit) > 1.0


def test_extended_steps_damp_what_is_over():
    """Farther on the real axis than the classical ones are stable at all, half of a mode is left at most."""
    z = -np.linspace(2.5, 8.4, 2001)
    assert np.abs(np.polyval(EXTENDED.growth[::-1], z)).max() == pytest.approx(0.508, abs=1e-3)
    assert min(EXTENDED.weights) > 0.0 and 0.0 < min(EXTENDED.ways) < max(EXTENDED.ways) <= 1.0


@METHODS
@SUBSTEPS
def test_a_linear_flight_grows_step_by_step(method, substeps):
    z = -0.7 * 0.5 / substeps
    grown = np.polyval(method.growth[::-1], z) ** substeps
    assert gone(method, lambda x, s: -0.7 * x, 2.0, 0.5, substeps) == pytest.approx(2.0 * grown, rel=1e-14)


@METHODS
@SUBSTEPS
def test_what_depends_on_time_alone_is_integrated_as_by_simpson(method, substeps):
    """Cubics exactly: every stage is at its own share of the sample."""
    made = gone(method, lambda x, s: 4.0 * s**3 - 6.0 * s**2 + 2.0 * s + 1.0, 0.0, 1.5, substeps)
    assert made == pytest.approx(1.5 * (1.0 - 2.0 + 1.0 + 1.0), rel=1e-14)


@METHODS
def test_jax_goes_the_same_way(method):
    def rate(x, s):
        return jnp.stack([x[1] * s, jnp.sin(x[0]) - 0.3 * x[1]])

    made = advanced(Stepping(3, method), rate, jnp.array([0.4, -1.0]), 0.8)
    np.testing.assert_allclose(made, gone(method, rate, jnp.array([0.4, -1.0]), 0.8, 3), rtol=1e-14)


@METHODS
def test_errors_of_a_flight_that_is_not_linear_fall_with_the_fourth_power(method):
    """x' = x^2 + t from 0.5, against many steps; a method of third order for such a rate would show it."""

    def rate(x, s):
        return x**2 + s

    right = float(advanced(Stepping(4000), rate, jnp.array(0.5), 1.0))
    error = [abs(float(advanced(Stepping(k, method), rate, jnp.array(0.5), 1.0)) - right) for k in (16, 32, 64)]
    assert (np.log2(np.array(error[:-1]) / error[1:]) > 3.8).all()
