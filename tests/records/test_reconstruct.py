"""Reconstruction of motions whose forces are known in closed form."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayeschute.core.errors import InputError
from bayeschute.records.angles import unit, wind_axes
from bayeschute.records.reconstruct import (
    UNITS,
    ClusterGeometry,
    force_coefficients,
    reconstruct,
    riser_tensions,
    smooth_motion,
    to_ned,
)
from bayeschute.records.record import Repair, make_record, repairs, with_repairs

G = ClusterGeometry(
    reference_length=35.0,
    reference_area=980.0,
    dry_mass=150.0,
    enclosed_volume=4000.0,
    capsule_mass=9500.0,
    capsule_reference_area=20.0,
    capsule_drag_coefficient=0.9,
    attach_b=(1.5, 0.0, 0.0),
)
DT, RHO, L = 0.1, 1.0, 70.0
T = np.arange(400) * DT
UP = np.tile([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0], (T.size, 1))  # body x axis straight up


def steady(speed=10.0, flyout=0.15, n=2):
    """A cluster that descends at a constant rate, capsule upright, risers at `flyout` off the vertical."""
    fall = np.stack([0 * T, 0 * T, speed * T - 2000], -1)
    turn = 2 * np.pi * np.arange(n) / n
    spread = L * np.stack(
        [np.sin(flyout) * np.cos(turn), np.sin(flyout) * np.sin(turn), -np.cos(flyout) + 0 * turn], -1
    )
    canopies = fall[:, None] + [0, 0, -1.5] + spread
    velocity = np.tile([0, 0, speed], (T.size, 1))
    felt = np.tile([9.80665, 0, 0], (T.size, 1))
    return make_record(
        time=T, capsule_position=fall, capsule_velocity=velocity, capsule_attitude=UP, capsule_specific_force=felt,
        canopy_position=canopies, wind=np.zeros_like(fall), density=np.full(T.size, RHO),
    )  # fmt: skip


@pytest.mark.parametrize("method", ["fourier", "local"])
def test_steady_descent(method):
    speed, flyout = 10.0, 0.15
    r = reconstruct(steady(speed, flyout), G, method).isel(time=200)
    q = 0.5 * RHO * speed**2
    pull = G.capsule_mass * G.gravity - q * 20 * 0.9
    tension = pull / (2 * np.cos(flyout))
    np.testing.assert_allclose(r["riser_tension"], tension)
    np.testing.assert_allclose(r["alpha_T"], flyout)
    np.testing.assert_allclose(r["C_A"], (tension + G.dry_mass * G.gravity * np.cos(flyout)) / (q * 980), rtol=1e-6)
    np.testing.assert_allclose(r["C_N"], G.dry_mass * G.gravity * np.sin(flyout) / (q * 980), rtol=1e-4)
    np.testing.assert_allclose(r["C_Y"], 0.0, atol=1e-6)
    np.testing.assert_allclose(r["D_prox"], 2 * L * np.sin(flyout) / 35)
    np.testing.assert_allclose(r["V_prox"], 0.0, atol=1e-6)
    np.testing.assert_allclose(r["phi_prox"], 0.0, atol=1e-6)  # canopies lean outward: the flow crosses them outward
    assert float(r["flyout_angle"]) == pytest.approx(flyout)
    assert float(r["swing_angle"]) == pytest.approx(0.0, abs=1e-12)
    assert float(r["riser_length"][0]) == pytest.approx(L)
    assert float(r["sea_level_descent_rate"]) == pytest.approx(speed * np.sqrt(RHO / 1.225))
    np.testing.assert_allclose(r["dynamic_pressure"], q)


@pytest.mark.parametrize(("method", "bound"), [("fourier", 2e-3), ("local", 0.02)])
def test_conical_pendulum(method, bound):
    """One canopy circles above a capsule that falls straight: acceleration and its force are known."""
    radius, omega, speed = 15.0, 0.45, 10.0
    circle = np.stack([radius * np.cos(omega * T), radius * np.sin(omega * T), 0 * T], -1)
    record = steady(n=1, flyout=0.0)
    canopy = record["capsule_position"].values + [0, 0, -1.5 - np.sqrt(L**2 - radius**2)] + circle
    record["canopy_position"].values = canopy[:, None]
    r = reconstruct(record, G, method)
    inner = slice(30, -30)
    np.testing.assert_allclose(r["canopy_acceleration"][inner, 0], -(omega**2) * circle[inner], atol=bound * 10)
    x = -r["riser_direction"].values[:, 0]
    velocity = np.stack([-radius * omega * np.sin(omega * T), radius * omega * np.cos(omega * T), speed + 0 * T], -1)
    mass = G.dry_mass + RHO * G.enclosed_volume
    tension = r["riser_tension"].values[:, 0]
    force = -mass * omega**2 * circle - [0, 0, G.dry_mass * G.gravity] - tension[:, None] * x
    c = force / (0.5 * RHO * np.sum(velocity**2, 1) * 980)[:, None]
    want = {"C_A": -np.sum(c * x, 1)}
    j, k = wind_axes(velocity[:, None], x[:, None])
    want |= {"C_Y": np.sum(c * j[:, 0], 1), "C_N": -np.sum(c * k[:, 0], 1)}
    for name, values in want.items():
        np.testing.assert_allclose(r[name][inner, 0], values[inner], atol=bound)
    np.testing.assert_allclose(r["swing_angle"], np.arcsin(radius / L))
    # The wind and the riser turn together at omega: alpha_T is constant.
    np.testing.assert_allclose(r["alpha_T_rate"][inner, 0], 0.0, atol=bound)
    np.testing.assert_allclose(np.gradient(x, DT, axis=0)[inner], -r["riser_direction_rate"][inner, 0], atol=bound)


@given(
    c=st.tuples(st.floats(0.3, 1.5), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
    seed=st.integers(0, 1000),
    density=st.floats(0.3, 1.3),
)
@settings(max_examples=40, deadline=None)
def test_coefficients_invert_the_force_law(c, seed, density):
    """m a = m_d g + T x + q S (-C_A x + C_Y j - C_N k), with weight on the dry mass and inertia with the air."""
    rng = np.random.default_rng(seed)
    x = unit(np.array([0, 0, 1.0]) + 0.4 * rng.standard_normal((1, 2, 3)))
    v = np.array([0, 0, 10.0]) + 3 * rng.standard_normal((1, 2, 3))
    tension = rng.uniform(0, 1e5, (1, 2))
    j, k = wind_axes(v, x)
    q_area = 0.5 * density * np.sum(v**2, -1, keepdims=True) * G.reference_area
    force = q_area * (-c[0] * x + c[1] * j - c[2] * k)
    weight = np.array([0, 0, G.dry_mass * G.gravity])
    a = (weight + tension[..., None] * x + force) / (G.dry_mass + density * G.enclosed_volume)
    got = force_coefficients(a, tension, x, v, np.array([density]), G)
    for name, value in zip(("C_A", "C_Y", "C_N"), c, strict=True):
        np.testing.assert_allclose(got[name], value, atol=1e-8)
    np.testing.assert_allclose(got["c_t"], c[1] * j - c[2] * k, atol=1e-8)


@pytest.mark.parametrize("n", [1, 2, 3])
def test_tensions_of_risers_in_general_position(n):
    rng = np.random.default_rng(n)
    turn = 2 * np.pi * np.arange(n) / n + rng.uniform(0, 7, (20, 1))
    direction = unit(np.stack([0.2 * np.cos(turn), 0.2 * np.sin(turn), -1.0 + 0 * turn], -1))
    want = rng.uniform(1e4, 9e4, (20, n))
    pull = np.einsum("tn,tni->ti", want, direction)
    np.testing.assert_allclose(riser_tensions(pull, direction), want, rtol=1e-9)


def test_parallel_risers_share_the_pull_and_gaps_stay_gaps():
    direction = np.broadcast_to([0, 0, -1.0], (3, 2, 3)).copy()
    pull = np.array([[0, 0, -10.0], [np.nan, 0, 0], [0, 0, -4.0]])
    np.testing.assert_allclose(riser_tensions(pull, direction), [[5, 5], [np.nan, np.nan], [2, 2]])


def test_specific_force_and_differentiated_velocity_agree():
    record = steady()
    bare = record.drop_vars(["capsule_specific_force", "capsule_attitude"])
    a, b = reconstruct(record, G), reconstruct(bare, G)
    np.testing.assert_allclose(a["riser_tension"][20:-20], b["riser_tension"][20:-20], rtol=1e-4)
    assert [r.variable for r in repairs(b)] == ["capsule_attitude", "capsule_specific_force"]


def test_a_recorded_tension_is_used():
    record = steady()
    record = make_record(
        time=T, riser_tension=np.full((T.size, 2), 123.0), **{str(k): v.values for k, v in record.data_vars.items()}
    )
    np.testing.assert_array_equal(reconstruct(record, G)["riser_tension"], 123.0)


def test_wind_moves_the_air_velocity():
    record = steady().drop_vars("wind")
    windy = steady()
    windy["wind"].values[:] = [3.0, -2.0, 0.5]
    a, b = reconstruct(record, G), reconstruct(windy, G)
    difference = a["air_velocity"].values - b["air_velocity"].values
    np.testing.assert_allclose(difference, np.broadcast_to([3.0, -2.0, 0.5], difference.shape), atol=1e-9)
    assert repairs(a)[0].kind == "assumed" and repairs(a)[0].variable == "wind"


def test_wind_of_the_canopies_moves_only_their_air():
    rng = np.random.default_rng(0)
    aloft = np.broadcast_to(rng.normal(size=(2, 3)), (T.size, 2, 3))
    a, b = reconstruct(steady(), G), reconstruct(steady(), G, canopy_wind=aloft)
    np.testing.assert_allclose(a["air_velocity"].values - b["air_velocity"].values, aloft, atol=1e-9)
    for name in ("riser_tension", "canopy_velocity", "swing_angle"):
        np.testing.assert_array_equal(a[name], b[name])


@pytest.mark.parametrize("method", ["fourier", "local"])
def test_gaps_ends_and_interpolated_stretches_give_no_forces(method):
    record = steady()
    record["canopy_position"].values[150:160, 0] = np.nan
    filled = with_repairs(record, [Repair("interpolated", "canopy_position.2", 24.95, 25.35, 3, "")])
    r = reconstruct(filled, G, method)
    lost = np.isnan(r["C_A"].values)
    assert lost[:10].all() and lost[-10:].all()
    assert lost[140:170, 0].all()
    assert lost[250:254, 1].all() and not lost[249, 1] and not lost[254, 1]
    assert not lost[180:240].any()
    assert not np.isnan(r["descent_rate"]).any()


def test_forces_between_the_samples_of_a_slow_series_are_none():
    record = steady()
    seen = record["time"].values[::3]
    slow = Repair("resampled", "canopy_position.1", seen[0], seen[-1], seen.size, "", tuple(seen.tolist()))
    lost = np.isnan(reconstruct(with_repairs(record, [slow]), G)["C_A"].values)
    plain = np.isnan(reconstruct(record, G)["C_A"].values)
    assert lost[:, 0][np.arange(len(lost)) % 3 != 0].all()
    np.testing.assert_array_equal(lost[::3], plain[::3])
    np.testing.assert_array_equal(lost[:, 1], plain[:, 1])


def test_short_stretches_are_left_out_by_the_global_smoother():
    x = np.full((100, 1), np.nan)
    x[10:25], x[40:90] = 1.0, 2.0
    first, second = smooth_motion(x, DT)
    assert np.isfinite(first[:, 0]).tolist() == [40 <= i < 90 for i in range(100)]
    np.testing.assert_allclose(second[40:90], 0.0, atol=1e-9)


def test_every_output_has_a_unit_and_records_stay_unchanged():
    record = steady()
    before = record.copy(deep=True)
    r = reconstruct(record, G)
    assert {str(k): v.attrs["units"] for k, v in r.data_vars.items()} == UNITS
    assert record.identical(before)


def test_attitude_turns_body_to_ned():
    np.testing.assert_allclose(to_ned(UP[:1], np.array([1.0, 0, 0])), [[0, 0, -1]], atol=1e-12)
    yaw = np.array([[np.cos(0.25), 0, 0, np.sin(0.25)]])  # nose turned by 0.5 rad from north to east
    np.testing.assert_allclose(to_ned(yaw, np.array([1.0, 0, 0])), [[np.cos(0.5), np.sin(0.5), 0]], atol=1e-12)


def test_unfit_records_are_refused():
    with pytest.raises(InputError, match="without density") as caught:
        reconstruct(steady().drop_vars(["density", "canopy_position"]), G)
    assert len(caught.value.faults) == 2
    uneven = steady()
    uneven = uneven.assign_coords(time=("time", T**1.01, {"units": "s"}))
    with pytest.raises(InputError, match="uniform rate"):
        reconstruct(uneven, G)
    with pytest.raises(InputError, match="'fourier' or 'local'"):
        reconstruct(steady(), G, "magic")


def test_heavier_inertia_by_wrongly_weighing_the_air_would_show():
    """6.3.3-6 as printed weighs the enclosed air: C_A in steady descent would be off by rho V g/(q S)."""
    heavy = dataclasses.replace(G, dry_mass=G.dry_mass + RHO * G.enclosed_volume, enclosed_volume=0.0)
    right, wrong = (float(reconstruct(steady(), g)["C_A"][200, 0]) for g in (G, heavy))
    off = RHO * G.enclosed_volume * G.gravity * np.cos(0.15) / (0.5 * RHO * 100 * 980)
    assert wrong - right == pytest.approx(off, rel=1e-6)
