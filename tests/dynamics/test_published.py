"""Published sets as flown: planar coefficients, and the polar set as a force law of the cluster."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.aero.published import load_published
from bayeschute.air.vector import Vec3
from bayeschute.dynamics.cluster import Air, canopy_flow, canopy_force, geometry
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.planar import PlanarAero
from bayeschute.dynamics.published import planar_aero, polar_law
from bayeschute.dynamics.state import unpack
from bayeschute.errors import InputError
from bayeschute.units import to_si

_spec = importlib.util.spec_from_file_location(
    "small_cluster", Path(__file__).parents[1] / "twins" / "small_cluster.py"
)
small = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(small)

STILL = Vec3(0.0, 0.0, 0.0)


def test_planar_set():
    assert planar_aero(load_published("table-7.1-2")) == PlanarAero(0.927, -0.329, 0.189, 0.1901, -0.988)


def test_sets_are_not_mixed_up():
    with pytest.raises(InputError, match="got a polar set; wanted a planar set"):
        planar_aero(load_published("table-7.3-1"))
    with pytest.raises(InputError, match="got a planar set; wanted a polar set"):
        polar_law(load_published("table-7.1-2"))


def force_on(reading, density=1.1):
    """Force on two canopies in a general state, their flow, and the numbers they need."""
    law, axial, transverse = polar_law(load_published("table-7.3-1", reading))
    structure = Structure(law.axial, law.side + law.normal, 2, "riser", law)
    model = small.cluster(axial, transverse)
    rng = np.random.default_rng(4)
    x = np.concatenate([np.zeros(3), [1.0, 0.5, 10.0], small.UPRIGHT, np.zeros(3)])
    canopies = np.array([[8.0, -9.0], [3.0, -2.0], [-71.0, -70.5]])
    x = jnp.asarray(
        np.concatenate([x, canopies.ravel(), (np.array([[0.0], [0.0], [10.0]]) + rng.normal(0, 2, (3, 2))).ravel()])
    )
    air = Air(STILL, STILL, density, 1.0, STILL)
    state = unpack(x, 2)
    geo = geometry(state, model.capsule)
    flow = canopy_flow(state, geo, model, structure, air)
    return canopy_force(flow, geo, model, structure, air), flow, model


def test_law_is_the_table_evaluated_by_hand():
    force, flow, model = force_on("as_printed")
    psf, q = to_si("1 psf", "Pa"), np.asarray(flow.q)
    stack = lambda v: np.stack([np.asarray(c) for c in (v.x, v.y, v.z)])  # noqa: E731
    axis, e, r, away = stack(flow.axis), stack(flow.e), stack(flow.rate), stack(flow.neighbours[0].away)
    k = e / np.linalg.norm(e, axis=0)
    j = np.cross(k.T, axis.T).T
    D = np.asarray(flow.neighbours[0].distance)
    near, c = np.maximum(0.8 - D, 0.0), away / np.linalg.norm(away, axis=0)
    cosine, sine = (c * k).sum(0), (c * j).sum(0)
    alpha = np.arctan2(np.linalg.norm(e, axis=0), np.asarray(flow.cos_alpha))
    alpha_rate, azimuth_rate = (r * k).sum(0) / np.cos(alpha), (r * j).sum(0)
    C_A = -1.9577 + 0.9297 * q / psf - 2.2803 * np.asarray(flow.speed_ratio) ** 2
    C_Y = (0.2007 - 0.2544 * q / psf + 0.3701 * D) * azimuth_rate
    C_Y += (-0.0382 * D + 0.5407 * near - 0.0834 * alpha_rate) * sine
    C_N = 0.3630 * alpha_rate - 0.0964 * alpha + 0.1030 * near * cosine
    want = q * model.canopies.area * (-C_A * axis + C_Y * j - C_N * k)
    np.testing.assert_allclose(stack(force), want, rtol=1e-9, atol=1e-6)
    assert near.min() > 0.0


def test_readings_agree_on_the_side_force_only():
    (printed, flow, _), (conventional, _, _) = force_on("as_printed"), force_on("conventional")
    stack = lambda v: np.stack([np.asarray(c) for c in (v.x, v.y, v.z)])  # noqa: E731
    total = stack(printed) + stack(conventional)  # only twice the side force is left
    side = np.cross(stack(flow.e).T, stack(flow.axis).T).T
    side /= np.linalg.norm(side, axis=0)
    np.testing.assert_allclose(total, side * (total * side).sum(0), atol=1e-6)
    assert np.abs(total).max() > 100.0
    drag = [(stack(f) * stack(flow.axis)).sum(0) for f in (printed, conventional)]
    assert (drag[0] > 0.0).all() and (drag[1] < 0.0).all()  # the axis points towards the payload


def test_printed_drag_does_not_hold_the_descent_rate():
    """C_A falls with q so fast that drag does, too, above 1.05 psf: 97 % of that row restates W = 2 q S C_A."""
    c = load_published("table-7.3-1").of("C_A")
    q = np.linspace(0.8, 1.5, 71) * to_si("1 psf", "Pa")
    drag = q * (c["1"] + c["q"] * q)
    assert q[drag.argmax()] == pytest.approx(1.05 * to_si("1 psf", "Pa"), abs=0.5)
    assert (np.diff(drag)[q[1:] > 51.0] < 0.0).all()


def test_laws_are_equal_by_their_terms():
    """One compilation serves all readings."""
    first, second = (polar_law(load_published("table-7.3-1", r))[0] for r in ("conventional", "as_printed"))
    assert first == second and hash(first) == hash(second)
