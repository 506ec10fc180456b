"""Weights of the exact joint posterior: closed forms, dense twins, brute force, and what failures do to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.likelihood.disturbances import disturbances
from bayeschute.likelihood.joint import LatentPath, latent_path_of, linearise
from bayeschute.likelihood.kalman import response
from bayeschute.likelihood.noise import gains
from bayeschute.likelihood.simulation_smoother import normals
from bayeschute.posterior.assess import exact_importance
from bayeschute.posterior.assess.exact_importance import (
    Following,
    cross_determinant,
    estimates,
    improved,
    laplace,
    weigh,
)
from bayeschute.posterior.fit.laplace_fit import find
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import NoiseEffect
from bayeschute.posterior.sampling.independence import Proposal


def _jacobian(flight, hyper, lin):
    """Outputs by start and process noise as one dense matrix (T C, D + T L)."""
    starts, latents, samples = flight.starts, flight.latent.size, flight.samples
    one = np.eye(starts + samples * latents)
    error = disturbances(hyper.dynamics(flight), one[starts:].reshape(samples, latents, -1))
    start, theta = flight.start_scale[:, None] * one[:starts], np.zeros((lin.steps.out_theta.shape[2], len(one)))
    return np.asarray(response(lin.steps, start, error, theta)).reshape(-1, len(one))


@pytest.fixture(scope="module")
def two_courses(short):
    """A bent flight linearised at two courses that differ."""
    flight, hyper, priors = short
    theta, rng = np.array([np.log(0.2)]), np.random.default_rng(4)
    still = latent_path_of(flight, hyper, flight.still())
    moved = LatentPath(np.asarray(still.start) + 1.0, np.asarray(still.error) + rng.standard_normal(still.error.shape))
    return flight, hyper, [linearise(flight, theta, at) for at in (moved, still)]


@pytest.mark.parametrize("missing", [False, True])
def test_cross_determinant_is_that_of_the_dense_matrix(two_courses, dense, missing):
    flight, hyper, linear = two_courses
    if missing:
        flight = replace(flight, present=np.asarray(flight.present) & (np.arange(5) != 2)[:, None])
    models = [exact_importance._model(flight, hyper, lin) for lin in linear]
    j, j_0 = (_jacobian(flight, hyper, lin) for lin in linear)
    noise = hyper.outputs(flight)
    here = np.asarray(flight.present)
    r = dense.noise_covariance(
        flight.dt * np.arange(5), here, *(np.asarray(a) for a in (noise.white, noise.correlated, noise.time_constant))
    )
    seen = here.ravel()
    wanted = np.linalg.slogdet(r + (j @ j_0.T)[np.ix_(seen, seen)])
    assert np.abs(j - j_0).max() > 0.01  # two models, not one
    sign, value = cross_determinant(flight, hyper, *models)
    assert (float(sign), float(value)) == pytest.approx((wanted[0], wanted[1]), rel=1e-9)


def test_of_a_linear_flight_every_draw_tells_the_likelihood(linear):
    near = latent_path_of(linear.flight, linear.hyper, linear.flight.still())
    made = estimates(
        linear.flight, linear.hyper, linear.theta, near, normals(linear.flight, 3, np.random.default_rng(0))
    )
    exact = linear.matrices.given_theta(linear.flight, linear.hyper, linear.theta)
    np.testing.assert_allclose(made.log_likelihood, exact, rtol=1e-9)
    assert not made.folded.any() and made.moved.max() < 1e-9


def test_estimates_of_a_bent_flight_are_unbiased(short, quadrature):
    """Their mean is the integral over start and process noise by brute force, at three values of the parameter."""
    flight, hyper, _ = short
    variance = np.asarray(gains(hyper.outputs(flight), flight.dt, np.asarray(flight.present))[2])
    none = -0.5 * np.log(2.0 * np.pi * variance[flight.present]).sum()
    none -= 0.5 * (flight.starts + flight.samples) * np.log(2.0 * np.pi)
    for theta in np.log([0.15, 0.2, 0.27]):
        near = latent_path_of(flight, hyper, flight.still())
        made = estimates(flight, hyper, np.array([theta]), near, normals(flight, 64, np.random.default_rng(1)))
        wanted = quadrature.integrated(flight, hyper, np.array([theta]), nodes=7)[0] + none
        ratio = np.exp(made.log_likelihood - wanted)
        assert ratio.mean() == pytest.approx(1.0, abs=4.0 * ratio.std() / 8.0 + 1e-4)
        assert ratio.std() > 1e-3  # it does bend


def test_weighed_draws_have_the_posterior_of_brute_force(short, quadrature):
    """One parameter, noise parameters all but held: moments over a grid of integrals."""
    flight, hyper, priors = short
    noise = NoisePrior(hyper, 1e-3)
    found = find([flight], priors, noise)
    first = weigh(found, priors, noise, laplace(found), 60, 1)
    made = weigh(found, priors, noise, improved(found, laplace(found), first), 200, 2)
    centre, sd = float(found.marginal.centre[0]), float(found.marginal.scale[0, 0])
    grid = centre + sd * np.linspace(-5.0, 5.0, 41)
    logs = np.array([quadrature.integrated(flight, hyper, np.array([t]))[0] for t in grid])
    logs -= 0.5 * ((grid - priors[0].centre) / priors[0].scale) ** 2
    share = np.exp(logs - logs.max()) / np.exp(logs - logs.max()).sum()
    mean = share @ grid
    spread = np.sqrt(share @ (grid - mean) ** 2)
    got = made.weight @ made.theta[:, 0]
    assert made.effective > 60 and made.pareto_k < 0.7 and made.failed == 0
    assert (got - mean) / spread == pytest.approx(0.0, abs=4.0 / np.sqrt(made.effective))
    width = np.sqrt(made.weight @ (made.theta[:, 0] - got) ** 2)
    assert width / spread == pytest.approx(1.0, abs=4.0 / np.sqrt(2.0 * made.effective))


@pytest.fixture
def following():
    """Two parameters that follow one noise parameter."""
    rng = np.random.default_rng(3)
    spread = rng.standard_normal((1, 2, 2))
    effect = NoiseEffect(
        rng.standard_normal((2, 1)), spread + np.swapaxes(spread, 1, 2), np.array([[0.2, 0.1], [0.1, 0.0]])
    )
    middle, factor = np.array([0.3, -0.2, 0.1]), np.tril(rng.uniform(0.5, 1.0, (3, 3)))
    return Following(Proposal(middle, factor, 10.0), np.array([-1.5]), np.array([[0.3]]), effect)


def test_the_proposals_density_is_what_its_map_makes_of_the_bases(following):
    """Change of variables, the Jacobian by differences; what is carried is found again."""
    rng = np.random.default_rng(4)
    base = following.base.draw(6, rng)

    def carried(row):
        moved = row[2:] @ following.factor.T
        return np.concatenate([following.effect.carried(row[:2], moved), following.log_noise + moved])

    points, step = np.array([carried(row) for row in base]), 1e-5
    np.testing.assert_allclose(following.unfolded(points)[0], base, atol=1e-12)
    columns = [[(carried(r + step * e) - carried(r - step * e)) / (2.0 * step) for e in np.eye(3)] for r in base]
    wanted = following.base.log_density(base) - np.linalg.slogdet(np.array(columns))[1]
    constant = following.log_density(points) - wanted
    np.testing.assert_allclose(constant, constant[0], atol=1e-8)
    assert np.ptp(wanted) > 1.0


def test_draws_of_the_proposal_are_of_its_density(following):
    """Weighed by the ratio to a normal density whose moments are known, they have these."""
    sd = np.array([0.4, 0.4, 0.12])
    wanted = Proposal(np.array([0.2, 0.1, -1.45]), np.diag(sd), 1e9)
    points = following.draw(40_000, np.random.default_rng(5))
    log_weight = wanted.log_density(points) - following.log_density(points)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    few = 1.0 / np.sum(weight**2)
    assert few > 1000
    np.testing.assert_allclose(weight @ points / sd, wanted.middle / sd, atol=4.0 / np.sqrt(few))
    np.testing.assert_allclose(weight @ (points - wanted.middle) ** 2, sd**2, rtol=4.0 * np.sqrt(2.0 / few))


def test_the_same_seed_weighs_the_same_whatever_thread_is_first(found, descent):
    noise = NoisePrior(descent.hyper, 0.4)
    one, other = (weigh(found, descent.priors, noise, laplace(found), 4, 5) for _ in range(2))
    np.testing.assert_array_equal(one.log_weight, other.log_weight)


def test_what_does_not_fly_weighs_nothing_and_is_counted(found, descent, monkeypatch):
    real = exact_importance.residuals

    def lost(flight, theta, driven):
        made = np.array(real(flight, theta, driven))
        made[..., -1] = np.nan
        return made

    monkeypatch.setattr(exact_importance, "residuals", lost)
    made = weigh(found, descent.priors, NoisePrior(descent.hyper, 0.4), laplace(found), 3, 5)
    assert made.failed == 3 * len(found.marginal.flights)
    assert np.isfinite(made.log_weight).all()
