"""Descent of a point mass by numpyro and diffrax: white residuals, NUTS, all chains side by side."""

import diffrax
import exchange
import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from numpyro.infer import MCMC, NUTS

jax.config.update("jax_enable_x64", True)
problem = exchange.read()
((name, (centre, width)),) = problem.priors.items()


def simulate(drag, speed, table):
    """Descent rates (T,) of C_D S/m and the first descent rate."""
    times = jnp.asarray(table["time"])
    density = diffrax.LinearInterpolation(times, jnp.asarray(table["density"]))

    def rate(t, v, args):
        return problem.gravity - 0.5 * density.evaluate(t) * drag * v * jnp.abs(v)

    made = diffrax.diffeqsolve(
        diffrax.ODETerm(rate),
        diffrax.Tsit5(),
        times[0],
        times[-1],
        1.0,
        speed,
        saveat=diffrax.SaveAt(ts=times),
        adjoint=diffrax.ForwardMode(),
    )
    return made.ys


def model():
    """Priors and likelihood."""
    z = numpyro.sample("z", dist.Normal())
    log_drag = numpyro.deterministic(name, centre + width * z)
    speed = problem.start[1] + problem.start_sd[1] * numpyro.sample("speed", dist.Normal())
    sigma = numpyro.sample("sigma", dist.LogNormal(jnp.log(problem.noise[0]), problem.noise_log_sd))
    made = simulate(jnp.exp(log_drag), speed, problem.record)
    numpyro.sample("seen", dist.Normal(made, sigma), obs=jnp.asarray(problem.record["descent_rate"]))


numpyro.enable_validation(False)  # of draws far out, which do not fall
kernel = NUTS(model, forward_mode_differentiation=True)
mcmc = MCMC(kernel, num_warmup=200, num_samples=300, num_chains=2, chain_method="vectorized", progress_bar=False)
mcmc.run(jax.random.key(problem.seed))
found = mcmc.get_samples(group_by_chain=True)

chains = np.asarray(found[name])[:, :, None]
drag, sigma = (exchange.thinned(np.asarray(found[key])[:, :, None])[:, 0] for key in (name, "sigma"))
fly = jax.jit(jax.vmap(lambda x: simulate(jnp.exp(x), jnp.asarray(problem.next_start[1]), problem.next)))
motion = {"descent_rate": np.asarray(fly(jnp.asarray(drag)))}
versions = ("numpyro", "diffrax", "jax", "numpy")
exchange.write(problem, versions, [name], chains, motion, {"descent_rate": sigma}, "300 draws of 2 chains")
