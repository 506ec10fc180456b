"""Force laws in place of the terms: the default is untouched, each law is what its words say."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest
from tests.twins import small_cluster

from bayeschute.core.vectors import Vec3
from bayeschute.dynamics import forces
from bayeschute.dynamics.cluster import Air, canopy_flow, canopy_force, geometry, state_rate
from bayeschute.dynamics.cluster_flight import with_parameters
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.state import unpack

small = small_cluster
ZERO = Vec3(0.0, 0.0, 0.0)
AIR = Air(Vec3(2.0, -1.0, 0.5), ZERO, 1.1, np.array([0.95, 1.05]), ZERO)


def state(seed=1):
    rng = np.random.default_rng(seed)
    lines = np.array([[0.2, -0.25], [0.1, 0.05], [-1.0, -0.95]]) * 74.0
    x = np.concatenate([rng.normal(size=3), [0.5, 0.2, 10.0], small.UPRIGHT, 0.1 * rng.normal(size=3)])
    moving = np.array([[1.0], [0.5], [10.0]]) + 2.0 * rng.normal(size=(3, 2))
    return np.concatenate([x, lines.ravel(), moving.ravel()])


def force_of(law, axial, transverse):
    x, structure = unpack(state(), 2), Structure((), (), force=law)
    model = replace(small.cluster((), ()), axial=axial, transverse=transverse)
    geo = geometry(x, model.capsule)
    flow = canopy_flow(x, geo, model, structure, AIR)
    return canopy_force(flow, geo, model, structure, AIR), flow, model


def test_drag_is_against_the_airflow_and_breathes():
    force, flow, model = force_of(forces.drag, (0.8,), ())
    v = np.asarray(unpack(state(), 2).canopy_velocity.stack()) - np.array([[2.0], [-1.0], [0.5]])
    speed = np.linalg.norm(v, axis=0)
    want = -0.5 * 1.1 * speed * v * model.canopies.area * 0.8 * np.array([0.95, 1.05])
    np.testing.assert_allclose(force.stack(), want, rtol=1e-10)


def _pushed(push, axial=(0.9,), transverse=(-0.1, 0.3)):
    """Force on the canopies under terms and a push north and east (2, canopy), and the flow."""
    x, structure = unpack(state(), 2), Structure(("1",), ("e", "rate"), 2)
    model = small.cluster(axial, transverse)
    air = AIR if push is None else replace(AIR, push=tuple(np.asarray(push)))
    geo = geometry(x, model.capsule)
    flow = canopy_flow(x, geo, model, structure, air)
    return np.asarray(canopy_force(flow, geo, model, structure, air).stack()), flow, model


def test_a_push_is_the_part_of_itself_across_the_riser():
    """q S times what of it lies across the canopy's axis, beside all terms, each canopy its own."""
    push = np.array([[0.03, -0.05], [0.02, 0.04]])
    (force, flow, model), (plain, _, _) = _pushed(push), _pushed(None)
    axis = np.asarray(flow.axis.stack())
    whole = np.concatenate([push, np.zeros((1, 2))])
    across = whole - axis * np.sum(axis * whole, axis=0)
    want = np.asarray(flow.q) * model.canopies.area * across
    np.testing.assert_allclose(force - plain, want, rtol=1e-9, atol=1e-9 * np.abs(plain).max())
    np.testing.assert_allclose(np.sum((force - plain) * axis, axis=0), 0.0, atol=1e-9 * np.abs(plain).max())
    assert np.abs(np.sum(axis * whole, axis=0)).min() > 1e-3  # it does not lie across as it is


def test_a_push_of_nothing_and_one_along_the_riser_do_nothing():
    plain, flow, model = _pushed(None)
    np.testing.assert_array_equal(_pushed(np.zeros((2, 2)))[0], plain)
    lying = np.array([[0.8, 0.6], [0.6, -0.8]])  # risers that lie on the ground
    flow = replace(flow, axis=Vec3(*lying, np.zeros(2)))
    geo, structure = geometry(unpack(state(), 2), model.capsule), Structure(("1",), ("e", "rate"), 2)
    still, along, across = (
        np.asarray(canopy_force(flow, geo, model, structure, replace(AIR, push=tuple(push))).stack())
        for push in (0.0 * lying, 0.05 * lying, 0.05 * np.array([-lying[1], lying[0]]))
    )
    np.testing.assert_allclose(along, still, rtol=1e-9, atol=1e-9 * np.abs(still).max())
    assert np.abs(across - still).max() > 0.02 * np.asarray(flow.q).max() * model.canopies.area


