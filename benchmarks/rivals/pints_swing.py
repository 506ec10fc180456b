"""Planar dumbbell by PINTS: white residuals, adaptive covariance MCMC, odeint."""

import math
import sys
import time

import exchange
import numpy as np
import pints
from scipy.integrate import odeint

ar1 = "--ar1" in sys.argv
problem = exchange.read()
names, (centre, width) = list(problem.priors), np.array(list(problem.priors.values())).T
record = problem.record
data = np.stack([record["swing_angle"], record["along"], record["down"]], axis=1)
middle, scale = np.append(centre, problem.start), np.append(width, problem.start_sd)


class Dumbbell(pints.ForwardModel):
    """Five coefficients and four numbers of the start to swing angle and velocity of the capsule."""

    def __init__(self, table, body):
        self.table, self.body = table, body

    def n_parameters(self):
        return 9

    def n_outputs(self):
        return 3

    def simulate(self, parameters, times):
        C_A0, C_Aalpha, alpha_0, C_Nalpha, C_Nalphadot, angle_0, turn_0, v_0, w_0 = map(float, parameters)
        body, table = self.body, self.table
        m_L, L, g, area, dry = (body[k] for k in ("capsule_mass", "length", "gravity", "area", "dry_mass"))
        rows = np.stack([table[k] for k in ("wind_along", "wind_down", "density")], axis=1).tolist()
        dt, last = times[1] - times[0], len(rows) - 2

        def rate(x, t):
            angle, turn, v, w = x
            i = min(max(int(t / dt), 0), last)
            share = t / dt - i
            wind_v, wind_w, rho = (a + share * (b - a) for a, b in zip(rows[i], rows[i + 1], strict=True))
            s, c = math.sin(angle), math.cos(angle)
            a, d, air = v - wind_v, w - wind_w, rho * body["enclosed_volume"]
            axial, side = a * s + d * c, -a * c + d * s + L * turn
            alpha, q_area = math.atan2(side, axial), 0.5 * rho * area * (axial**2 + side**2)
            A_x = q_area * (C_A0 + 0.5 * C_Aalpha * alpha_0 * ((alpha / alpha_0) ** 2 - 1.0))
            normal = C_Nalpha / (2.0 * alpha_0**2) * alpha * (alpha**2 - alpha_0**2)
            A_z = -q_area * (normal + C_Nalphadot * turn)
            m_C = dry + air
            mass, arm = m_C + m_L, L * m_C / (m_C + m_L)
            turning = -(air * g * s - A_z) / (m_C * L)
            v_rate = (-A_x * s - A_z * c) / mass - arm * (-turning * c + turn**2 * s)
            w_rate = ((m_L + dry) * g - A_x * c + A_z * s) / mass - arm * (turning * s + turn**2 * c)
            return turn, turning, v_rate, w_rate

        try:
            made = odeint(rate, (angle_0, turn_0, v_0, w_0), times, rtol=1e-4, atol=1e-5, hmax=2.0, mxstep=2000)
        except OverflowError:
            return np.full((len(times), 3), 1e6)
        return np.nan_to_num(made[:, [0, 2, 3]], nan=1e6, posinf=1e6, neginf=-1e6)


model = Dumbbell(record, problem.body)
series = pints.MultiOutputProblem(model, record["time"], data)
if ar1:
    likelihood = pints.AR1LogLikelihood(series)
    noise_priors = [
        p for m in problem.noise for p in (pints.UniformLogPrior(0, 1), pints.LogNormalLogPrior(math.log(m), 0.7))
    ]
    noise_0 = [x for m in problem.noise for x in (0.8, m)]
else:
    likelihood = pints.GaussianLogLikelihood(series)
    noise_priors = [pints.LogNormalLogPrior(math.log(m), problem.noise_log_sd) for m in problem.noise]
    noise_0 = problem.noise
of_parameters = [pints.GaussianLogPrior(m, s) for m, s in zip(middle, scale, strict=True)]
prior = pints.ComposedLogPrior(*of_parameters, *noise_priors)
posterior = pints.LogPosterior(likelihood, prior)
np.random.seed(problem.seed)
search = pints.OptimisationController(
    posterior, np.append(middle, noise_0), np.append(scale, np.abs(noise_0)) * 0.3, method=pints.CMAES
)
search.set_log_to_screen(False)
search.set_max_evaluations(int(0.25 * problem.limit / 0.008))
search.set_max_unchanged_iterations(60, 0.05)
best, _ = search.run()
begun = time.process_time()
model.simulate(best[:9], record["time"])
one = time.process_time() - begun
steps = min(int(0.9 * exchange.left(problem.limit - 3.0) / (3 * one)), 10000)
spread = np.append(scale, np.abs(noise_0)) * 0.02
starts = [best + spread * np.random.standard_normal(best.size) for _ in range(3)]
if ar1:
    for start in starts:
        start[9::2] = np.clip(start[9::2], 0.01, 0.99)
mcmc = pints.MCMCController(posterior, 3, starts, sigma0=(spread) ** 2, method=pints.HaarioBardenetACMC)
mcmc.set_log_to_screen(False)
mcmc.set_initial_phase_iterations(min(200, steps // 5))
mcmc.set_max_iterations(steps)
chains = mcmc.run()[:, steps // 2 :]

draws = exchange.thinned(chains)
following = Dumbbell(problem.next, problem.next_body)
made = np.array([following.simulate(np.append(x[:5], problem.next_start), problem.next["time"]) for x in draws])
sigma = draws[:, 10::2] if ar1 else draws[:, 9:]
exchange.write(
    problem, ("pints", "scipy", "numpy"), names, chains[:, :, :5],
    {"swing_angle": made[:, :, 0], "descent_rate": made[:, :, 2]},
    {"swing_angle": sigma[:, 0], "descent_rate": sigma[:, 2]}, f"{steps} steps of 3 chains",
)  # fmt: skip
