"""The model of a cluster that lands: its density, and the simulator's own trajectories."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.landing.plans import small_model

from bayeschute.atmosphere.standard import standard_density
from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.dynamics.cluster_flight import ClusterFlight, ClusterInputs
from bayeschute.landing import landing_model as module
from bayeschute.landing.campaign_plan import flight_model
from bayeschute.landing.descend import SAMPLE, SECOND
from bayeschute.landing.landing_model import density_law, flown, rows
from bayeschute.landing.start_plan import SIZE, begin


@jax.tree_util.register_pytree_node_class
class Begun:
    """A flight that begins at a given state."""

    def __init__(self, flight, x):
        self.flight, self.x = flight, x

    def tree_flatten(self):
        return (self.flight, self.x), None

    @classmethod
    def tree_unflatten(cls, _, leaves):
        return cls(*leaves)

    def initial(self, numbers, start):
        return self.x

    def __getattr__(self, name):
        return getattr(self.flight, name)


def test_the_density_is_the_standard_one():
    law, middle, half = density_law(-800.0, 4000.0)
    h = np.linspace(-800.0, 4000.0, 97)
    made = np.exp(np.polynomial.polynomial.polyval((h - middle) / half, law))
    np.testing.assert_allclose(made, standard_density(h), rtol=1e-7)


def test_a_second_of_flight_is_that_of_the_simulator(plan):
    """Same cluster, same wind and density by time in a `ClusterFlight`, whose air is that of the capsule's altitude."""
    model = flight_model(plan, 0)
    theta = plan.models[0].theta[:3].T
    x = begin(plan.start, model, theta, np.random.default_rng(1).standard_normal((SIZE, 3)), np.zeros((3, 3)))
    wind = np.array([3.0, -1.0, 0.5])
    error = np.zeros((SECOND + 1, rows(2), 3))
    error[:, 0:3], error[:, 3:6] = wind[:, None], wind[:, None]
    even = replace(model, density=np.array([np.log(1.1), 0.0, 0.0, 0.0, 0.0, 0.0]))
    made = flown(even, theta, x, error)
    inputs = ClusterInputs(
        np.tile(wind, (SECOND + 1, 1)), np.full(SECOND + 1, 1.1), np.ones((SECOND + 1, 2)), np.zeros((SECOND + 1, 4))
    )
    for b in range(3):
        flight = ClusterFlight(
            plan.models[0].base, None, None, inputs, SAMPLE, model.structure, model.names, (), model.stepping
        )
        want = trajectory_compiled(Begun(flight, x[:, b]), theta[:, b], np.zeros(0), np.zeros((SECOND + 1, 3)))
        np.testing.assert_allclose(made[:, :, b], want, rtol=1e-9, atol=1e-7)


def test_the_density_of_altitudes_close_together_is_of_a_hundred_metres():
    law, middle, half = density_law(300.0, 310.0)
    assert (middle, half) == (305.0, 50.0)
    assert np.exp(np.polynomial.polynomial.polyval(1.0, law)) == pytest.approx(standard_density(355.0), rel=1e-9)


def test_every_body_has_the_air_of_its_own_place(plan):
    """Disturbances row by row, linear between samples; the density is that of the body's own altitude."""
    model = small_model(plan.models[0])
    rng = np.random.default_rng(5)
    now, then, share = rng.standard_normal(13), rng.standard_normal(13), 0.3
    x = rng.standard_normal(25)
    assert rows(2) == now.size and rows(3) == now.size + 3
    x[2], x[17:19] = -400.0, (-430.0, -900.0)
    made = model.air(jnp.asarray(x), now, then, share)
    e, change = 0.7 * now + 0.3 * then, (then - now) / 0.2

    def three(v):
        return [float(v.x), float(v.y), float(v.z)]

    np.testing.assert_allclose(three(made.wind), e[0:3], rtol=1e-12)
    np.testing.assert_allclose(three(made.wind_rate), change[0:3], rtol=1e-12)
    np.testing.assert_allclose(three(made.aloft.wind), e[3:6], rtol=1e-12)
    np.testing.assert_allclose(three(made.aloft.wind_rate), change[3:6], rtol=1e-12)
    np.testing.assert_allclose(made.aloft.axial_factor, 1.0 + e[6:8], rtol=1e-12)
    np.testing.assert_allclose(made.aloft.push, [e[8:10], e[10:12]], rtol=1e-12)
    assert float(made.roll) == pytest.approx(e[12], rel=1e-12)
    np.testing.assert_allclose(made.density, standard_density(400.0), rtol=1e-6)
    np.testing.assert_allclose(made.aloft.density, standard_density(np.array([430.0, 900.0])), rtol=1e-6)
    assert model.observe(x, None, None) == [400.0]


def test_without_machine_code_jax_flies(plan, monkeypatch):
    monkeypatch.setattr(module.kernel, "states", lambda *given: None)
    monkeypatch.setattr(module, "trajectory_compiled", lambda *given: given[1:])
    assert flown("model", 1.0, 2.0, 3.0).tolist() == [1.0, 2.0, 3.0]
    monkeypatch.setattr(module.kernel, "states", lambda *given: [7.0])
    assert flown("model", 1.0, 2.0, 3.0).tolist() == [7.0]
