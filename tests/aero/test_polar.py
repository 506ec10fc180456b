"""The polar form: axes, rates and the sign of every coefficient, against plain NumPy and the equivariant terms."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.aero.airflow import CanopyFlow, squared_angle
from bayeschute.aero.polar import PitchPlane, angle_rates, drag_coefficient, polar_coefficient, wind_axes
from bayeschute.aero.terms import axial_coefficient, transverse_coefficient
from bayeschute.core.vectors import dot, vec3

LENGTH, SPEED = 35.0, 9.75


def flow_of(axis, w, rate):
    """Airflow from unit vectors (3, canopy) and a rate across the axis."""
    axis, w = vec3(jnp.asarray(axis)), vec3(jnp.asarray(w))
    cosine = dot(w, axis)
    e = w - axis * cosine
    one = jnp.ones_like(cosine)
    return CanopyFlow(
        axis, e, vec3(jnp.asarray(rate)), squared_angle(dot(e, e), cosine), cosine, 60.0 * one, one, 0.1 * one, ()
    )


@pytest.fixture(scope="module")
def flows():
    rng = np.random.default_rng(3)
    axis = rng.normal(size=(3, 20))
    axis /= np.linalg.norm(axis, axis=0)
    w = axis + 0.4 * rng.normal(size=(3, 20))
    w /= np.linalg.norm(w, axis=0)
    rate = rng.normal(size=(3, 20))
    rate -= axis * (rate * axis).sum(axis=0)
    return axis, w, rate, flow_of(axis, w, rate)


def test_wind_axes_are_those_of_the_report(flows):
    """y along -(x cross V), z = x cross y (6.3.3-8)."""
    axis, w, _, flow = flows
    y = -np.cross(axis.T, w.T)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    axes = wind_axes(flow)
    np.testing.assert_allclose(axes.side.stack(), y.T, atol=1e-12)
    np.testing.assert_allclose(axes.normal.stack(), np.cross(axis.T, y).T, atol=1e-12)


def test_force_is_minus_axial_plus_side_minus_normal(flows):
    _, _, _, flow = flows
    axes = wind_axes(flow)
    force = polar_coefficient(flow, 0.9, 0.2, 0.3)
    np.testing.assert_allclose(dot(force, flow.axis), -0.9, atol=1e-12)
    np.testing.assert_allclose(dot(force, axes.side), 0.2, atol=1e-12)
    np.testing.assert_allclose(dot(force, axes.normal), -0.3, atol=1e-12)


def test_drag_is_against_the_airflow(flows):
    _, w, _, flow = flows
    np.testing.assert_allclose(drag_coefficient(flow, 0.8).stack(), -0.8 * w, atol=1e-12)
    alpha = jnp.sqrt(flow.alpha_squared)
    polar = polar_coefficient(flow, 0.8 * jnp.cos(alpha), 0.0, 0.8 * jnp.sin(alpha))
    np.testing.assert_allclose(polar.stack(), -0.8 * w, atol=1e-12)


def test_rates_are_those_of_angle_and_azimuth(flows):
    """Turn the wind for a moment while the axis rests: the rate is P w_dot, without the axis' part."""
    axis, w, _, _ = flows
    omega = np.random.default_rng(4).normal(size=(3, 20))
    w_dot = np.cross(omega.T, w.T).T
    flow = flow_of(axis, w, w_dot - axis * (axis * w_dot).sum(axis=0))
    h = 1e-6
    turned = [flow_of(axis, v / np.linalg.norm(v, axis=0), 0.0 * w) for v in (w + h * w_dot, w - h * w_dot)]
    alpha = [np.sqrt(np.asarray(f.alpha_squared)) for f in turned]
    angle, azimuth = angle_rates(flow)
    np.testing.assert_allclose(angle, (alpha[0] - alpha[1]) / (2.0 * h), atol=1e-8)
    axes = [wind_axes(f) for f in turned]
    change = (axes[0].normal - axes[1].normal) / (2.0 * h)
    sine = np.sin(np.sqrt(np.asarray(flow.alpha_squared)))
    np.testing.assert_allclose(azimuth, dot(change, wind_axes(flow).side) * sine, atol=1e-6)


def test_pitch_plane_equals_equivariant_terms_where_the_rate_is_in_the_plane(flows):
    axis, w, _, plain = flows
    normal = np.asarray(wind_axes(plain).normal.stack())
    flow = flow_of(axis, w, 0.05 * normal)
    c = PitchPlane(0.927, -0.329, 0.189, 0.1901, -0.988)
    got = polar_coefficient(flow, c.axial(flow), 0.0, c.normal(flow, LENGTH, SPEED))
    a, k = c.alpha_0, c.C_Nalpha
    axial = axial_coefficient(("1", "alpha^2"), (c.C_A0 - 0.5 * c.C_Aalpha * a, 0.5 * c.C_Aalpha / a), flow)
    terms = ("angle", "angle*alpha^2", "rate")
    per_second = 2.0 * SPEED * 1.1 / LENGTH / flow.cos_alpha
    want = transverse_coefficient(terms, (-0.5 * k, 0.5 * k / a**2, c.C_Nalphadot * per_second), flow)
    np.testing.assert_allclose(got.stack(), (want - flow.axis * axial).stack(), atol=1e-12)
    assert float(PitchPlane(0.9, -0.3, 0.2, 0.2, 0.0).normal(flow_at(0.2), LENGTH, SPEED)[0]) == pytest.approx(0.0)
    slope = jax.grad(lambda t: PitchPlane(0.9, -0.3, 0.2, 0.2, 0.0).normal(flow_at(t), LENGTH, SPEED)[0])(0.2)
    assert float(slope) == pytest.approx(0.2, rel=1e-9)


def flow_at(angle):
    """One canopy, axis down, wind turned by an angle towards north, no rate."""
    w = jnp.stack([jnp.sin(angle), 0.0 * angle, jnp.cos(angle)])[:, None]
    return flow_of(np.array([[0.0], [0.0], [1.0]]), w, np.zeros((3, 1)))


def test_along_the_axis_nothing_is_infinite():
    def force(t):
        flow = flow_at(t)
        c = PitchPlane(0.927, -0.329, 0.189, 0.1901, -0.988)
        return polar_coefficient(flow, c.axial(flow), 0.1, c.normal(flow, LENGTH, SPEED)).stack()[:, 0]

    value, slope = force(0.0), jax.jacfwd(force)(0.0)
    np.testing.assert_allclose(value, [0.0, 0.0, -(0.927 + 0.5 * 0.329 * 0.189)], atol=1e-8)
    assert np.isfinite(np.asarray(slope)).all()
