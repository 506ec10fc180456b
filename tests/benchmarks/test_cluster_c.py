"""The simulator against its twin in C, which shares no line with it."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import simulator_others as others
from tests.twins import small_cluster as small

from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster import geometry
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.state import unpack

pytestmark = pytest.mark.skipif(others.compiler() is None, reason="no C compiler here")
T, BATCH, SUBSTEPS = 41, 8, 5
CENTRE = np.array([0.95, -0.8, -0.1, 2.0, 0.3, 0.3, np.log(2.19e5), np.log(1.46e5), np.log(1.1)])
_rate = jax.jit(lambda model, theta, x, *given: model.rate(x, model.numbers(theta), *given))


@pytest.fixture(scope="module")
def flown():
    """Flights through gusts that let risers go slack and come taut again, and their states by JAX."""
    rng = np.random.default_rng(4)
    start = small.start([[0.3, -0.1], [0.0, 0.2], [-1.0, -1.0]])
    base = small.cluster(CENTRE[:2], CENTRE[2:6])
    model = small.flight(base, start, Structure(*others.TERMS), (3.0, -2.0, 0.5), samples=T, substeps=SUBSTEPS, names=others.PARAMETERS)  # fmt: skip
    air = {
        "wind": np.asarray(model.record.wind) + rng.normal(size=(T, 3)),
        "density": 1.1 + 0.01 * rng.random(T),
        "axial_factor": 1.0 + 0.05 * rng.normal(size=(T, 2)),
    }
    model = replace(model, record=replace(model.record, **air), channels=("capsule_velocity",))
    theta = CENTRE[:, None] * (1.0 + 0.01 * rng.normal(size=(CENTRE.size, BATCH)))
    error = 0.2 * rng.normal(size=(T, 5, BATCH)) * np.array([1.0, 1.0, 1.0, 0.1, 0.1])[:, None]
    error[8:10, 2] += 25.0
    x = np.asarray(trajectory_compiled(model, theta, 0.02 * rng.normal(size=(17, BATCH)), error))
    return model, theta, error, x


def test_gusts_reach_every_branch_of_the_riser(flown):
    """Slack, partly engaged and taut: else the comparison below would say little."""
    model, _, _, x = flown
    lengths = jax.vmap(lambda s: geometry(unpack(s, 2), model.base.capsule).length)(jnp.asarray(x))
    stretch = np.asarray(lengths) - model.base.risers.length
    engagement = model.base.risers.engagement
    assert (stretch < 0.0).any() and ((stretch > 0.0) & (stretch < engagement)).any() and (stretch > engagement).any()


@pytest.mark.parametrize("lanes", [1, 8])
def test_states_are_those_of_the_simulator(flown, lanes):
    model, theta, error, x = flown
    options, simulate = next(others.c_programs(lanes))
    got = simulate(model, theta, x[0], error)
    size = np.abs(x).max(axis=(0, 2), keepdims=True)
    assert (np.abs(got - x) / size).max() < 1e-9, options


@pytest.mark.parametrize("time", [0.0, 0.834, (T - 1) * 0.1])
def test_rates_are_those_of_the_simulator(flown, time):
    model, theta, error, x = flown
    at = min(int(time / model.dt), T - 2)
    now, then = (jax.tree.map(lambda a, k=k: a[at + k], model.inputs()) for k in (0, 1))
    drift = error[at, :, 0], error[at + 1, :, 0]
    want = _rate(model, theta[:, 0], x[at, :, 0], now, then, *drift, time / model.dt - at)
    got = others.c_rate(model, theta[:, 0], error[..., 0])(time, x[at, :, 0])
    assert (np.abs(got - want) < 1e-10 * (1.0 + np.abs(want))).all()


def test_other_terms_are_refused(flown):
    model, theta, error, x = flown
    _, simulate = next(others.c_programs(1))
    other = replace(model, structure=Structure(("1",), ("e",)))
    with pytest.raises(ValueError, match="other terms"):
        simulate(other, theta, x[0], error)
    for change in ({"yaw_damping": -0.1}, {"products": Vec3(100.0, 0.0, 0.0)}):
        richer = replace(model, base=replace(model.base, capsule=replace(model.base.capsule, **change)))
        with pytest.raises(ValueError, match="plain capsule"):
            simulate(richer, theta, x[0], error)
