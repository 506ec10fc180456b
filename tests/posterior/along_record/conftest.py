"""A linear flight on a broken path, and a short drop of two canopies with its optimum."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.dynamics.parameters import Structure
from bayeschute.likelihood.channels import cluster_data
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import NoiseParameters, latent_path_of, states
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.likelihood.record_path import RecordPath
from bayeschute.posterior import joint_mode as optimum
from bayeschute.records.sensors import SensorNoise
from bayeschute.virtual.drop import Turbulence, VirtualDrop, fly


def broken_path(flight, hyper, theta, u, seed=0, size=0.3):
    """The flight with the path of a simulation, broken at every sample, as what its record shows."""
    x = np.asarray(states(flight, jnp.asarray(theta), latent_path_of(flight, hyper, u)))
    path = x + size * np.random.default_rng(seed).standard_normal(x.shape)
    return replace(flight, path=RecordPath(path, np.full(x.shape[1], 0.1)))


@pytest.fixture(scope="module")
def broken(linear):
    return broken_path(linear.flight, linear.hyper, linear.theta, linear.u)


@pytest.fixture(scope="module")
def drop():
    """A short drop of two canopies in gusts, seen well, and its parameters."""
    white = {"canopy_position": 0.1, "capsule_velocity": 0.05, "capsule_attitude": 0.002}
    structure = Structure(("1", "alpha^2"), ("e", "rate"), 2, "riser")
    model = small.cluster((0.95, -0.8), (-0.1, 0.3))
    flight = VirtualDrop(
        duration=8.0, dt=0.1, altitude=1500.0, swing=0.2, swing_azimuth=0.5, flyout=0.15,
        turbulence=Turbulence(0.3, 0.2, 2.0), sensors={name: SensorNoise(sd) for name, sd in white.items()},
    )  # fmt: skip
    record, _ = fly(flight, model, structure, 0, small.SUBSTEPS)
    names, truth, sd = ("axial[1]", "transverse[e]", "transverse[rate]"), (0.95, -0.1, 0.3), (0.1, 0.2, 0.2)
    off = np.array([-0.05, 0.1, -0.1])
    priors = [Prior(n, x + d, s, False, "1", "") for n, x, d, s in zip(names, truth, off, sd, strict=True)]
    gusts = Latent(("drift", "drift"), ((0, 0), (1, 0), (2, 1)))
    data = cluster_data(record, model, structure, priors, tuple(white), gusts)
    noise = Noise(np.array(list(white.values())), 0.3 * np.array(list(white.values())), np.full(3, 1.0))
    hyper = NoiseParameters(noise, (np.array([0.3, 2.0]), np.array([0.2, 2.0])))
    return SimpleNamespace(flight=data, priors=priors, hyper=hyper, theta=np.array(truth))


@pytest.fixture(scope="module")
def shot(drop):
    """The optimum of the drop by single shooting from the truth."""
    return optimum.fit([drop.flight], drop.hyper, drop.priors, drop.theta, tolerance=1e-3)
