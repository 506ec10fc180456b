"""Planar dumbbell by bayeschute: latent gusts and wind error. The dumbbell has no door of its own: inner modules."""

from dataclasses import replace

import exchange
import jax.numpy as jnp
import numpy as np
import xarray as xr

from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.core.units import to_si
from bayeschute.dynamics.parameters import Canopies
from bayeschute.likelihood.disturbances import disturbances
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import sampler
from bayeschute.posterior.fit.laplace_fit import find
from bayeschute.posterior.noise_evidence import NoisePrior
from bayeschute.posterior.noise_uncertainty import widened
from bayeschute.reduced.dumbbell import Dumbbell
from bayeschute.reduced.dumbbell_data import WIND, dumbbell_data
from bayeschute.reduced.planar import PlanarAero

problem = exchange.read()
priors = [Prior(name, centre, width, False, "1", "given") for name, (centre, width) in problem.priors.items()]
aero = PlanarAero(*(p.centre for p in priors))
deg, ft = to_si("1 deg", "rad"), to_si("1 ft", "m")
sensors = Noise(np.array([0.12 * deg, 0.06]), np.array([0.2 * deg, 0.12]), np.array([2.0, 2.0]))
air = tuple(np.array([sd * ft, time]) for sd, time in ((2.0, 5.0), (1.0, 5.0), (1.0, 20.0), (1.0, 20.0)))


def flight(table, numbers, start=None):
    """Data of a flight; one that was not flown yet has a start alone."""
    canopies = Canopies(numbers["area"] / 2, 35.0, 10.0, numbers["dry_mass"] / 2, numbers["enclosed_volume"] / 2)
    body = Dumbbell(numbers["capsule_mass"], numbers["length"], canopies, numbers["gravity"])
    record = xr.Dataset(coords={"time": table["time"], "plane": ["along", "down"]})
    zero = np.zeros(table["time"].size)
    record["swing_angle"] = ("time", table.get("swing_angle", zero))
    for name, columns in (("capsule_velocity", ("along", "down")), ("wind", ("wind_along", "wind_down"))):
        record[name] = (("time", "plane"), np.stack([table.get(c, zero) for c in columns], axis=1))
    record["density"] = ("time", table["density"])
    made = dumbbell_data(record, body, aero, priors, WIND)
    if start is None:
        return made
    first = np.array([0.0, 0.0, start[2], start[3], start[0], start[1]])
    return replace(made, model=replace(made.model, start=first))


fitted = find([flight(problem.record, problem.body)], priors, NoisePrior(NoiseParameters(sensors, air)))
marginal = fitted.marginal
drawn = sampler.sample(marginal, "nuts", 4, 300, 500, problem.seed)
wide = widened(drawn.xi, fitted.noise_effect, fitted.noise_parameter_covariance, problem.seed)
chains = np.asarray(marginal.centre) + wide @ np.asarray(marginal.scale).T

theta = exchange.thinned(chains)
following = flight(problem.next, problem.next_body, problem.next_start)
rng = np.random.default_rng(problem.seed)
noise = jnp.asarray(rng.standard_normal((following.samples, following.latent.size, len(theta))))
error = disturbances(fitted.hyper.dynamics(following), noise)
states = np.asarray(trajectory_compiled(following.model, theta.T, np.zeros((4, len(theta))), np.asarray(error)))
motion = {"swing_angle": states[:, 4].T, "descent_rate": states[:, 3].T}
exchange.write(problem, ("jax", "numpy"), list(problem.priors), chains, motion, {}, "inner modules, no door")
