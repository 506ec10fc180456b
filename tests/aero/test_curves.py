"""Curves of the force coefficients: closed forms of every term that has a part in one, and none of the others."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.aero.curve_names import CURVES
from bayeschute.aero.curves import Setting, regressors

ALPHA = np.array([0.0, 0.1, 0.3, 0.7])
DISTANCE = np.array([0.3, 0.6, 0.8, 1.2])


@pytest.mark.parametrize(
    ("term", "want"),
    [
        ("1", np.ones(4)),
        ("alpha", ALPHA),
        ("alpha^2", ALPHA**2),
        ("alpha^4", ALPHA**4),
        ("q", np.full(4, 1.21)),
        ("speed", np.full(4, 0.1)),
        ("speed*alpha^2", 0.1 * ALPHA**2),
        ("proximity(0.8)", np.full(4, 0.2)),
        ("closing", np.zeros(4)),
        ("restoring(20)", np.maximum(ALPHA - np.deg2rad(20.0), 0.0) ** 2),
        ("(e.rate)", np.zeros(4)),
        ("(e.c)", np.zeros(4)),
    ],
)
def test_axial_terms(term, want):
    made = regressors("C_A", [term], ["e"], ALPHA, Setting(distance=0.6, speed=1.1))
    np.testing.assert_allclose(made, np.stack([want, np.zeros(4)], axis=1), atol=1e-11)


@pytest.mark.parametrize(
    ("term", "static", "damping"),
    [
        ("e", np.sin(ALPHA), np.zeros(4)),
        ("angle", ALPHA, np.zeros(4)),
        ("e*alpha^2", np.sin(ALPHA) * ALPHA**2, np.zeros(4)),
        ("rate", np.zeros(4), np.ones(4)),
        ("rate*alpha^2", np.zeros(4), ALPHA**2),
        ("e*(e.rate)", np.zeros(4), np.sin(ALPHA) ** 2),
        ("side*e", np.zeros(4), np.zeros(4)),
        ("side*rate", np.zeros(4), np.zeros(4)),
        ("c", np.zeros(4), np.zeros(4)),
        ("repulsion(0.8)", np.zeros(4), np.zeros(4)),
        ("e*proximity(0.8)", 0.2 * np.sin(ALPHA), np.zeros(4)),
    ],
)
def test_transverse_terms(term, static, damping):
    for name, want in (("C_N", static), ("C_N_rate", np.cos(ALPHA) * damping)):  # by alpha_dot, not by r
        made = regressors(name, ["1"], [term], ALPHA, Setting(distance=0.6))
        np.testing.assert_allclose(made, np.stack([np.zeros(4), want], axis=1), atol=1e-12)


@pytest.mark.parametrize(
    ("term", "want"),
    [
        ("c", np.ones(4)),
        ("repulsion(0.8)", np.maximum(0.8 - DISTANCE, 0.0)),
        ("c*proximity(1.0)", np.maximum(1.0 - DISTANCE, 0.0)),
        ("e", np.zeros(4)),
        ("rate", np.zeros(4)),
        ("c*closing", np.zeros(4)),
    ],
)
def test_proximity(term, want):
    np.testing.assert_allclose(regressors("proximity", [], [term], DISTANCE)[:, 0], want, atol=1e-12)


def test_a_canopy_alone_has_no_neighbour_within_reach():
    made = regressors("C_A", ["1", "proximity(0.8)", "q"], ["repulsion(0.8)"], ALPHA)
    np.testing.assert_array_equal(made[:, :3], np.stack([np.ones(4), np.zeros(4), np.ones(4)], axis=1))
    assert np.isfinite(made).all()


def test_the_planar_model_of_the_report_is_a_curve():
    """C_N = C_Nalpha/(2 alpha_0^2) (alpha^3 - alpha_0^2 alpha), 6.3.1-11, in terms that are linear in coefficients."""
    slope, trim = 0.1901, 0.189
    made = regressors("C_N", [], ["angle", "angle*alpha^2"], ALPHA) @ [-0.5 * slope, 0.5 * slope / trim**2]
    np.testing.assert_allclose(made, slope / (2.0 * trim**2) * (ALPHA**3 - trim**2 * ALPHA), atol=1e-12)


def test_a_curve_of_no_terms_has_no_columns():
    assert all(regressors(name, [], [], ALPHA).shape == (4, 0) for name in CURVES)
    with pytest.raises(KeyError):
        regressors("C_m", [], [], ALPHA)


def test_curves_beyond_the_held_angle_go_on_without_its_powers():
    """C_A levels off there, C_N goes on in proportion to the sine, and well below nothing differs."""
    saturation = Setting(saturation=0.3)
    grid = np.array([0.0, 0.1, 0.9, 1.2])
    for name in ("C_A", "C_N"):
        made = regressors(name, ["alpha^2"], ["e*alpha^4"], grid, saturation)
        np.testing.assert_allclose(made[:2], regressors(name, ["alpha^2"], ["e*alpha^4"], grid[:2]), rtol=1e-3)
    np.testing.assert_allclose(regressors("C_A", ["alpha^2"], [], grid, saturation)[2:, 0], 0.09, rtol=1e-3)
    made = regressors("C_N", [], ["e*alpha^4"], grid, saturation)[2:, 0]
    np.testing.assert_allclose(made, np.sin(grid[2:]) * 0.3**4, rtol=1e-3)
