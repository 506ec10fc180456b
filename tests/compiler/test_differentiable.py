"""Machine code under JAX's transformations, against JAX alone."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.compiler.test_compiled_model import cluster_case, descent_case

from bayeschute.compiler import compiled_model, integrate
from bayeschute.compiler.differentiable import differentiable_steps

pytest.importorskip("llvmlite")
CASES = {"descent": descent_case, "cluster": lambda rng: cluster_case(2, 10.0, rng)}


@pytest.fixture(scope="module", params=list(CASES))
def case(request):
    rng = np.random.default_rng(3)
    made = CASES[request.param](rng)
    theta, start, error = (np.asarray(a)[..., 0] for a in (made.theta, made.start, made.error))
    path = np.asarray(integrate.trajectory_compiled(made.model, theta, start, error))
    path = path + 1e-3 * rng.standard_normal(path.shape)
    given = tuple(map(jnp.asarray, (theta, start, error, path)))
    reached = jax.jit(integrate.reached)(made.model, *given)
    y = jax.jit(integrate.outputs)(made.model, given[3], given[0])
    weights = jnp.asarray(rng.standard_normal(y.shape)), jnp.asarray(rng.standard_normal(path.shape))
    steps = differentiable_steps(made.model, theta.size, start.size, error.shape[1], path.shape, y.shape[1])
    return made.model, given, (y, jnp.concatenate([reached.first[None], reached.steps])), weights, steps


def test_values_are_those_of_jax(case):
    _, given, want, _, steps = case
    for got, one in zip(jax.jit(steps)(*given), want, strict=True):
        np.testing.assert_allclose(got, one, rtol=1e-9, atol=1e-9)


def test_gradients_by_every_argument_are_differences(case):
    _, given, _, weights, steps = case

    def total(*given):
        y, reached = steps(*given)
        return jnp.sum(weights[0] * y) + jnp.sum(weights[1] * reached)

    found, rng, h = jax.jit(jax.grad(total, argnums=(0, 1, 2, 3)))(*given), np.random.default_rng(5), 1e-6
    for i, slope in enumerate(found):
        way = rng.standard_normal(slope.shape) * np.maximum(np.abs(given[i]), 1e-2)
        up, down = (total(*given[:i], given[i] + sign * h * way, *given[i + 1 :]) for sign in (1.0, -1.0))
        size = float(jnp.sum(jnp.abs(slope * way)))
        np.testing.assert_allclose(jnp.sum(slope * way), (up - down) / (2.0 * h), atol=1e-5 * size)


def test_several_at_once_are_those_one_by_one(case):
    _, given, _, _, steps = case
    theta = jnp.stack([given[0], 1.01 * given[0]])
    many = jax.vmap(lambda one: steps(one, *given[1:])[1])(theta)
    for got, one in zip(many, theta, strict=True):
        np.testing.assert_allclose(got, steps(one, *given[1:])[1], rtol=1e-12)


def test_what_machine_code_does_not_serve_is_told(case, monkeypatch):
    model, given, *_ = case
    monkeypatch.setattr(compiled_model, "programs_of", lambda *_: "no compiler")
    assert differentiable_steps(model, given[0].size, given[1].size, given[2].shape[1], given[3].shape, 3) is None
