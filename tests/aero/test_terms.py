"""Aerodynamic terms: what each means, its sign, and its smoothness through zero angle."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.aero.airflow import CanopyFlow, Neighbour, squared_angle
from bayeschute.aero.terms import axial_coefficient, axial_term, transverse_coefficient, transverse_term
from bayeschute.core.vectors import vec3

AWAY = np.array([[0.9], [0.1], [0.0]])
RATE = np.array([[0.2], [-0.3], [0.0]])


def flow(u, v=0.0, distance=0.6):
    """One canopy, axis down, wind direction turned by (u, v) rad towards x and y."""
    w = jnp.array([[u], [v], [0.0]])
    angle = jnp.sqrt(u * u + v * v + 1e-300)
    e = w * jnp.sinc(angle / jnp.pi)
    cosine = jnp.cos(angle)[None]
    return CanopyFlow(
        axis=vec3(np.array([[0.0], [0.0], [1.0]])),
        e=vec3(e),
        rate=vec3(RATE),
        alpha_squared=squared_angle(jnp.sum(e**2, axis=0), cosine),
        cos_alpha=cosine,
        q=jnp.array([60.0]),
        q_ratio=jnp.array([1.03]),
        speed_ratio=jnp.array([0.05]),
        neighbours=(Neighbour(vec3(AWAY), jnp.array([distance]), jnp.array([0.02])),),
    )


def vector(name, *args, **kwargs):
    return np.asarray(transverse_term(name, flow(*args, **kwargs)).stack())[:, 0]


@pytest.mark.parametrize(
    "name, want",
    [
        ("1", 1.0),
        ("alpha", 0.3),
        ("alpha^2", 0.09),
        ("alpha^3", 0.027),
        ("q", 1.03),
        ("speed", 0.05),
        ("proximity(0.8)", 0.2),
        ("proximity(0.5)", 0.0),
        ("closing", 0.02),
        ("restoring(10)", (0.3 - np.pi / 18) ** 2),
        ("restoring(35)", 0.0),
        ("(e.rate)", 0.2 * np.sin(0.3)),
        ("(e.c)", 0.9 * np.sin(0.3)),
        ("(c.rate)", 0.15),
        ("speed*alpha^2", 0.05 * 0.09),
    ],
)
def test_scalars(name, want):
    assert float(axial_term(name, flow(0.3))[0]) == pytest.approx(want, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize(
    "name, want",
    [
        ("e", [-np.sin(0.3), 0, 0]),
        ("angle", [-0.3, 0, 0]),
        ("rate", [-0.2, 0.3, 0]),
        ("c", [0.9, 0.1, 0]),
        ("repulsion(0.8)", [0.18, 0.02, 0]),
        ("e*side", [0, -np.sin(0.3), 0]),
        ("e*alpha^2*speed", [-0.05 * 0.09 * np.sin(0.3), 0, 0]),
        ("c*(c.rate)", [0.135, 0.015, 0]),
    ],
)
def test_vectors(name, want):
    np.testing.assert_allclose(vector(name, 0.3), want, atol=1e-14)


def test_positive_coefficients_restore_damp_and_push_apart():
    f = flow(0.3, 0.2)
    e, r = np.asarray(f.e.stack())[:, 0], RATE[:, 0]
    assert vector("e", 0.3, 0.2) @ e < 0 and vector("angle", 0.3, 0.2) @ e < 0
    assert vector("rate", 0.3, 0.2) @ r < 0
    assert vector("repulsion(0.8)", 0.3) @ AWAY[:, 0] > 0
    np.testing.assert_array_equal(vector("repulsion(0.8)", 0.3, distance=0.9), 0.0)


SMOOTH = ("e", "angle", "e*alpha^2", "angle*alpha^2", "e*(e.rate)", "repulsion(0.8)*(e.c)", "e*side", "e*restoring(35)")


@pytest.mark.parametrize("u", [0.0, 3e-5, 9e-3, 1.1e-2, 0.4, 0.7])
def test_transverse_terms_are_smooth_through_zero(u):
    @jax.jit
    def value(s):
        f = flow(s[0], s[1])
        return jnp.stack([transverse_term(name, f).stack()[:, 0] for name in SMOOTH])

    at, h = jnp.array([u, 0.5 * u]), 1e-5
    slope = np.asarray(jax.jit(jax.jacfwd(value))(at))
    by_difference = np.stack([(value(at + h * d) - value(at - h * d)) / (2 * h) for d in np.eye(2)], axis=-1)
    np.testing.assert_allclose(slope, by_difference, atol=1e-6)


@pytest.mark.parametrize("name", ["1", "alpha", "alpha^2", "alpha^3", "restoring(35)"])
def test_axial_gradients_are_finite_at_zero(name):
    slope = jax.grad(lambda s: axial_term(name, flow(s[0], s[1]))[0])(jnp.zeros(2))
    assert np.isfinite(slope).all()


def test_coefficients_are_weighted_sums():
    f = flow(0.3)
    assert float(axial_coefficient(("1", "alpha^2"), (0.9, -0.7), f)[0]) == pytest.approx(0.9 - 0.063)
    total = np.asarray(transverse_coefficient(("e", "c"), (0.1, 0.2), f).stack())[:, 0]
    np.testing.assert_allclose(total, 0.1 * vector("e", 0.3) + 0.2 * vector("c", 0.3))
    with pytest.raises(ValueError):
        axial_coefficient(("1",), (), f)


SATURATION = 0.25


def levelled(angle):
    """Square of an angle, levelled off at `SATURATION`."""
    return angle**2 / (1.0 + (angle / SATURATION) ** 8) ** 0.25


@pytest.mark.parametrize("name", ["alpha", "alpha^2", "alpha^3", "alpha^4", "speed*alpha^2"])
def test_powers_of_the_angle_level_off_where_they_are_held(name):
    """Below nothing changes, far beyond they have the value of the angle itself."""
    power = int(name[-1]) if "^" in name else 1
    plain = float(axial_term(name, flow(SATURATION))[0])
    for angle, near in ((0.1, None), (SATURATION, None), (0.4, None), (1.2, plain)):
        made = float(axial_term(name, replace(flow(angle), saturation=SATURATION))[0])
        assert made == pytest.approx(plain * (levelled(angle) / SATURATION**2) ** (power / 2.0), rel=1e-9)
        assert near is None or made == pytest.approx(near, rel=1e-4)
    assert float(axial_term(name, replace(flow(0.1), saturation=SATURATION))[0]) == pytest.approx(
        float(axial_term(name, flow(0.1))[0]), rel=1e-3
    )


@pytest.mark.parametrize("name", ["e*alpha^2", "rate*alpha^2", "side*e*alpha^4"])
def test_vectors_go_on_in_proportion_where_powers_are_held(name):
    """Their scalar factor levels off, the vector itself does not."""
    plain, power = name.replace("*alpha^2", "").replace("*alpha^4", ""), 2 if "^4" in name else 1
    made = np.asarray(transverse_term(name, replace(flow(0.9), saturation=SATURATION)).stack())[:, 0]
    np.testing.assert_allclose(made, levelled(0.9) ** power * vector(plain, 0.9), rtol=1e-9)


@pytest.mark.parametrize("angle", [0.1, SATURATION, 0.9])
def test_anisotropic_damping_goes_on_in_proportion_to_rate(angle):
    """e (e.rate) is of second order in e; held, it levels off at e-hat (e-hat.rate) times the square of the angle."""
    made = np.asarray(transverse_term("e*(e.rate)", replace(flow(angle), saturation=SATURATION)).stack())[:, 0]
    np.testing.assert_allclose(made, levelled(angle) / angle**2 * vector("e*(e.rate)", angle), rtol=1e-9)


@pytest.mark.parametrize("name", ["1", "restoring(10)", "(e.c)", "closing", "proximity(0.8)"])
def test_what_is_no_power_of_the_angle_is_not_held(name):
    assert float(axial_term(name, replace(flow(0.4), saturation=SATURATION))[0]) == float(
        axial_term(name, flow(0.4))[0]
    )


@pytest.mark.parametrize("angle", [0.0, SATURATION, 0.9])
def test_held_terms_are_smooth(angle):
    """Gradients are finite, and second derivatives those of differences."""

    def force(u):
        held = replace(flow(u), saturation=SATURATION)
        return axial_term("alpha^4", held)[0] + transverse_term("e*(e.rate)", held).x[0]

    slope = jax.grad(force)
    assert np.isfinite(slope(angle))
    bend = (slope(angle + 1e-4) - slope(angle - 1e-4)) / 2e-4
    assert np.isfinite(bend) and abs(jax.grad(slope)(angle + 1e-3) - bend) < 0.1 * (1.0 + abs(bend))
