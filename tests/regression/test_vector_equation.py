"""Regressions of a canopy's force from vectors: turns of the earth's axes change nothing, coefficients come back."""

from __future__ import annotations

from collections import namedtuple

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from bayeschute.aero.terms import axial_coefficient, transverse_coefficient
from bayeschute.regression.vector_equation import _across, axial_problem, flow_along, transverse_problem

LENGTH, SPEED, CANOPIES, SAMPLES = 20.0, 8.0, 3, 40
AXIAL, TRANSVERSE = ("1", "alpha^2", "proximity(1)"), ("e", "e*alpha^2", "rate", "repulsion(1)", "side*e")

Flown = namedtuple("Flown", "record made")


def flown(turn=None):
    """Anything whatever along a record, turned as a whole."""
    rng = np.random.default_rng(0)

    def vectors(size=1.0, mean=(0.0, 0.0, 0.0)):
        x = np.asarray(mean) + size * rng.standard_normal((SAMPLES, CANOPIES, 3))
        return x if turn is None else x @ turn.as_matrix().T

    def data(x):
        return xr.DataArray(x, dims=("time", "canopy", "axis")[: np.ndim(x)])

    direction = vectors(0.3, (0.0, 0.0, -1.0))
    direction /= np.linalg.norm(direction, axis=2, keepdims=True)
    spin = vectors(0.4)
    rate = spin - np.sum(spin * direction, axis=2, keepdims=True) * direction
    wind = vectors(2.0, (1.0, 0.0, 9.0))
    airspeed = np.linalg.norm(wind, axis=2)
    made = xr.Dataset(
        {
            "riser_direction": data(direction),
            "riser_direction_rate": data(rate),
            "air_velocity": data(wind),
            "airspeed": data(airspeed),
            "dynamic_pressure": data(0.55 * airspeed**2),
            "canopy_velocity": data(vectors(3.0)),
        }
    )
    return Flown(xr.Dataset({"canopy_position": data(vectors(9.0))}), made)


def flow_of(case):
    return flow_along(case.record, case.made, LENGTH, SPEED)


def stacked(v):
    return np.stack([np.asarray(c) for c in (v.x, v.y, v.z)], axis=-1)  # (canopy, T, 3)


def test_the_flow_is_that_of_its_definitions():
    case = flown()
    flow, made = flow_of(case), case.made
    n, air = made["riser_direction"].values, made["air_velocity"].values
    axes, across, rate = (stacked(v) for v in (flow.axis, flow.e, flow.rate))
    names = ("alpha_squared", "q", "q_ratio", "speed_ratio")
    squared, q, ratio, faster = (np.asarray(getattr(flow, name)) for name in names)
    for c in range(CANOPIES):
        for t in range(0, SAMPLES, 7):
            axis, speed = -n[t, c], np.linalg.norm(air[t, c])
            w = air[t, c] / speed
            cosine = w @ axis
            np.testing.assert_allclose(axes[c, t], axis)
            np.testing.assert_allclose(across[c, t], w - cosine * axis, atol=1e-12)
            turning = made["riser_direction_rate"].values[t, c] * cosine * LENGTH / (2.0 * speed)
            np.testing.assert_allclose(rate[c, t], turning, atol=1e-12)
            assert squared[c, t] == pytest.approx(np.arccos(cosine) ** 2)
            assert q[c, t] == pytest.approx(0.55 * speed**2)
            assert ratio[c, t] == pytest.approx(0.55 * speed**2 / (0.5 * 1.225 * SPEED**2))
            assert faster[c, t] == pytest.approx(speed / SPEED - 1.0)
    assert len(flow.neighbours) == CANOPIES - 1


def test_two_unit_vectors_across_the_axis_make_a_right_handed_system():
    axis = flow_of(flown()).axis
    first, second = _across(axis)
    x = np.moveaxis(stacked(axis), 2, 0)
    every = np.stack([x, first, second])
    np.testing.assert_allclose(np.einsum("ikct,jkct->ctij", every, every), np.broadcast_to(np.eye(3), (CANOPIES, SAMPLES, 3, 3)), atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(np.linalg.det(np.moveaxis(every, (2, 3), (0, 1))), 1.0)
    assert (first[0] > 0.0).all() and np.abs(second[0]).max() < 1e-12  # nearest to north


@pytest.mark.parametrize("canopy", range(CANOPIES))
def test_coefficients_come_back(canopy):
    case = flown()
    flow, rng = flow_of(case), np.random.default_rng(1)
    a, b = rng.standard_normal(len(AXIAL)), rng.standard_normal(len(TRANSVERSE))
    c_t = np.moveaxis(stacked(transverse_coefficient(TRANSVERSE, b, flow)), (0, 1, 2), (1, 0, 2))
    made = case.made.assign(
        C_A=(("time", "canopy"), np.asarray(axial_coefficient(AXIAL, a, flow)).T), c_t=(("time", "canopy", "axis"), c_t)
    )
    axial = axial_problem(AXIAL, flow, made, canopy)
    across = transverse_problem(TRANSVERSE, flow, made, canopy)
    assert axial.X.shape == (SAMPLES, 3) and across.X.shape == (2 * SAMPLES, 5)
    np.testing.assert_allclose(np.linalg.lstsq(axial.X, axial.z)[0], a, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.lstsq(across.X, across.z)[0], b, rtol=1e-9)
    np.testing.assert_allclose(axial.X @ a, axial.z, rtol=1e-9)
    assert across.components.tolist() == [0] * SAMPLES + [1] * SAMPLES and not across.groups.any()
    size = np.sum(across.z.reshape(2, SAMPLES) ** 2, axis=0)
    np.testing.assert_allclose(size, np.sum(c_t[:, canopy] ** 2, axis=1), rtol=1e-9)  # all of it is across


def test_turns_of_the_axes_change_nothing():
    """Terms are scalars and vectors: of the transverse ones any turn leaves the sums of products."""
    rng = np.random.default_rng(2)
    c_t, c_a = rng.standard_normal((SAMPLES, CANOPIES, 3)), rng.standard_normal((SAMPLES, CANOPIES))
    found = []
    for turn in (None, Rotation.random(random_state=3)):
        case = flown(turn)
        n = case.made["riser_direction"].values
        force = c_t if turn is None else c_t @ turn.as_matrix().T
        force = force - np.sum(force * n, axis=2, keepdims=True) * n
        made = case.made.assign(C_A=(("time", "canopy"), c_a), c_t=(("time", "canopy", "axis"), force))
        flow = flow_of(case)
        axial, across = axial_problem(AXIAL, flow, made, 1), transverse_problem(TRANSVERSE, flow, made, 1)
        found.append((axial.X, across.X.T @ across.X, across.X.T @ across.z))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-7, atol=1e-9)
