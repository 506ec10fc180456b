"""Descent of a point mass by PINTS: white residuals, or AR(1) with ``--ar1``; adaptive covariance MCMC, odeint."""

import math
import sys

import exchange
import numpy as np
import pints
from scipy.integrate import odeint

ar1 = "--ar1" in sys.argv
problem = exchange.read()
((name, (centre, width)),) = problem.priors.items()
record = problem.record


class Descent(pints.ForwardModel):
    """Log C_D S/m and the first descent rate to descent rates."""

    def __init__(self, table):
        self.times, self.density = table["time"], table["density"]

    def n_parameters(self):
        return 2

    def simulate(self, parameters, times):
        drag, speed = math.exp(parameters[0]), float(parameters[1])

        def rate(v, t):
            return problem.gravity - 0.5 * np.interp(t, self.times, self.density) * drag * v[0] * abs(v[0])

        return odeint(rate, [speed], times, rtol=1e-5, atol=1e-5)[:, 0]


series = pints.SingleOutputProblem(Descent(record), record["time"], record["descent_rate"])
priors = [pints.GaussianLogPrior(centre, width), pints.GaussianLogPrior(problem.start[1], problem.start_sd[1])]
first = [centre, problem.start[1], *([0.5] if ar1 else []), problem.noise[0]]
if ar1:
    priors.append(pints.UniformLogPrior(0.0, 1.0))
priors.append(pints.LogNormalLogPrior(math.log(problem.noise[0]), problem.noise_log_sd))
likelihood = pints.AR1LogLikelihood(series) if ar1 else pints.GaussianLogLikelihood(series)
posterior = pints.LogPosterior(likelihood, pints.ComposedLogPrior(*priors))
np.random.seed(problem.seed)
spread = np.array([0.05, 0.3, *([0.05] if ar1 else []), 0.03])
steps = 1500
while True:
    starts = [np.array(first) + spread * np.random.standard_normal(len(first)) for _ in range(3)]
    begun = exchange.left(problem.limit)
    mcmc = pints.MCMCController(posterior, 3, starts, sigma0=spread**2, method=pints.HaarioBardenetACMC)
    mcmc.set_log_to_screen(False)
    mcmc.set_max_iterations(steps)
    chains = mcmc.run()[:, steps // 3 :]
    took = begun - exchange.left(problem.limit)
    if exchange.rhat(chains) < exchange.WANTED or 2 * took > exchange.left(problem.limit):
        break
    first, steps = chains.reshape(-1, len(first)).mean(axis=0), 2 * steps

x = exchange.thinned(chains)
following = Descent(problem.next)
motion = np.array([following.simulate([one[0], problem.next_start[1]], problem.next["time"]) for one in x])
sigma = {"descent_rate": x[:, -1]}
note = f"{steps} steps of 3 chains"
exchange.write(problem, ("pints", "scipy", "numpy"), [name], chains[:, :, :1], {"descent_rate": motion}, sigma, note)
