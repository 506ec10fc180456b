"""The numpyro model is the marginal posterior: same density, right gradients, same draws."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpyro.infer import MCMC, NUTS, init_to_value
from numpyro.infer.util import log_density as numpyro_log_density
from numpyro.infer.util import potential_energy
from scipy.stats import multivariate_normal

from bayeschute.core.errors import InputError
from bayeschute.likelihood.priors import correlated, factor, values
from bayeschute.posterior import sampler
from bayeschute.posterior.marginal import log_density
from bayeschute.posterior.numpyro_model import SITE, log_likelihood, model, start


def _unconstrained(marginal, priors, xi):
    """Minus the potential energy on numpyro's unconstrained space at standard coordinates (P,)."""
    theta = np.asarray(marginal.theta(jnp.asarray(xi)))
    return -float(
        potential_energy(model(marginal, priors), (), {}, {p.name: t for p, t in zip(priors, theta, strict=True)})
    )


@pytest.mark.parametrize("which", ["falling", "straight"])
def test_density_is_the_marginal_one_up_to_a_constant(which, request, descent, linear):
    made = request.getfixturevalue(which)
    priors = descent.priors if which == "falling" else linear.priors
    xi = 1.7 * np.random.default_rng(5).standard_normal((len(priors), 5))
    wanted = np.asarray(log_density(made, xi))
    ours = np.array([_unconstrained(made, priors, x) for x in xi.T])
    assert np.ptp(wanted) > 0.5
    np.testing.assert_allclose(ours - ours[0], wanted - wanted[0], rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


def test_sites_are_parameters_in_their_own_units(falling, descent):
    """On the values themselves the prior is log-normal: the density differs by the Jacobian."""
    prior, value = descent.priors[0], 0.23
    total, trace = numpyro_log_density(model(falling, descent.priors), (), {}, {prior.name: value})
    assert set(trace) == {prior.name, SITE}
    z = (np.log(value) - prior.centre) / prior.scale
    wanted = -0.5 * z**2 - np.log(value * prior.scale * np.sqrt(2.0 * np.pi))
    told = float(log_likelihood(falling)(jnp.log(jnp.array([value]))))
    assert float(total) == pytest.approx(wanted + told, rel=1e-12)
    assert float(start(falling, descent.priors)[prior.name]) == pytest.approx(float(np.exp(falling.centre[0])))


@pytest.mark.parametrize("logarithmic", [False, True])
def test_correlated_priors_are_one_normal_law(straight, linear, logarithmic):
    """Of the working coordinates: on a value that is a logarithm's, the density differs by the Jacobian."""
    centre, law = np.array([0.5, -0.3]), np.array([[0.36, -0.3], [-0.3, 0.64]])
    priors = correlated([linear.priors[0], replace(linear.priors[1], logarithmic=logarithmic)], centre, law)
    made = replace(straight, prior_centre=centre, prior_factor=factor(priors))
    for theta in centre + np.random.default_rng(4).standard_normal((3, 2)):
        sites = {p.name: p.value(t) for p, t in zip(priors, theta, strict=True)}
        total, _ = numpyro_log_density(model(made, priors), (), {}, sites)
        wanted = multivariate_normal(centre, law).logpdf(theta) - (theta[1] if logarithmic else 0.0)
        told = float(log_likelihood(made)(jnp.asarray(theta)))
        assert float(total) - told == pytest.approx(wanted, abs=1e-9 * abs(told))
    with pytest.raises(InputError, match="priors"):
        model(made, [replace(p, correlation={}) for p in priors])


def test_a_coefficient_that_grows_with_the_apparent_mass_has_the_same_law(straight, linear):
    """Whichever comes first: the site is the value, so the density differs by the Jacobian."""
    centre, law = np.array([0.5, -0.3]), np.array([[0.36, -0.3], [-0.3, 0.64]])
    force = replace(linear.priors[0], air_share=0.8)
    air = replace(linear.priors[1], name="enclosed_air_factor", logarithmic=True)
    priors = correlated([force, air], centre, law)
    made = replace(straight, prior_centre=centre, prior_factor=factor(priors))
    for theta in centre + np.random.default_rng(4).standard_normal((3, 2)):
        sites = dict(zip([p.name for p in priors], values(priors, theta), strict=True))
        total, _ = numpyro_log_density(model(made, priors), (), {}, sites)
        grown = 1.0 + 0.8 * (np.exp(theta[1]) - 1.0)
        wanted = multivariate_normal(centre, law).logpdf(theta) - theta[1] - np.log(grown)
        told = float(log_likelihood(made)(jnp.asarray(theta)))
        assert float(total) - told == pytest.approx(wanted, abs=1e-9 * abs(told))


def test_density_under_correlated_priors_is_the_marginal_one(straight, linear):
    law = np.array([[0.36, 0.4], [0.4, 0.64]])
    priors = correlated(linear.priors, np.array([0.5, 0.0]), law)
    made = replace(straight, prior_factor=factor(priors))
    xi = 1.7 * np.random.default_rng(6).standard_normal((2, 5))
    wanted, before = (np.asarray(log_density(one, xi)) for one in (made, straight))
    ours = np.array([_unconstrained(made, priors, x) for x in xi.T])
    np.testing.assert_allclose(ours - ours[0], wanted - wanted[0], rtol=1e-9, atol=1e-9 * np.abs(wanted).max())
    assert np.ptp(wanted - before) > 1e-3
    theta = np.asarray(made.theta(xi)).T
    old, new = (multivariate_normal([0.5, 0.0], c).logpdf(theta) for c in (np.diag([0.36, 0.64]), law))
    np.testing.assert_allclose(wanted - before - (wanted - before)[0], new - old - (new - old)[0], atol=1e-8)


def test_gradient_is_that_of_differences(falling, straight):
    for made in (falling, straight):
        density, at = log_likelihood(made), np.asarray(made.centre) + 0.3 * np.diag(np.asarray(made.scale))
        gradient = np.asarray(jax.grad(density)(jnp.asarray(at)))
        for i in range(at.size):
            step = np.zeros(at.size)
            step[i] = 1e-4 * np.asarray(made.scale)[i, i]
            difference = float(density(at + step) - density(at - step)) / (2.0 * step[i])
            assert gradient[i] == pytest.approx(difference, rel=1e-5, abs=1e-5 / step[i] * 1e-4)


def test_failed_simulation_has_no_density(falling, descent):
    """NaN must not reach the sampler."""
    with pytest.warns(UserWarning, match="Out-of-support"):
        _, trace = numpyro_log_density(model(falling, descent.priors), (), {}, {descent.priors[0].name: jnp.inf})
    assert float(trace[SITE]["fn"].log_factor) == -np.inf
    assert np.isnan(float(log_likelihood(falling)(jnp.array([jnp.inf]))))


def test_nuts_draws_what_the_product_draws(falling, descent):
    name, priors = descent.priors[0].name, descent.priors
    kernel = NUTS(model(falling, priors), init_strategy=init_to_value(values=start(falling, priors)))
    chains = MCMC(kernel, num_warmup=80, num_samples=250, num_chains=1, progress_bar=False)
    chains.run(jax.random.key(3))
    theirs = np.log(np.asarray(chains.get_samples()[name]))
    ours = sampler.sample(falling, "nuts", 2, 200, 400, seed=1).xi.ravel()
    ours = float(falling.centre[0]) + float(falling.scale[0, 0]) * ours
    sd = ours.std()
    assert abs(theirs.mean() - ours.mean()) < 0.25 * sd
    assert 0.8 < theirs.std() / sd < 1.25


def test_other_priors_are_refused(falling, descent, straight, linear):
    with pytest.raises(InputError, match="priors"):
        model(falling, [replace(descent.priors[0], centre=0.0)])
    with pytest.raises(InputError, match="priors"):
        model(falling, [])
    with pytest.raises(InputError, match="different names"):
        model(straight, [replace(linear.priors[0], name="two"), linear.priors[1]])
