"""Curves of Table 7.1-2: its numbers where they are printed, and errors as of parameters drawn at random."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.aero.published import load_published
from bayeschute.aero.published_curve import CURVES, planar_curve, usual_angles

LENGTH, SPEED = 116 * 0.3048, 32 * 0.3048


@pytest.fixture(scope="module")
def table():
    return load_published("table-7.1-2")


def test_the_curves_at_the_trim_angle_are_the_printed_numbers(table):
    at = np.array([0.189])
    assert planar_curve(table, "C_A", at, LENGTH, SPEED)[0][0] == pytest.approx(0.927)
    assert planar_curve(table, "C_N", at, LENGTH, SPEED)[0][0] == pytest.approx(0.0, abs=1e-12)
    slope = np.diff(planar_curve(table, "C_N", np.array([0.188, 0.190]), LENGTH, SPEED)[0])[0] / 0.002
    assert slope == pytest.approx(0.1901, rel=1e-3)
    rate = planar_curve(table, "C_N_rate", np.array([0.0]), LENGTH, SPEED)
    assert rate[0][0] == pytest.approx(-0.988 * 2 * 32 / 116) and rate[1][0, 0] ** 0.5 == pytest.approx(
        0.0684 * 2 * 32 / 116 * np.hypot(1.0, 1.0 / 3.0), rel=1e-3
    )


@pytest.mark.parametrize("name", CURVES)
def test_errors_are_those_of_parameters_drawn_at_random(table, name):
    alpha, rng = usual_angles(table), np.random.default_rng(1)
    small = replace(
        table, parameters=tuple(replace(p, standard_error=0.02 * p.standard_error) for p in table.parameters)
    )
    drawn = []
    for _ in range(4000):
        at = tuple(replace(p, estimate=p.estimate + p.standard_error * rng.standard_normal()) for p in small.parameters)
        drawn.append(planar_curve(replace(small, parameters=at), name, alpha, LENGTH, SPEED)[0])
    law = planar_curve(small, name, alpha, LENGTH, SPEED)[1]
    of_parameters = law - np.diag(np.diag(law)) / 10.0  # less the share of a point's own: (1/3)^2 of the rest
    np.testing.assert_allclose(np.cov(np.array(drawn).T), of_parameters, atol=0.08 * np.abs(law).max())
    np.linalg.cholesky(law)
