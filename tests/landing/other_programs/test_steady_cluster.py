"""The steady cluster: closed forms, the equations of motion at rest, flights by the simulator, the table of one canopy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.landing.plans import single

from bayeschute.atmosphere.standard import SEA_LEVEL_DENSITY
from bayeschute.core.errors import InputError
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster import state_rate
from bayeschute.dynamics.cluster_flight import with_parameters
from bayeschute.dynamics.initial_state import Start, initial_state, tangent_basis
from bayeschute.dynamics.parameters import STANDARD_GRAVITY
from bayeschute.dynamics.state import unpack
from bayeschute.landing.aero_table import aero_table
from bayeschute.landing.campaign_plan import flight_model
from bayeschute.landing.landing_model import flown, rows
from bayeschute.landing.other_programs import steady_cluster
from bayeschute.landing.other_programs.steady_cluster import cluster_coefficients, steady_clusters


@pytest.fixture(scope="module")
def steady(plan):
    return steady_clusters(plan.models)


def placed(one, draw, steady):
    """State of a draw's steady descent as the simulator starts one, its numbers, and still air."""
    n, phi = one.structure.canopies, steady.flyout[draw]
    turns = 2.0 * np.pi * np.arange(n) / n
    direction = np.stack([np.sin(phi) * np.cos(turns), np.sin(phi) * np.sin(turns), -np.cos(phi) + 0.0 * turns])
    numbers = with_parameters(one.base, one.structure, one.names, one.theta[draw])
    up = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
    start = Start(np.zeros(3), np.array([0.0, 0.0, steady.speed[draw]]), up, np.zeros(3), direction, np.zeros((3, n)))
    air = steady_cluster._air(SEA_LEVEL_DENSITY)
    x = initial_state(start, tangent_basis(direction), np.zeros(9 + 4 * n), numbers, one.structure, air)
    return x, numbers, air


def on_axis(plan):
    """Draws of a capsule that hangs from a point on its axis, so that it doesn't tilt."""
    (one,) = plan.models
    capsule = one.base.capsule
    b = capsule.attach_b
    return replace(one, base=replace(one.base, capsule=replace(capsule, attach_b=Vec3(b.x, 0.0, 0.0))))


def test_one_canopy_falls_at_the_terminal_speed(plan):
    one = single(plan.models[0])
    made = steady_clusters([one])
    assert (made.flyout == 0.0).all()
    np.testing.assert_allclose(made.canopy_drag_area, one.base.canopies.area * one.theta[:, 0], rtol=1e-12)
    weight = (one.base.capsule.mass + one.base.canopies.dry_mass) * STANDARD_GRAVITY
    np.testing.assert_allclose(made.speed, np.sqrt(2.0 * weight / (SEA_LEVEL_DENSITY * made.drag_area)), rtol=1e-12)


@pytest.mark.parametrize(("steeper", "near"), [(1.0, False), (3.0, True)])
def test_two_canopies_balance_by_hand(plan, steeper, near):
    """C_A(phi), C_N(phi) and the push between canopies resolved along and across a riser by hand."""
    theta = plan.models[0].theta.copy()
    theta[:, 3] *= steeper  # C_N restores from a smaller angle on: the canopies stand closer
    one = replace(plan.models[0], theta=theta)
    steady = steady_clusters([one])
    c, phi = dict(zip(one.names, one.theta.T, strict=True)), steady.flyout
    sin, cos, base = np.sin(phi), np.cos(phi), one.base
    axial = c["axial[1]"] + c["axial[alpha^2]"] * phi**2
    normal = (c["transverse[e]"] + c["transverse[e*alpha^2]"] * phi**2) * sin
    apart = 2.0 * steady.reach * np.tan(phi) / base.canopies.length
    push = c["transverse[repulsion(0.8)]"] * np.maximum(0.8 - apart, 0.0) * cos
    load = 0.5 * SEA_LEVEL_DENSITY * steady.speed**2 * base.canopies.area
    drag = 2.0 * base.canopies.area * (axial * cos + (normal - push) * sin)
    np.testing.assert_allclose(steady.canopy_drag_area, drag, rtol=1e-12)
    across = base.canopies.dry_mass * STANDARD_GRAVITY * sin + load * (push - normal)
    np.testing.assert_allclose(across / load, 0.0, atol=1e-9)
    assert (push > 0.0).all() if near else (push == 0.0).all()


