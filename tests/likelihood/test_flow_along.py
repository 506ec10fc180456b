"""Airflow and latent forces along a path: against the truth of a virtual drop, and row by row of the disturbances."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.core.vectors import dot
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.state import unpack
from bayeschute.likelihood.channels import cluster_data
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.flow_along import flow_along
from bayeschute.likelihood.joint import LatentPath, states
from bayeschute.likelihood.priors import Prior
from bayeschute.records.angles import across, unit
from bayeschute.records.sensors import SensorNoise
from bayeschute.virtual.drop import VirtualDrop, fly

FEW = Structure(("1", "alpha^2"), ("e", "rate"), 2, "riser")
MODEL = small.cluster((0.95, -0.8), (-0.1, 0.3))
DROP = VirtualDrop(
    duration=4.0, dt=0.1, altitude=1500.0, swing=0.2, swing_azimuth=0.5, flyout=0.15,
    sensors={name: SensorNoise(0.01) for name in ("canopy_position", "capsule_velocity")},
)  # fmt: skip
LATENT = Latent(("drift",), tuple((row, 0) for row in range(10)))  # wind, axial of two, transverse of two, roll


@pytest.fixture(scope="module")
def flight():
    record, _ = fly(DROP, MODEL, FEW, 0, small.SUBSTEPS)
    prior = Prior("axial[1]", 0.95, 0.1, False, "1", "")
    data = cluster_data(record, MODEL, FEW, [prior], ("canopy_position", "capsule_velocity"), LATENT)
    theta, error = np.array([0.95]), np.zeros((data.samples, 10))
    path = np.asarray(states(data, theta, LatentPath(np.zeros(data.starts), error)))
    return data, theta, path, error


def test_angles_and_distances_are_those_of_the_states(flight):
    data, theta, path, error = flight
    flow = flow_along(data, theta, path, error).flow
    assert flow.alpha_squared.shape == (2, len(path))
    place = np.asarray(unpack(jnp.asarray(path.T), 2).canopy_position.stack())
    apart = np.linalg.norm(place[:, 0] - place[:, 1], axis=0) / MODEL.canopies.length
    np.testing.assert_allclose(flow.neighbours[0].distance[0], apart, rtol=1e-9)
    cosine = np.sqrt(1.0 - np.asarray(dot(flow.e, flow.e)))
    np.testing.assert_allclose(flow.cos_alpha, cosine, rtol=1e-9)
    np.testing.assert_allclose(np.sqrt(flow.alpha_squared), np.arccos(cosine), atol=1e-7)


def test_a_fitted_error_of_the_wind_is_part_of_the_airflow(flight):
    data, theta, path, error = flight
    gust = error.copy()
    gust[:, 2] = -5.0  # air that rises by 5 m/s
    calm, risen = (flow_along(data, theta, path, e).flow for e in (error, gust))
    speed = (1.0 + calm.speed_ratio) * MODEL.canopies.speed, (1.0 + risen.speed_ratio) * MODEL.canopies.speed
    assert (speed[1] > speed[0] + 4.0).all()


def test_latent_forces_are_told_by_canopy_and_direction(flight):
    data, theta, path, error = flight
    pushed = error.copy()
    pushed[:, 4], pushed[:, 5], pushed[:, 8] = (
        0.03,
        0.2,
        -0.1,
    )  # axial of the second; north of the first; east of the second
    made = flow_along(data, theta, path, pushed)
    np.testing.assert_allclose(made.axial, np.repeat([[0.0], [0.03]], len(path), axis=1))
    axis = np.moveaxis(np.asarray(made.flow.axis.stack()), 0, -1)
    np.testing.assert_allclose(np.linalg.norm(axis, axis=-1), 1.0, rtol=1e-9)
    given = np.zeros((2, len(path), 3))
    given[0, :, 0], given[1, :, 1] = 0.2, -0.1
    np.testing.assert_allclose(
        np.moveaxis(np.asarray(made.transverse.stack()), 0, -1), across(given, unit(axis)), atol=1e-12
    )


def test_a_fit_without_latent_forces_has_none(flight):
    data, theta, path, error = flight
    made = flow_along(data, theta, path, error[:, :3])
    assert not made.axial.any() and not np.asarray(made.transverse.stack()).any()
