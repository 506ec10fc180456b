"""The marginal posterior as a numpyro model with named sites, for notebooks.

Every parameter is a site of its own, in its own unit and with its own prior; the likelihood, start and latent
disturbances integrated out, enters by `numpyro.factor`. On numpyro's unconstrained space, where a parameter with a
log-normal prior is its logarithm, the log density is that of `marginal.log_density` up to a constant. Steps are taken
by machine code with its exact derivatives (`compiler.differentiable`) where there is one, else by JAX.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from numpy.typing import NDArray

from bayeschute.aero.coefficient import APPARENT_MASS
from bayeschute.compiler.differentiable import differentiable_steps
from bayeschute.core.errors import Fault, InputError
from bayeschute.likelihood.joint import FlightData, LatentPath, jax_stepped
from bayeschute.likelihood.kalman import innovations
from bayeschute.likelihood.priors import Prior, factor, values, working
from bayeschute.posterior.marginal import Linearisation, Marginal, latent_path_at, out_of_range, seen_along

Array = NDArray[np.float64]
SITE = "log_likelihood"


Look = Callable[[jax.Array, LatentPath], tuple[jax.Array, jax.Array]]


def _look(flight: FlightData, along: Linearisation) -> Look:
    """Residuals and defects of a flight at parameters and a path: by machine code where that serves it, else by JAX."""
    model, at = flight.model, along.at
    sizes = np.size(along.theta), np.size(at.unknowns.start), np.shape(at.error)[1], np.shape(at.path)
    steps = differentiable_steps(model, *sizes, np.shape(flight.observed)[1])
    if steps is None:
        return lambda theta, latent_path: jax_stepped(flight, theta, latent_path)

    def look(theta: jax.Array, latent_path: LatentPath) -> tuple[jax.Array, jax.Array]:
        y, reached = steps(theta, jnp.asarray(latent_path.start), jnp.asarray(latent_path.error), latent_path.path)
        return jnp.where(flight.present, flight.observed - y, 0.0), reached - latent_path.path

    return look


def log_likelihood(marginal: Marginal) -> Callable[[jax.Array], jax.Array]:
    """The differentiable log likelihood of parameters in working coordinates (P,), up to a constant.

    Args:
        marginal: The posterior.

    Returns:
        A function of theta (P,); NaN where the simulation fails. With the log prior it is `marginal.log_density`.
    """
    inverse = jnp.asarray(np.linalg.inv(np.asarray(marginal.scale)))  # a product: no triangular solves in a batch
    looks = [_look(*pair) for pair in zip(marginal.flights, marginal.along, strict=True)]

    def value(theta: jax.Array) -> jax.Array:
        shift = theta - jnp.asarray(marginal.centre)
        xi = inverse @ shift
        total = -marginal.correction_at(xi)
        for flight, along, look, felt in zip(marginal.flights, marginal.along, looks, marginal.felt, strict=True):
            residual, defects = look(theta, latent_path_at(flight, along, shift))
            seen = seen_along(along, residual[..., None], defects[..., None], shift[:, None])
            unit = innovations(along.gains, *seen)
            dear = out_of_range(along, unit, shift[:, None], xi[felt][:, None])[0]
            total = total - 0.5 * (jnp.sum(unit**2) + dear**2)
        return total

    return value


def model(marginal: Marginal, priors: Sequence[Prior]) -> Callable[[], None]:
    """The model of a marginal posterior; give it to `numpyro.infer.NUTS` or `numpyro.infer.Predictive`.

    Args:
        marginal: The posterior, set up with the same priors.
        priors: Priors of the parameters, in order; their names become the sites.

    Returns:
        A numpyro model without arguments: a site per parameter in its unit, and the factor `SITE`. Where a simulation
        fails, the factor is minus infinity.

    Raises:
        InputError: If the priors are not those of the posterior, or a name is taken twice.
    """
    centre, root = working(priors)[0], factor(priors)
    here = np.asarray(marginal.prior_centre), np.asarray(marginal.prior_factor)
    if centre.shape != here[0].shape or not (np.array_equal(centre, here[0]) and np.array_equal(root, here[1])):
        got = f"{len(priors)} others"
        raise InputError(Fault("priors of a numpyro model", got, f"the {here[0].size} of the marginal posterior"))
    names = [p.name for p in priors]
    if len({*names, SITE}) != len(names) + 1:
        raise InputError(Fault("priors of a numpyro model", ", ".join(names), f"different names, none {SITE!r}"))
    likelihood = log_likelihood(marginal)
    order = np.argsort([p.air_share != 0.0 for p in priors], kind="stable")  # after what they grow with
    back, some = np.argsort(order), [priors[i] for i in order]
    some_root = factor(some)

    def made() -> None:
        theta: list[jax.Array] = []
        standard: list[jax.Array] = []
        more_air: jax.Array | float = 0.0
        for p, row in zip(some, some_root, strict=True):  # each given those before it
            k = len(theta)
            mean = p.centre + sum((row[j] * standard[j] for j in range(k) if row[j]), 0.0)
            grown = 1.0 + p.air_share * more_air
            distribution = dist.LogNormal(mean, row[k]) if p.logarithmic else dist.Normal(grown * mean, grown * row[k])
            value = numpyro.sample(p.name, distribution)
            theta.append(jnp.log(value) if p.logarithmic else value / grown)
            standard.append((theta[-1] - mean) / row[k])
            if p.name == APPARENT_MASS:
                more_air = value - 1.0
        told = likelihood(jnp.stack([theta[place] for place in back]))
        numpyro.factor(SITE, jnp.where(jnp.isnan(told), -jnp.inf, told))

    return made


def start(marginal: Marginal, priors: Sequence[Prior]) -> dict[str, Array]:
    """Values of the sites at the centre of the posterior, for `numpyro.infer.init_to_value`."""
    return dict(zip([p.name for p in priors], values(priors, np.asarray(marginal.centre)), strict=True))
