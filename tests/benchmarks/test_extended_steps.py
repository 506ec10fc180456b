"""The search behind the extended Runge-Kutta method, and that the method in use is one that it finds."""

from __future__ import annotations

import extended_steps
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler.runge_kutta import CLASSICAL, EXTENDED


def split(method):
    return jnp.array([0.0, *method.ways]), jnp.array(method.weights)


def distance(method, reach):
    z = -np.linspace(0.0, reach, 20001)
    return float(np.abs(np.polyval(method.growth[::-1], z) - np.exp(z)).max())


@pytest.mark.parametrize("method", [CLASSICAL, EXTENDED], ids=["classical", "extended"])
def test_conditions_and_factor_are_those_of_the_methods_in_use(method):
    c, b = split(method)
    np.testing.assert_allclose(extended_steps.order_conditions(c, b), 0.0, atol=1e-15)
    z = np.array([-3.0, -1.0 + 2.0j])
    np.testing.assert_allclose(extended_steps.factor(c, b, z), np.polyval(method.growth[::-1], z), rtol=1e-12)


def test_error_constants_of_the_classical_method():
    """Hairer, Norsett and Wanner 1993, section II.3: of the tree without branches 1/5! of what is missing at z^5."""
    constants = np.asarray(extended_steps.error_constants(*split(CLASSICAL)))
    assert constants[-1] == pytest.approx(-1.0 / 120.0, rel=1e-12)  # no fifth power in four stages
    assert constants[0] == pytest.approx((5.0 / 24.0 - 1.0 / 5.0) / 24.0, rel=1e-12)


def test_a_search_finds_a_stable_method_and_tells_how_far_it_is_from_the_exponential():
    (found, method), *_ = extended_steps.best(5, 5.0, 24, 1)
    assert len(method.weights) == 5 and distance(method, 5.0) == pytest.approx(found, rel=0.02)
    np.testing.assert_allclose(extended_steps.order_conditions(*split(method)), 0.0, atol=1e-8)
    disc = 1.5 * np.exp(1j * np.linspace(np.pi / 2.0, np.pi, 301))
    assert (np.abs(np.polyval(method.growth[::-1], disc)) <= 1.0 + 1e-4).all()
    assert "stable to -" in extended_steps.told("five", method)


def test_the_method_in_use_is_as_near_as_a_search_gets():
    """Its first ways were rounded: the search comes to 0.40, what is in use to 0.51, classical steps nowhere."""
    assert distance(EXTENDED, 8.4) == pytest.approx(0.509, abs=1e-3) and distance(CLASSICAL, 8.4) > 100.0