def test_the_equations_of_motion_are_at_rest_there(plan):
    one = on_axis(plan)
    steady = steady_clusters([one])
    for draw in (0, 7):
        x, numbers, air = placed(one, draw, steady)
        rate = unpack(np.asarray(state_rate(x, numbers, one.structure, air)), 2)
        for acceleration in (rate.velocity, rate.canopy_velocity):
            np.testing.assert_allclose(acceleration.stack(), 0.0, atol=1e-6)


def test_the_simulator_descends_at_that_speed(plan):
    """Twenty seconds of the landings' own model from 700 m, against sqrt(2 m g/(rho cd_s)) where they end: to 0.5 %."""
    one = on_axis(plan)
    steady = steady_clusters([one])
    model = flight_model(replace(plan, models=(one,)), 0)
    x = np.stack([placed(one, draw, steady)[0] for draw in range(12)], axis=1)
    x[[2, 17, 18]] -= 700.0  # down: of the capsule and of both canopies
    for _ in range(20):
        x = flown(model, one.theta.T, x, np.zeros((6, rows(2), 12)))[-1]
    rho = np.asarray(model.density_at(-x[17:19])).mean(axis=0)
    terminal = np.sqrt(2.0 * steady.mass * steady.gravity / (rho * steady.drag_area))
    np.testing.assert_allclose(x[5], terminal, rtol=5e-3)


def test_canopies_without_fly_out_have_the_table_of_one(plan):
    (one,) = plan.models
    table = aero_table(one)
    made = cluster_coefficients(one, np.zeros(12), np.full(12, one.base.canopies.speed))
    for values, column in zip(made, ("C_A_1", "C_N_1", "C_N_rate_1"), strict=True):
        np.testing.assert_allclose(values.T.ravel(), table[column], atol=1e-12)
    np.testing.assert_allclose(cluster_coefficients(single(one), np.zeros(12), np.full(12, 9.0)), made, atol=1e-12)


def test_along_the_axis_the_coefficients_are_those_of_the_descent(plan, steady):
    made = cluster_coefficients(plan.models[0], steady.flyout, steady.speed, np.array([0.0, 0.2]))
    np.testing.assert_allclose(made[0, 0], steady.canopy_drag_area / steady.area, rtol=1e-12)
    np.testing.assert_allclose(made[1, 0], 0.0, atol=1e-12)
    assert (made[0, 0] < aero_table(plan.models[0], angles=np.zeros(1))["C_A_1"]).all()  # fly-out costs drag here


def test_draws_in_parts_are_those_at_once(plan, steady, monkeypatch):
    whole = cluster_coefficients(plan.models[0], steady.flyout, steady.speed)
    monkeypatch.setattr(steady_cluster, "_AT_ONCE", 5)
    np.testing.assert_allclose(cluster_coefficients(plan.models[0], steady.flyout, steady.speed), whole, atol=1e-13)


def test_draws_are_counted_through_all_models(plan, steady):
    (one,) = plan.models
    parts = [replace(one, theta=one.theta[:5]), replace(one, theta=one.theta[5:])]
    np.testing.assert_allclose(steady_clusters(parts).drag_area, steady.drag_area, rtol=1e-12)


def test_canopies_that_stand_upright_at_once_have_no_fly_out(plan):
    (one,) = plan.models
    theta = one.theta.copy()
    theta[:, 2:4], theta[:, 5] = [2.0, 0.0], 0.0  # restoring from zero on, no push
    assert (steady_clusters([replace(one, theta=theta)]).flyout == 0.0).all()


def test_canopies_that_never_rest_are_refused(plan):
    (one,) = plan.models
    theta = one.theta.copy()
    theta[:3, 2:4] = [-1.0, 0.0]  # pushed outwards at every angle
    with pytest.raises(InputError, match=r"no steady fly-out angle below 60 deg for 3 of 12 draws.*posterior\.curve"):
        steady_clusters([replace(one, theta=theta)])
