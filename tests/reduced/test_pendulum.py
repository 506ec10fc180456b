"""The linear pendulum: published numbers, inverse formulas, and the dumbbell's poles."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from bayeschute.core.units import to_si
from bayeschute.dynamics.parameters import Canopies
from bayeschute.reduced import pendulum as law
from bayeschute.reduced.dumbbell import Dumbbell, state_rate, steady_descent, steady_speed
from bayeschute.reduced.planar import PlanarAero

FT, SLUG = to_si("1 ft", "m"), to_si("1 slug", "kg")
G = 32.174 * FT
DRY, VOLUME = 328.0 / 32.174 * SLUG, 140164.0 * FT**3
RHO = (307.0 * SLUG - DRY) / VOLUME
MODEL = Dumbbell(21906.0 / 32.174 * SLUG, 235.0 * FT, Canopies(10563.0 * FT**2, 116.0 * FT, 32.0 * FT, DRY, VOLUME), G)
P = law.pendulum(MODEL, RHO, 0.927)
SLOPE = 0.1901


def test_numbers_of_the_check_cases():
    omega = law.natural_frequency(P, SLOPE)
    assert omega == pytest.approx(0.405500, abs=1e-6)
    assert law.natural_frequency(P, 0.0) == pytest.approx(0.363819, abs=1e-6)
    assert law.pivot_distance(P, SLOPE) / FT == pytest.approx(195.670, abs=1e-3)
    assert law.pivot_distance(P, SLOPE) == pytest.approx(G / omega**2)
    b = law.decay_rate(P, 0.5)
    assert b == pytest.approx(0.0421698, abs=1e-7)
    assert law.decay_rate(P, -0.3) == pytest.approx(-0.0253019, abs=1e-7)
    speed = steady_speed(MODEL, PlanarAero(0.927, -0.329, 0.189, SLOPE, 0.0), RHO)
    assert law.induced_damping(P, SLOPE, speed) == pytest.approx(0.227, abs=5e-4)


def test_pivot_point_of_special_slopes():
    """L_L = R_L where C_A = C_Nalpha; a little more than L where C_Nalpha = 0."""
    m_C = MODEL.canopy_mass(RHO)
    assert law.pivot_distance(P, 0.927) == pytest.approx(MODEL.length * m_C / (m_C + MODEL.capsule_mass))
    assert 1.0 < law.pivot_distance(P, 0.0) / MODEL.length < 1.05


@pytest.mark.parametrize("value", [-0.05, 0.01, 0.19, 1.3])
def test_inverse_formulas(value):
    assert law.normal_slope(P, law.natural_frequency(P, value)) == pytest.approx(value)
    b = law.decay_rate(P, value)
    assert law.total_damping(P, b) == pytest.approx(value)


@pytest.mark.parametrize("damping", [-0.988, -0.3, 0.0, 0.5])
def test_poles_of_the_dumbbell_about_its_glide(damping):
    """The linear pendulum holds its pivot point still, so it is near the truth, not equal to it."""
    aero = PlanarAero(0.927, -0.329, 0.189, SLOPE, damping)
    x = steady_descent(MODEL, aero, RHO)
    poles = np.linalg.eigvals(jax.jacfwd(lambda s: state_rate(s, MODEL, aero, np.zeros(2), RHO))(x)[2:, 2:])
    (pole,) = poles[poles.imag > 0.0]
    total = damping + law.induced_damping(P, SLOPE, steady_speed(MODEL, aero, RHO))
    b, omega = law.decay_rate(P, total), law.natural_frequency(P, SLOPE)
    assert pole.imag == pytest.approx(np.sqrt(omega**2 - b**2), rel=0.07)
    assert pole.real == pytest.approx(-b, abs=0.015)
    assert np.sign(pole.real) == np.sign(-b)


@pytest.mark.parametrize("slope, damping, hertz, grows", [(0.0964, -0.64, 0.062, True), (-0.0964, 0.64, 0.0535, False)])
def test_signs_of_the_equation_error_set_decide_between_growth_and_decay(slope, damping, hertz, grows):
    """PHYSICS 4: conventional signs grow at 0.061-0.063 Hz, those as printed decay at 0.053 Hz."""
    p = law.pendulum(MODEL, RHO, 0.84)
    total = damping + law.induced_damping(p, slope, 10.0)
    omega, b = law.natural_frequency(p, slope), law.decay_rate(p, total)
    assert np.sqrt(omega**2 - b**2) / (2 * np.pi) == pytest.approx(hertz, abs=1.2e-3)
    assert (b < 0.0) == grows
