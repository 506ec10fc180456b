"""Planar coefficients: the printed curves, and the stable design."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from bayeschute.reduced.planar import PlanarAero

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
