"""Descent of a point mass by aeroid: white residuals, its own ensemble sampler; the start is taken as known."""

import aeroid
import exchange
import jax.numpy as jnp
import numpy as np

problem = exchange.read()
((name, (centre, width)),) = problem.priors.items()


def descent(t, x, u, p):
    """Rate of the descent rate."""
    return jnp.array([problem.gravity - 0.5 * u[0] * jnp.exp(p[name]) * x[0] * jnp.abs(x[0])])


model = aeroid.Model(["descent_rate"], ["density"], {name: centre}, descent)
record = problem.record
data = aeroid.FlightData(record["time"], {key: record[key] for key in ("descent_rate", "density")})
start = [problem.start[1]]
fitted = aeroid.identify(model, data, [name], x0=start, gradient="jax")
steps = 2000
posterior = aeroid.infer(
    model, data, {name: aeroid.Normal(centre, width)}, noise={"descent_rate": aeroid.LogUniform(0.05, 5.0)},
    x0=start, initial=fitted, n_walkers=10, n_steps=steps, seed=problem.seed, backend="jax",
)  # fmt: skip

chains = posterior.samples.reshape(-1, 10, 2).swapaxes(0, 1)
x = exchange.thinned(chains)
air = problem.next["density"][:, None]
first = [problem.next_start[1]]
flown = [aeroid.simulate_rk4(model, problem.next["time"], air, first, {name: v}) for v in x[:100, 0]]
motion = np.array([one.states[:, 0] for one in flown])
sigma = {"descent_rate": x[:100, 1]}
note = f"{steps} steps of 10 walkers; prior of the noise log-uniform, it has no log-normal one"
exchange.write(problem, ("aeroid", "jax", "numpy"), [name], chains[:, :, :1], {"descent_rate": motion}, sigma, note)
