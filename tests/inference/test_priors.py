"""Priors in working coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.inference.priors import Prior, from_equation_error, values, working

LOG = Prior("a", np.log(2.0), 0.4, True, "kg", "")
PLAIN = Prior("b", -1.0, 0.5, False, "1", "")


def test_values_and_moments():
    theta = np.random.default_rng(0).standard_normal((200_000, 2)) * [0.4, 0.5] + [np.log(2.0), -1.0]
    made = values([LOG, PLAIN], theta)
    for p, column in zip((LOG, PLAIN), made.T, strict=True):
        assert p.moments() == pytest.approx((column.mean(), column.std()), rel=0.02)


def test_working_coordinates():
    centre, scale = working([LOG, PLAIN])
    np.testing.assert_allclose(centre, [np.log(2.0), -1.0])
    np.testing.assert_allclose(scale, [0.4, 0.5])


@pytest.mark.parametrize(("se", "wanted"), [(0.1, 0.3), (0.01, 0.05)])
def test_equation_error_prior_has_a_floor(se, wanted):
    made = from_equation_error("a", 0.7, se, inflation=3.0, floor=0.05, flight="F1")
    assert (made.centre, made.scale, made.logarithmic) == (0.7, pytest.approx(wanted), False)
    assert "F1" in made.source
