"""The filter's passes by machine code against JAX's scans, for systems of many sizes with gaps in their data."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.compiler.integrate import Steps
from bayeschute.compiler.machine import takes
from bayeschute.likelihood import disturbances, kalman
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.filter_code import passes
from bayeschute.likelihood.kalman_gradient import Pass, _series, _sums
from bayeschute.likelihood.noise import Noise

T, DT = 20, 0.3
SYSTEMS = {  # own states, outputs, disturbances, drifts, oscillators, columns
    "one of each": (1, 1, 1, 1, 0, 1),
    "no latent state": (4, 2, 1, 0, 0, 3),
    "odd numbers": (7, 3, 3, 2, 1, 5),
    "more than registers take": (13, 15, 2, 1, 1, 50),
}


@pytest.fixture(scope="module", params=SYSTEMS.values(), ids=SYSTEMS.keys())
def system(request):
    """A random stable flight: arguments of the covariance pass, and data of all columns."""
    x, c, a, drifts, oscillators, columns = request.param
    rng = np.random.default_rng(x)
    turn = np.linalg.qr(rng.standard_normal((x, x)))[0]
    shapes = ((T - 1, x, 0), (T - 1, x, a), (T - 1, x, a), (x, 0), (x, 2), (T, c, x), (T, c, 0))
    steps = Steps(
        jnp.asarray(0.9 * turn + 0.05 * rng.standard_normal((T - 1, x, x))),
        *(jnp.asarray(0.4 * rng.standard_normal(shape)) for shape in shapes),
    )
    kinds = ("drift",) * (drifts > 0) + ("oscillator",) * (oscillators > 0)
    groups = [0] * drifts + [len(kinds) - 1] * oscillators
    latent = Latent(kinds, tuple((k % a, group) for k, group in enumerate(groups)), a)
    laws = tuple(np.array([0.6, 1.5]) if kind == "drift" else np.array([0.9, 0.35, 0.15]) for kind in kinds)
    noise = Noise(*(rng.uniform(0.1, 1.0, c) for _ in range(3)))
    here = rng.random((T, c)) > 0.2
    here[3] = False
    given = (steps, np.array([0.5, 1.4]), disturbances.dynamics(latent, laws, DT), noise, DT, jnp.asarray(here))
    data = rng.standard_normal((T, c, columns)), rng.standard_normal((T, x, columns))
    return given, tuple(map(jnp.asarray, data))


def _close(ours, theirs):
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        assert np.shape(a) == np.shape(b)
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-10 * (1.0 + np.max(np.abs(b), initial=0.0)))


def _slack(system):
    return jnp.asarray(np.linspace(0.1, 0.5, system[0][0].by_state.shape[1]))


@pytest.mark.parametrize("loose", [False, True])
def test_filter_and_smoother_are_those_of_the_scans(system, loose):
    given, data = system
    slack = _slack(system) if loose else None

    def both(given, data, slack):
        made = kalman.gains(*given, slack)
        return made, kalman.smooth_driven(made, kalman.Seen(*data)), kalman.forward(made, data[0])

    _close(both(given, data, slack), jax.jit(both)(given, data, slack))


def test_inputs_to_all_states_and_means_of_some(system):
    given, (series, _) = system
    made = kalman.gains(*given)
    inputs = jnp.asarray(np.random.default_rng(1).standard_normal((T, made.first.shape[0], series.shape[2])))
    by_jax = jax.jit(kalman.forward, static_argnums=3)
    for told in (0, 1, None):
        _close(kalman.forward(made, series, inputs, told), by_jax(made, series, inputs, told))


def test_adjoint_pass_is_that_of_the_scan(system):
    given, data = system
    made, latents, noises = kalman.covariances(*given, score=True)
    wanted = jax.jit(partial(kalman.covariances, score=True))(*given)
    _close((latents, noises), wanted[1:])
    done = Pass(made, latents, noises, *kalman.forward(made, *data))
    mix = jnp.asarray(np.random.default_rng(2).standard_normal((data[0].shape[2], 4)))
    series = _series(done, given[0].by_then, given[2].output, mix)
    _close(passes.score(made, series, latents, noises), tuple(_sums(made, series, latents, noises)))


def test_what_is_traced_is_left_to_jax(system):
    given, _ = system
    assert takes(given)
    seen = []
    jax.jit(lambda a: seen.append(takes(a)))(given[0])
    assert seen == [False]
