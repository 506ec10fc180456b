"""Wind by altitude: linear between nodes, held beyond, with its slope; the same for a batch."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.atmosphere.wind_field import wind_field

H = np.array([100.0, 150.0, 400.0, 1000.0])
W = np.random.default_rng(0).normal(size=(4, 3)) * 5.0
FIELD = wind_field(H, W)


@pytest.mark.parametrize("shape", [(), (5,), (2, 6)])
def test_wind_is_the_interpolation_of_its_nodes(shape):
    h = np.random.default_rng(1).uniform(-200.0, 1500.0, shape)
    wind, _ = FIELD.at(jnp.asarray(h))
    for component, nodes in zip((wind.x, wind.y, wind.z), W.T, strict=True):
        assert component.shape == shape
        np.testing.assert_allclose(component, np.interp(h, H, nodes), atol=1e-12)


def test_slope_is_the_derivative_of_the_wind():
    for h in (20.0, 120.0, 300.0, 999.0, 1200.0):
        slope = FIELD.at(jnp.asarray(h))[1]
        want = jax.jacfwd(lambda x: FIELD.at(x)[0].stack())(h)
        np.testing.assert_allclose(slope.stack(), want, atol=1e-15)
    assert np.abs(FIELD.at(jnp.asarray(20.0))[1].stack()).max() == 0.0
    assert np.abs(FIELD.at(jnp.asarray(5000.0))[1].stack()).max() < 1e-15


def test_nodes_are_met_exactly_enough():
    wind, _ = FIELD.at(jnp.asarray(H))
    np.testing.assert_allclose(wind.stack().T, W, atol=1e-12)
