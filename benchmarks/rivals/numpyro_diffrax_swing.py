"""Planar dumbbell by numpyro and diffrax: white residuals, or AR(1) with ``--ar1``; NUTS, all chains side by side."""

import sys

import diffrax
import exchange
import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
from jax.scipy.special import ndtr as normal_cdf
from numpyro.infer import MCMC, NUTS, init_to_value
from scipy.optimize import least_squares

jax.config.update("jax_enable_x64", True)
ar1 = "--ar1" in sys.argv
problem = exchange.read()
names, (centre, width) = list(problem.priors), np.array(list(problem.priors.values())).T
record = problem.record
data = jnp.stack([record["swing_angle"], record["along"], record["down"]], axis=1)


def simulate(theta, start, table, body):
    """Swing angle and velocity of the capsule (T, 3)."""
    C_A0, C_Aalpha, alpha_0, C_Nalpha, C_Nalphadot = theta
    m_L, L, g, area, dry = (body[k] for k in ("capsule_mass", "length", "gravity", "area", "dry_mass"))
    times = jnp.asarray(table["time"])
    rows = jnp.stack([table[k] for k in ("wind_along", "wind_down", "density")], axis=1)
    given = diffrax.LinearInterpolation(times, rows)

    def rate(t, x, args):
        angle, turn, v, w = x
        wind_v, wind_w, rho = given.evaluate(t)
        s, c = jnp.sin(angle), jnp.cos(angle)
        a, d, air = v - wind_v, w - wind_w, rho * body["enclosed_volume"]
        axial, side = a * s + d * c, -a * c + d * s + L * turn
        alpha, q_area = jnp.arctan2(side, axial), 0.5 * rho * area * (axial**2 + side**2)
        A_x = q_area * (C_A0 + 0.5 * C_Aalpha * alpha_0 * ((alpha / alpha_0) ** 2 - 1.0))
        normal = C_Nalpha / (2.0 * alpha_0**2) * alpha * (alpha**2 - alpha_0**2)
        A_z = -q_area * (normal + C_Nalphadot * turn)
        m_C = dry + air
        mass, arm = m_C + m_L, L * m_C / (m_C + m_L)
        turning = -(air * g * s - A_z) / (m_C * L)
        v_rate = (-A_x * s - A_z * c) / mass - arm * (-turning * c + turn**2 * s)
        w_rate = ((m_L + dry) * g - A_x * c + A_z * s) / mass - arm * (turning * s + turn**2 * c)
        return jnp.stack([turn, turning, v_rate, w_rate])

    made = diffrax.diffeqsolve(
        diffrax.ODETerm(rate), diffrax.Tsit5(), times[0], times[-1], 0.5, start, saveat=diffrax.SaveAt(ts=times),
        adjoint=diffrax.ForwardMode(), max_steps=4096, throw=False,
    )  # fmt: skip
    return made.ys[:, jnp.array([0, 2, 3])]


def parts(x):
    """Coefficients, start, noise and its correlation of unknowns in prior standard deviations."""
    theta, start = centre + width * x[:5], jnp.asarray(problem.start) + jnp.asarray(problem.start_sd) * x[5:9]
    return theta, start, jnp.asarray(problem.noise) * jnp.exp(problem.noise_log_sd * x[9:12]), normal_cdf(x[12:])


def model():
    """Priors and likelihood."""
    x = numpyro.sample("x", dist.Normal(jnp.zeros(15 if ar1 else 12), 1.0))
    theta, start, sigma, rho = parts(x)
    mean = simulate(theta, start, record, problem.body)
    if ar1:
        later = mean[1:] + rho * (data[:-1] - mean[:-1])
        numpyro.sample("first", dist.Normal(mean[0], sigma), obs=data[0])
        numpyro.sample("later", dist.Normal(later, sigma * jnp.sqrt(1.0 - rho**2)), obs=data[1:])
    else:
        numpyro.sample("all", dist.Normal(mean, sigma), obs=data)


def residuals(x, seen):
    """For the start, by the medians of the noise."""
    theta, start, sigma, _ = parts(jnp.concatenate([x, jnp.zeros(3)]))
    made = simulate(theta, start, record, problem.body)
    return jnp.concatenate([(seen[:, None] * (data - made) / sigma).ravel(), x])


x, value, slope = np.zeros(9), jax.jit(residuals), jax.jit(jax.jacfwd(residuals))
for share in (0.15, 0.3, 0.6, 1.0):  # of the record, longer and longer: a whole swing has many optima
    seen = 1.0 * (np.arange(len(data)) < share * len(data))
    best = least_squares(value, x, slope, max_nfev=50, args=(seen,))
    x = best.x
spread = np.asarray(best.fun[:-9]).reshape(data.shape).std(axis=0)
free = 0.05 * np.eye(15 if ar1 else 12)
free[:9, :9] = np.linalg.inv(best.jac.T @ best.jac) * spread.mean() ** 2
first = np.concatenate([best.x, np.log(spread) / problem.noise_log_sd, np.ones(3 * ar1)])
numpyro.enable_validation(False)
kernel = NUTS(model, init_strategy=init_to_value(values={"x": first}), dense_mass=True, inverse_mass_matrix=free,
              max_tree_depth=5, forward_mode_differentiation=True)  # fmt: skip
mcmc = MCMC(kernel, num_warmup=100, num_samples=50, num_chains=2, chain_method="vectorized", progress_bar=False)
mcmc.run(jax.random.key(problem.seed))
drawn = [mcmc.get_samples(group_by_chain=True)["x"]]
block = 50 * 31 * 0.004  # processor seconds at the deepest trees
while exchange.rhat(np.concatenate(drawn, axis=1)) > exchange.WANTED and exchange.left(problem.limit) > block + 3.0:
    mcmc.post_warmup_state = mcmc.last_state
    mcmc.run(mcmc.post_warmup_state.rng_key)
    drawn.append(mcmc.get_samples(group_by_chain=True)["x"])
x = np.concatenate(drawn, axis=1)
chains, used = centre + width * x[:, :, :5], exchange.thinned(x)

sigma = np.array(problem.noise) * np.exp(problem.noise_log_sd * used[:, 9:12])
fly = jax.jit(jax.vmap(lambda p: simulate(p, jnp.asarray(problem.next_start), problem.next, problem.next_body)))
made = np.asarray(fly(centre + width * used[:, :5]))
exchange.write(
    problem, ("numpyro", "diffrax", "jax", "numpy"), names, chains,
    {"swing_angle": made[:, :, 0], "descent_rate": made[:, :, 2]},
    {"swing_angle": sigma[:, 0], "descent_rate": sigma[:, 2]}, f"{x.shape[1]} draws of 2 chains",
)  # fmt: skip
