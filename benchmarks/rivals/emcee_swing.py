"""Planar dumbbell by emcee and SciPy: white residuals, all walkers in one call of solve_ivp."""

import emcee
import exchange
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

problem = exchange.read()
names, (centre, width) = list(problem.priors), np.array(list(problem.priors.values())).T
record, start_mean = problem.record, np.array(problem.start)
data = np.stack([record["swing_angle"], record["along"], record["down"]], axis=1)
start_sd = np.array(problem.start_sd)[:, None]
sizes = np.array(problem.noise)  # medians of the three residuals


def simulate(theta, start, table, body):
    """Swing angle and capsule velocity (T, 3, N) of coefficients (5, N) and starts (4, N)."""
    C_A0, C_Aalpha, alpha_0, C_Nalpha, C_Nalphadot = theta
    m_L, L, g, area = body["capsule_mass"], body["length"], body["gravity"], body["area"]
    times, wind_along, wind_down, density = (table[k] for k in ("time", "wind_along", "wind_down", "density"))

    def rate(t, x):
        v, w, angle, turn = x.reshape(4, -1)
        rho = np.interp(t, times, density)
        dry, air = body["dry_mass"], rho * body["enclosed_volume"]
        s, c = np.sin(angle), np.cos(angle)
        a, d = v - np.interp(t, times, wind_along), w - np.interp(t, times, wind_down)
        axial, side = a * s + d * c, -a * c + d * s + L * turn
        alpha, q_area = np.arctan2(side, axial), 0.5 * rho * area * (axial**2 + side**2)
        A_x = q_area * (C_A0 + 0.5 * C_Aalpha * alpha_0 * ((alpha / alpha_0) ** 2 - 1.0))
        normal = C_Nalpha / (2.0 * alpha_0**2) * alpha * (alpha**2 - alpha_0**2)
        A_z = -q_area * (normal + C_Nalphadot * turn)
        m_C = dry + air
        mass, arm = m_C + m_L, L * m_C / (m_C + m_L)
        turning = -(air * g * s - A_z) / (m_C * L)
        v_rate = (-A_x * s - A_z * c) / mass - arm * (-turning * c + turn**2 * s)
        w_rate = ((m_L + dry) * g - A_x * c + A_z * s) / mass - arm * (turning * s + turn**2 * c)
        return np.concatenate([v_rate, w_rate, turn, turning])

    first = np.stack([start[2], start[3], start[0], start[1]])
    made = solve_ivp(rate, times[[0, -1]], first.ravel(), t_eval=times, rtol=1e-4, atol=1e-4, max_step=2.0)
    if not made.success:
        return np.full((times.size, 3, first.shape[1]), np.nan)
    return made.y.reshape(4, -1, times.size)[[2, 0, 1]].transpose(2, 0, 1)


def log_density(x):
    """Of unknowns (N, 12), in prior standard deviations: coefficients, start, logarithms of the noise."""
    theta, start = (
        centre[:, None] + width[:, None] * x[:, :5].T,
        start_mean[:, None] + start_sd * x[:, 5:9].T,
    )
    sigma = sizes[:, None] * np.exp(problem.noise_log_sd * x[:, 9:].T)
    with np.errstate(all="ignore"):
        residual = (data[:, :, None] - simulate(theta, start, record, problem.body)) / sigma
    value = -0.5 * (x**2).sum(axis=1) - 0.5 * (residual**2).sum(axis=(0, 1)) - len(data) * np.log(sigma).sum(axis=0)
    return np.where(np.isfinite(value), value, -np.inf)


def residuals(x, seen):
    """For the start (M, N), by the medians of the noise, of coefficients and start (N, 9)."""
    theta, start = centre[:, None] + width[:, None] * x[:, :5].T, start_mean[:, None] + start_sd * x[:, 5:].T
    made = (data[:, :, None] - simulate(theta, start, record, problem.body)) / sizes[:, None]
    return np.concatenate([made[:seen].reshape(-1, len(x)), x.T])


def value(x, seen):
    return residuals(x[None], seen)[:, 0]


def slope(x, seen):
    made = residuals(np.concatenate([x + 1e-3 * np.eye(9), x - 1e-3 * np.eye(9)]), seen)
    return (made[:, :9] - made[:, 9:]) / 2e-3


x = np.zeros(9)
for share in (0.15, 0.3, 0.6, 1.0):  # of the record, longer and longer: a whole swing has many optima
    best = least_squares(value, x, slope, max_nfev=30, args=(int(share * len(data)),))
    x = best.x
noise = np.log(best.fun[:-9].reshape(data.shape).std(axis=0)) / problem.noise_log_sd
spread = np.linalg.cholesky(np.linalg.inv(best.jac.T @ best.jac)) * np.exp(problem.noise_log_sd * noise.mean())
rng = np.random.default_rng(problem.seed)
walkers = 32
begin = np.concatenate(
    [best.x + 0.1 * rng.standard_normal((walkers, 9)) @ spread.T, noise + 0.03 * rng.standard_normal((walkers, 3))],
    axis=1,
)
sampler = emcee.EnsembleSampler(
    walkers, 12, log_density, vectorize=True, moves=[(emcee.moves.DEMove(), 0.9), (emcee.moves.StretchMove(), 0.1)]
)
state = emcee.State(begin)
while exchange.left(problem.limit) > 5.0:
    state = sampler.run_mcmc(state, 50)
    chains = sampler.get_chain()[sampler.iteration // 3 :].swapaxes(0, 1)
    if sampler.iteration >= 300 and exchange.rhat(chains) < exchange.WANTED:
        break

x = exchange.thinned(chains)
theta = centre[:, None] + width[:, None] * x[:, :5].T
made = simulate(
    theta, np.repeat(np.array(problem.next_start)[:, None], len(x), axis=1), problem.next, problem.next_body
)
sigma = sizes * np.exp(problem.noise_log_sd * x[:, 9:])
exchange.write(
    problem, ("emcee", "scipy", "numpy"), names, centre + width * chains[:, :, :5],
    {"swing_angle": made[:, 0].T, "descent_rate": made[:, 2].T},
    {"swing_angle": sigma[:, 0], "descent_rate": sigma[:, 2]}, f"{sampler.iteration} steps of {walkers} walkers",
)  # fmt: skip
