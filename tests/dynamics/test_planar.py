"""Planar coefficients: the printed curves, the stable design, and the same written as terms of the cluster."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.aero.terms import axial_coefficient, transverse_coefficient
from bayeschute.air.airflow import CanopyFlow
from bayeschute.air.vector import Vec3
from bayeschute.dynamics.planar import PlanarAero, cluster_terms

AERO = PlanarAero(0.927, -0.329, 0.189, 0.1901, -0.988)
STABLE = replace(AERO, statically_stable=True)


def test_printed_curves():
    slope = jax.grad(AERO.normal)
    assert float(AERO.axial(0.189)) == pytest.approx(0.927)
    assert float(jax.grad(AERO.axial)(0.189)) == pytest.approx(-0.329)
    for trim in (0.189, -0.189):
        assert float(AERO.normal(trim)) == pytest.approx(0.0, abs=1e-15)
        assert float(slope(trim)) == pytest.approx(0.1901)
    assert float(slope(0.0)) == pytest.approx(-0.1901 / 2)


def test_stable_design_starts_at_the_trim_angle():
    alpha = np.linspace(1e-9, 0.5, 50)
    np.testing.assert_allclose(STABLE.normal(alpha), AERO.normal(alpha + 0.189), rtol=1e-6)
    np.testing.assert_allclose(STABLE.normal(-alpha), -np.asarray(STABLE.normal(alpha)))
    assert float(jax.grad(STABLE.normal)(0.0)) == pytest.approx(0.1901)
    assert float(STABLE.axial(0.0)) == 0.927
    np.testing.assert_allclose(AERO.axial(alpha) - STABLE.axial(alpha), 0.329 * 0.189 / 2)
    assert float(STABLE.trim()) == 0.0


@pytest.mark.parametrize("aero", [AERO, STABLE])
@pytest.mark.parametrize("rate, speed", [("pivot", 10.0), ("riser", 7.0)])
def test_terms_of_the_cluster_are_the_same_coefficients(aero, rate, speed):
    """A canopy whose axis points down, air from below at alpha ahead; the riser turns."""
    aero, length, turning = replace(aero, rate=rate), 35.0, 0.3
    alpha = np.linspace(-0.6, 0.6, 41)
    zero = jnp.zeros_like(alpha)
    axis, e = Vec3(zero, zero, zero + 1.0), Vec3(jnp.sin(alpha), zero, zero)
    r = Vec3(turning * jnp.cos(alpha) * length / (2 * speed), zero, zero)
    flow = CanopyFlow(axis, e, r, jnp.asarray(alpha**2), jnp.cos(alpha), zero + 1.0, zero + 1.0, zero, ())
    axial, transverse = cluster_terms(aero, length, speed)
    force = transverse_coefficient(tuple(transverse), tuple(transverse.values()), flow)
    np.testing.assert_allclose(axial_coefficient(tuple(axial), tuple(axial.values()), flow), aero.axial(alpha))
    rate_term = aero.C_Nalphadot * (turning if rate == "pivot" else turning * length / (2 * speed)) * np.cos(alpha)
    np.testing.assert_allclose(-force.x, aero.normal(alpha) + rate_term, atol=1e-12)
    np.testing.assert_allclose(force.y, 0.0)