@pytest.mark.parametrize("rate", ["riser", "airflow"])
def test_a_push_accelerates_its_canopy_alone(rate):
    x, structure, model = state(), Structure(("1",), ("e", "rate"), 2, rate), small.cluster((0.9,), (-0.1, 0.3))
    pushed = replace(AIR, push=(np.array([0.0, 0.05]), np.zeros(2)))
    change = np.asarray(state_rate(x, model, structure, pushed)) - np.asarray(state_rate(x, model, structure, AIR))
    moved = np.abs(change) > 1e-9
    assert np.flatnonzero(moved).tolist() == [20, 22, 24]  # the second canopy's velocity: (axis, canopy)
    assert change[20] > 0.0


@pytest.mark.parametrize("rate", ["riser", "airflow"])
def test_a_roll_accelerates_the_capsule_about_its_long_axis_alone(rate):
    """By so many times gravity over the risers' length, whatever the capsule's inertia."""
    x, structure, model = state(), Structure(("1",), ("e", "rate"), 2, rate), small.cluster((0.9,), (-0.1, 0.3))
    skew = replace(model, capsule=replace(model.capsule, products=Vec3(3e3, -5e3, 4e3)))
    for one in (model, skew):
        plain, rolled = (np.asarray(state_rate(x, one, structure, replace(AIR, roll=r))) for r in (None, 0.3))
        assert np.flatnonzero(rolled != plain).tolist() == [10]
        assert rolled[10] - plain[10] == pytest.approx(0.3 * 9.80665 / 71.3, rel=1e-9)
        np.testing.assert_array_equal(state_rate(x, one, structure, replace(AIR, roll=0.0)), plain)


def test_polar_laws_have_their_signs_in_the_wind_frame():
    force, flow, model = force_of(forces.constant_polar, (0.9,), (0.2, 0.3))
    x, F = np.asarray(flow.axis.stack()), np.asarray(force.stack()) / (np.asarray(flow.q) * model.canopies.area)
    z = np.asarray(flow.e.stack())
    z = z / np.linalg.norm(z, axis=0)
    np.testing.assert_allclose((F * x).sum(axis=0), -0.9 * np.array([0.95, 1.05]), rtol=1e-10)
    np.testing.assert_allclose((F * z).sum(axis=0), -0.3, rtol=1e-10)
    np.testing.assert_allclose((F * np.cross(z.T, x.T).T).sum(axis=0), 0.2, rtol=1e-10)


def test_pitch_plane_restores_beyond_its_trim_angle_and_drives_within():
    for alpha_0, sign in ((0.02, -1.0), (1.0, 1.0)):
        force, flow, _ = force_of(forces.pitch_plane, (0.927, -0.329, alpha_0), (0.19, 0.0))
        along = np.asarray(force.x * flow.e.x + force.y * flow.e.y + force.z * flow.e.z)
        assert (np.sign(along) == sign).all()


@pytest.mark.parametrize("rate", ["riser", "airflow"])
def test_a_law_replaces_the_terms_and_nothing_else(rate):
    terms, model = Structure(("1", "alpha^2"), ("e", "rate"), 2, rate), small.cluster((0.9, -0.7), (0.1, 0.3))
    assert terms.force is None

    def like_the_terms(flow, geo, model, air):
        return canopy_force(flow, geo, model, terms, air)

    plain = np.asarray(state_rate(state(), model, terms, AIR))
    law = state_rate(state(), model, replace(terms, force=like_the_terms), AIR)
    np.testing.assert_array_equal(plain, law)
    drag = np.asarray(state_rate(state(), replace(model, axial=(0.9,)), replace(terms, force=forces.drag), AIR))
    np.testing.assert_array_equal(drag[:19], plain[:19])
    assert np.abs(drag - plain)[19:].max() > 0.1


def test_coefficients_of_a_law_are_parameters_with_names_and_gradients():
    structure = Structure(("C_D",), (), force=forces.drag)
    base = replace(small.cluster((), ()), axial=(0.0,))

    def sink(theta):
        model = with_parameters(base, structure, ("axial[C_D]",), theta)
        return state_rate(state(), model, structure, AIR)[23]

    slope = jax.grad(sink)(np.array([0.8]))
    assert float(slope[0]) == pytest.approx(float(sink(np.array([1.8])) - sink(np.array([0.8]))), rel=1e-9)
    assert hash(structure) != hash(replace(structure, force=None))


def test_canopies_far_beyond_the_angle_of_saturation_feel_its_powers_no_more():
    """With one power the law there is that with a constant in its place; far below nothing differs."""
    x, held = state(), 0.005
    model = small.cluster((0.9,), (0.5, 400.0))
    names = Structure(("1",), ("e", "e*alpha^2"), 2)
    made = np.asarray(state_rate(x, model, replace(names, saturation=held), AIR))
    line = small.cluster((0.9,), (0.5 + 400.0 * held**2, 0.0))
    beyond, free = (np.asarray(state_rate(x, one, names, AIR)) for one in (line, model))
    assert np.abs(made - free).max() > 1e-2
    np.testing.assert_allclose(made, beyond, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(state_rate(x, model, replace(names, saturation=3.0), AIR), free, rtol=1e-5, atol=1e-6)
