"""What flights taught, where the Gaussian answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.likelihood.priors import Prior
from bayeschute.study.assembly.lessons import lessons, working_draws

PRIORS = [Prior("drag", np.log(0.2), 0.5, True, "m^2/kg", ""), Prior("axial[1]", 0.8, 0.1, False, "1", "")]


def exact(count=200):
    """Draws (chain, draw, P) whose mean and covariance are exact: shifted by one prior sd, half and a quarter as wide."""
    x = np.random.default_rng(0).standard_normal((count, 2))
    x = (x - x.mean(axis=0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(x, rowvar=False))).T
    return (np.array([np.log(0.2) + 0.5, 0.8]) + x * [0.25, 0.025]).reshape(2, -1, 2)


def draws(theta):
    return {"axial[1]": theta[..., 1], "drag": np.exp(theta[..., 0])}  # by name, whatever their order


def test_draws_come_back_in_working_coordinates_in_the_order_of_the_priors():
    np.testing.assert_allclose(working_draws(PRIORS, draws(exact())), exact(), rtol=1e-12)
    assert working_draws(PRIORS, draws(exact()) | {"sd(drag)": np.ones((2, 100))}) is None
    assert working_draws(PRIORS[:1], draws(exact())) is None


def test_the_gain_is_that_of_a_gaussian_from_a_gaussian():
    """log(prior sd / sd) + (sd^2 + shift^2) / (2 prior sd^2) - 1/2."""
    told = lessons(PRIORS, draws(exact()), ("a", "b"))
    drag, axial = told["parameters"]
    gains = [np.log(2.0) + 0.5 * (0.25 + 1.0) - 0.5, np.log(4.0) + 0.5 / 16.0 - 0.5]
    assert [drag["gain"], axial["gain"]] == pytest.approx(gains) and told["joint"] == pytest.approx(sum(gains))
    assert (drag["shift"], axial["shift"]) == pytest.approx((1.0, 0.0), abs=1e-9)
    assert (drag["unit"], drag["logarithmic"], axial["logarithmic"]) == ("m^2/kg", True, False)
    assert told["flights"] == ["a", "b"] and lessons(PRIORS[:1], draws(exact()), ["a"]) == {}


def test_what_two_parameters_hang_together_by_counts_in_the_joint_gain_alone():
    theta = exact()
    theta[..., 1] += 0.2 * (theta[..., 0] - theta[..., 0].mean())
    told = lessons(PRIORS, draws(theta), ["a"])
    rho = np.corrcoef(theta.reshape(-1, 2), rowvar=False)[0, 1]
    alone = sum(one["gain"] for one in told["parameters"])
    assert told["joint"] - alone == pytest.approx(-0.5 * np.log1p(-(rho**2)))
