"""The smoother's gradient against automatic differentiation of the filter."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree

from bayeschute.compiler import machine
from bayeschute.likelihood import kalman_gradient
from bayeschute.likelihood.joint import NoiseParameters, as_seen, filter_gains, latent_path_of, linearise
from bayeschute.likelihood.kalman import innovations
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import precision
from bayeschute.posterior import noise_evidence
from bayeschute.posterior.noise_evidence import NoisePrior

LOG_SD = 0.7


@pytest.fixture(params=["machine code", "JAX"])
def passes_by(request, monkeypatch):
    """The filter's passes by machine code, and by JAX, which takes them where no code can be generated."""
    if request.param == "JAX":
        monkeypatch.setattr(machine, "available", lambda: False)


def _plain(vector, like, flights, linear, before, parameters=True):
    """The objective as it is defined, for JAX to differentiate."""
    hyper = kalman_gradient.from_vector(vector, like)
    middle = ravel_pytree(jax.tree.map(jnp.log, like))[0]
    value, matrix = 0.5 * jnp.sum(((vector - middle) / LOG_SD) ** 2), before
    for flight, lin in zip(flights, linear, strict=True):
        made, seen = filter_gains(flight, hyper, lin), as_seen(lin)
        unit = innovations(made, *seen).reshape(-1, seen.series.shape[2])
        value = value + 0.5 * unit[:, 0] @ unit[:, 0] + made.log_determinant
        matrix = matrix + unit[:, 1:].T @ unit[:, 1:]
    return value + 0.5 * jnp.linalg.slogdet(matrix)[1] if parameters else value


_by_ad = jax.jit(jax.value_and_grad(_plain), static_argnums=5)


def _mean_corrections(flight, seed):
    """The flight with a tenth of its data gone, a long gap and both ends among them."""
    seen = np.array(flight.present) & (np.random.default_rng(seed).random(np.shape(flight.present)) > 0.1)
    seen[0, 0], seen[20:30], seen[-1, -1] = False, False, False
    return replace(flight, present=seen)


def _case(name, request):
    made = request.getfixturevalue(name)
    pairs = list(zip(made.flights, made.u, strict=True)) if name == "descent" else [(made.flight, made.u)] * 2
    flights = tuple(_mean_corrections(f, i) for i, (f, _) in enumerate(pairs))
    linear = tuple(
        linearise(f, made.theta, latent_path_of(f, made.hyper, u)) for f, (_, u) in zip(flights, pairs, strict=True)
    )
    like = jax.tree.map(lambda a: jnp.asarray(a, float), made.hyper)
    return made, flights, linear, like


def _all(before):
    """Numbers of all parameters, of which a flight tells."""
    return np.arange(len(before))


@pytest.mark.usefixtures("passes_by")
@pytest.mark.parametrize("name", ["linear", "descent"])
def test_gradient_is_that_of_the_differentiated_filter(name, request):
    """Two flights with gaps: drifts and an oscillator in one case, a simulation in the other."""
    made, flights, linear, like = _case(name, request)
    at = jnp.asarray(kalman_gradient.to_vector(made.hyper))
    at = at + 0.4 * np.random.default_rng(3).standard_normal(at.size)
    before = jnp.asarray(precision(made.priors))
    value, gradient = _by_ad(at, like, flights, linear, before, True)
    seen = tuple(as_seen(lin) for lin in linear)
    ours = kalman_gradient.evidence_score(
        at, like, LOG_SD, flights, linear, seen, (_all(before),) * len(flights), before
    )
    assert float(ours[0]) == pytest.approx(float(value), rel=1e-11)
    np.testing.assert_allclose(ours[1], gradient, rtol=1e-8, atol=1e-8 * np.abs(gradient).max())
    assert (np.abs(gradient) > 1e-4).all()
    # Parameters held: the same without their matrix, and no prior.
    held = sum(
        kalman_gradient.conditional_score(at, like, f, lin, s.column(0))
        for f, lin, s in zip(flights, linear, seen, strict=True)
    )
    wanted = (
        _by_ad(at, like, flights, linear, before, False)[1] - (at - kalman_gradient.to_vector(made.hyper)) / LOG_SD**2
    )
    np.testing.assert_allclose(held, wanted, rtol=1e-8, atol=1e-8 * np.abs(wanted).max())


def test_gradient_by_differences(descent, request):
    _, flights, linear, _ = _case("descent", request)
    value = noise_evidence.function_of(flights, linear, descent.priors, NoisePrior(descent.hyper, LOG_SD))
    at, step = kalman_gradient.to_vector(descent.hyper) + 0.2, 1e-5
    wanted = [(value(at + step * e)[0] - value(at - step * e)[0]) / (2.0 * step) for e in np.eye(at.size)]
    np.testing.assert_allclose(value(at)[1], wanted, rtol=1e-5, atol=1e-5)


@pytest.mark.usefixtures("passes_by")
def test_noise_without_processes_of_its_own_has_a_gradient(descent):
    """Residual noise alone: no latent process is there to have a transition or a shock."""
    flight = replace(descent.flights[0], latent=descent.flights[0].latent._replace(kinds=(), processes=(), least=1))
    hyper = NoiseParameters(Noise(*(jnp.asarray(a) for a in descent.hyper.noise.__dict__.values())), ())
    lin = linearise(flight, descent.theta, latent_path_of(flight, hyper, flight.still()))
    at, before = jnp.asarray(kalman_gradient.to_vector(hyper)) + 0.1, jnp.asarray(precision(descent.priors))
    ours = kalman_gradient.evidence_score(
        at, hyper, LOG_SD, (flight,), (lin,), (as_seen(lin),), (_all(before),), before
    )
    value, gradient = _by_ad(at, hyper, (flight,), (lin,), before, True)
    assert float(ours[0]) == pytest.approx(float(value), rel=1e-11)
    np.testing.assert_allclose(ours[1], gradient, rtol=1e-8, atol=1e-8)


@pytest.mark.usefixtures("passes_by")
@pytest.mark.parametrize("growth", [1.0, 2.0])
def test_gradient_of_a_flight_that_diverges_without_its_data(linear, request, growth):
    """Rounding must not grow as the open loop does, here by a factor of two a sample."""
    made, flights, lin, like = _case("linear", request)
    flight, steps = flights[0], lin[0].steps
    grown = lin[0]._replace(steps=steps._replace(by_state=growth * jnp.asarray(steps.by_state)))
    before = jnp.asarray(precision(made.priors))
    at = jnp.asarray(kalman_gradient.to_vector(made.hyper)) + 0.2
    value, gradient = _by_ad(at, like, (flight,), (grown,), before, True)
    ours = kalman_gradient.evidence_score(
        at, like, LOG_SD, (flight,), (grown,), (as_seen(grown),), (_all(before),), before
    )
    assert float(ours[0]) == pytest.approx(float(value), rel=1e-9)
    np.testing.assert_allclose(ours[1], gradient, rtol=1e-6, atol=1e-6 * np.abs(gradient).max())
