"""Descent of a point mass by emcee and SciPy: white residuals."""

import emcee
import exchange
import numpy as np
from scipy.integrate import solve_ivp

problem = exchange.read()
((name, (centre, width)),) = problem.priors.items()
record, (altitude_0, speed_0) = problem.record, problem.start


def simulate(drag, speed, table):
    """Descent rates (T, N) of C_D S/m and first descent rates (N,)."""
    times, density = table["time"], table["density"]

    def rate(t, v):
        return problem.gravity - 0.5 * np.interp(t, times, density) * drag * v * np.abs(v)

    return solve_ivp(rate, times[[0, -1]], speed, t_eval=times, rtol=1e-5, atol=1e-5).y.T


def log_density(x):
    """Of unknowns (N, 3), in prior standard deviations: log drag, first descent rate, log noise."""
    sigma = problem.noise[0] * np.exp(problem.noise_log_sd * x[:, 2])
    made = simulate(np.exp(centre + width * x[:, 0]), speed_0 + problem.start_sd[1] * x[:, 1], record)
    residual = (record["descent_rate"][:, None] - made) / sigma
    return -0.5 * (x**2).sum(axis=1) - 0.5 * (residual**2).sum(axis=0) - len(residual) * np.log(sigma)


walkers = 32
state = emcee.State(0.1 * np.random.default_rng(problem.seed).standard_normal((walkers, 3)))
sampler = emcee.EnsembleSampler(walkers, 3, log_density, vectorize=True)
while exchange.left(problem.limit) > 2.0:
    state = sampler.run_mcmc(state, 100)
    chains = sampler.get_chain()[sampler.iteration // 3 :].swapaxes(0, 1)
    if sampler.iteration >= 300 and exchange.rhat(chains) < exchange.WANTED:
        break

x = exchange.thinned(chains)
first = np.full(len(x), problem.next_start[1])
motion = simulate(np.exp(centre + width * x[:, 0]), first, problem.next).T
sigma = problem.noise[0] * np.exp(problem.noise_log_sd * x[:, 2])
note = f"{sampler.iteration} steps of {walkers} walkers"
log_drag = centre + width * chains[:, :, :1]
versions = ("emcee", "scipy", "numpy")
exchange.write(problem, versions, [name], log_drag, {"descent_rate": motion}, {"descent_rate": sigma}, note)
