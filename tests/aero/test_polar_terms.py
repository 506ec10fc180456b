"""Terms of the polar form against the report's own formulas in components (6.1-1..13)."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.aero.polar_terms import constant_force_axial, polar_sum, polar_term
from bayeschute.air.airflow import CanopyFlow, Neighbour
from bayeschute.air.vector import Vec3

LENGTH, SPEED_0 = 35.36, 9.75


def flow_of(rng, n=5):
    """Airflows in body axes of section 6.1 (x away from the payload) and the report's quantities for them."""
    u, v, w = -rng.uniform(8, 12, n), rng.normal(0, 2, n), rng.normal(0, 2, n)
    acceleration = rng.normal(0, 1, (3, n))
    D = rng.normal(0, 20, (3, n))
    V, V_dot = np.array([u, v, w]), acceleration
    speed = np.linalg.norm(V, axis=0)
    u_, v_, w_ = V_dot
    growth = (u * u_ + v * v_ + w * w_) / speed**2
    # 6.1-8 has the rate of acos(-u/V); 6.1-9 that of atan(v/-w).
    report = {
        "alpha": np.arccos(-u / speed),
        "alpha_rate": (u_ - u * growth) / np.sqrt(speed**2 - u**2) * LENGTH / (2 * speed),
        "azimuth_rate": (v * w_ - w * v_) / (v**2 + w**2) * np.sqrt(v**2 + w**2) / speed * LENGTH / (2 * speed),
        "q": 0.5 * 1.1 * speed**2,
        "speed": speed / SPEED_0 - 1.0,
        "distance": np.linalg.norm(D, axis=0) / LENGTH,
    }
    # Wind axes: turned about x so that the airflow points along -z.
    across = np.hypot(v, w)
    z_w = np.array([np.zeros(n), -v / across, -w / across])
    y_w = np.cross(z_w.T, np.array([1.0, 0.0, 0.0])).T
    phi = np.arctan2((D * y_w).sum(0), -(D * z_w).sum(0))
    report |= {"sin_proximity": np.sin(phi), "cos_proximity": np.cos(phi)}
    axis = np.array([-np.ones(n), np.zeros(n), np.zeros(n)])  # towards the payload
    wind = V / speed
    turn = (V_dot - V * growth) / speed
    cosine = (wind * axis).sum(0)
    vec = lambda a: Vec3(*a)  # noqa: E731
    away = D / np.linalg.norm(D, axis=0)
    away = away - axis * (away * axis).sum(0)
    flow = CanopyFlow(
        vec(axis), vec(wind - axis * cosine), vec((turn - axis * (turn * axis).sum(0)) * LENGTH / (2 * speed)),
        report["alpha"] ** 2, cosine, report["q"], report["q"], report["speed"],
        (Neighbour(vec(away), report["distance"], np.zeros(n)),),
    )  # fmt: skip
    return flow, report


@pytest.mark.parametrize("seed", range(3))
def test_factors_are_those_of_the_report(seed):
    flow, report = flow_of(np.random.default_rng(seed))
    for factor, want in report.items():
        np.testing.assert_allclose(polar_term(factor, flow), want, rtol=1e-8, atol=1e-10, err_msg=factor)
    overlap = np.maximum(0.8 - report["distance"], 0.0)
    assert (overlap > 0.0).any()
    np.testing.assert_allclose(polar_term("overlap*cos_proximity", flow), overlap * report["cos_proximity"], atol=1e-10)
    np.testing.assert_allclose(polar_term("speed^2", flow), report["speed"] ** 2, atol=1e-12)
    product = report["azimuth_rate"] * report["distance"]
    np.testing.assert_allclose(
        polar_sum(("1", "azimuth_rate*distance"), (2.0, 3.0), flow), 2.0 + 3.0 * product, rtol=1e-8
    )


def test_unknown_term_is_refused():
    flow, _ = flow_of(np.random.default_rng(0))
    with pytest.raises(ValueError, match="'beta'"):
        polar_term("beta", flow)


def test_constant_force_carries_the_weight():
    q = np.array([40.0, 57.0])
    np.testing.assert_allclose(2 * 982.0 * q * constant_force_axial(1e5, 2, 982.0, q), 1e5)
