"""Check cases that are quick, the numbers that CHECKCASES prints of their closed forms, and errors that must be seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayeschute.core.vectors import Vec3
from bayeschute.dynamics import cluster
from bayeschute.verification import (
    bounce,
    capsule_cases,
    flying,
    flyout,
    glide,
    maypole,
    pendulum_cases,
    vertical_descent,
)
from bayeschute.verification.all_cases import RUNS, verify
from bayeschute.verification.case_results import table
from bayeschute.verification.catalogue import CASES
from bayeschute.verification.pendulum_cases import Pendulum
from bayeschute.verification.sets import DEGREE, FOOT, POUND, SETS, SLUG, T71

QUICK = ("1", "3a", "3b", "5", "11", "13")  # one force law, one compilation
SPRING = ("6a", "10n")  # likewise


def failed(results):
    return [line for line in table(results)[1:] if line.endswith("FAIL")]


@pytest.mark.parametrize("name", QUICK + SPRING)
def test_quick_cases_pass(name):
    results = RUNS[name]()
    assert failed(results) == []
    assert {r.case for r in results} == {name}
    flown = {(r.set, r.stiffness) for r in results if r.stiffness is not None}
    assert flown == {(s, k) for s in ("T71", "T61") for k in (1.0, 10.0)}


@pytest.mark.slow
def test_every_case_passes():
    results, _ = verify()
    assert failed(results) == []
    assert list(dict.fromkeys(r.case for r in results)) == [case.name for case in CASES]


def test_every_case_of_the_catalogue_can_be_run():
    assert list(RUNS) == [case.name for case in CASES]


@pytest.fixture
def fresh():
    """Compiled flights forget the equations of motion before and after a test breaks them."""
    flying._chunk.clear_cache()
    yield
    flying._chunk.clear_cache()


def weight_on_enclosed_air(monkeypatch):
    sound = cluster.canopy_acceleration

    def broken(state, geo, pull, model, structure, air):
        a, k = sound(state, geo, pull, model, structure, air), model.canopies
        enclosed = air.density * k.enclosed_volume
        return Vec3(a.x, a.y, a.z + model.gravity * enclosed / (k.dry_mass + enclosed))

    monkeypatch.setattr(cluster, "canopy_acceleration", broken)


def damper_that_drives(monkeypatch):
    sound = cluster.tension
    monkeypatch.setattr(cluster, "tension", lambda geo, r: sound(geo, replace(r, damping=-r.damping)))


def wind_added(monkeypatch):
    sound = cluster.canopy_flow
    monkeypatch.setattr(cluster, "canopy_flow", lambda s, g, m, t, air: sound(s, g, m, t, replace(air, wind=-air.wind)))


def gyroscopic_sign(monkeypatch):
    sound = cluster.capsule_acceleration

    def broken(state, geo, pull, model, air, n):
        a, turning = sound(state, geo, pull, model, air, n)
        return a, -turning

    monkeypatch.setattr(cluster, "capsule_acceleration", broken)


@pytest.mark.parametrize(
    "name, breaking, quantity",
    [
        ("5", weight_on_enclosed_air, "canopy velocity through the air"),
        ("1", damper_that_drives, "CM speed from 1.5 V_t"),
        pytest.param("3b", wind_added, "CM speed in the ramp", marks=pytest.mark.slow),
        pytest.param("11", gyroscopic_sign, "body rate, rad/s", marks=pytest.mark.slow),
    ],
)
def test_one_wrong_sign_fails_its_case(monkeypatch, fresh, name, breaking, quantity):
    breaking(monkeypatch)
    results = RUNS[name]()
    hit = [r for r in results if r.quantity == quantity]
    assert len(hit) == 4
    assert not any(r.passed for r in hit)


def test_derived_numbers_of_the_common_set():
    s = T71
    assert s.density * FOOT**3 / SLUG == pytest.approx(0.00211756, rel=3e-6)
    assert s.weight / POUND == pytest.approx(22562.0, rel=1e-6)
    assert s.mass / SLUG == pytest.approx(1294.86, rel=1e-6)
    assert s.fall / FOOT == pytest.approx(17.4243, rel=3e-6)
    assert s.terminal_speed / FOOT == pytest.approx(32.9866, rel=2e-6)
    assert s.load / POUND == pytest.approx(12169.4, rel=3e-6)


def test_printed_numbers_of_descent_and_glide():
    s = T71
    ramp = np.sqrt((s.fall - vertical_descent.RAMP) / s.kappa)
    assert ramp / FOOT == pytest.approx(32.0260, rel=2e-6)
    assert vertical_descent.shear_reference(s, np.array([0.0, 30.0]))[-1] / FOOT == pytest.approx(58.361, rel=1e-5)
    end = vertical_descent.exponential_speed(s, np.array([7730.336 * FOOT]))[0]
    assert end / FOOT == pytest.approx(29.0107, rel=2e-6)
    np.testing.assert_allclose(np.array(glide.glide_velocity(s)) / FOOT, [6.19742, 32.3992], rtol=1e-6)
    v_z, behind, lean = glide.shear_flight(s)
    assert v_z / FOOT == pytest.approx(32.9134, rel=2e-6)
    assert behind / FOOT == pytest.approx(-3.10858, rel=2e-6)
    assert lean / DEGREE == pytest.approx(2.92808, rel=2e-6)


def test_printed_numbers_of_the_modes():
    s = T71
    assert s.pendulum_rate == pytest.approx(0.363819, rel=2e-6)
    stiff = Pendulum(24.0 * DEGREE, slope=0.1901)
    assert pendulum_cases.swing_period(s, Pendulum(24.0 * DEGREE)) == pytest.approx(17.4614, rel=3e-6)
    assert pendulum_cases.swing_period(s, stiff) == pytest.approx(15.6326, rel=3e-6)
    assert stiff.small_rate(s) == pytest.approx(0.405500, rel=2e-6)
    assert stiff.pivot(s) / FOOT == pytest.approx(195.670, rel=3e-6)
    assert Pendulum(0.0, damping=0.5).decay(s) == pytest.approx(0.0421698, rel=1e-6)
    assert Pendulum(0.0, damping=-0.3).decay(s) == pytest.approx(-0.0253019, rel=1e-6)
    swing = Pendulum(20.0 * DEGREE, s.pendulum_rate / 2.0)
    assert pendulum_cases.nutation(s, swing, np.array([0.0]))[1] == pytest.approx(8.71582, rel=1e-6)
    m = maypole.maypole(s)
    assert m.load / POUND == pytest.approx(12324.6, rel=2e-6)
    assert m.normal == pytest.approx(0.0448817, rel=1e-6)
    assert (m.sink / FOOT, m.turn / DEGREE) == (pytest.approx(31.9598, rel=1e-6), pytest.approx(52.8534, rel=1e-6))
    for spin, lean, load in ((0.0, 0.153255, None), (0.18, 0.180781, 12277.8)):
        f = flyout.flyout(s, spin)
        assert f.lean == pytest.approx(lean, abs=5e-7)
        assert load is None or f.load / POUND == pytest.approx(load, rel=3e-6)


@pytest.mark.parametrize("s", SETS, ids=lambda s: s.name)
def test_closed_forms_solve_their_equations(s):
    """Jacobi's functions, Ei, the bounces and Euler's top, each against an integration of its own equation."""
    time = np.linspace(0.0, 30.0, 61)
    swing = Pendulum(20.0 * DEGREE, s.pendulum_rate / 2.0)
    np.testing.assert_allclose(
        pendulum_cases.nutation(s, swing, time)[0], pendulum_cases.pendulum_ode(s, swing, time)[0], atol=1e-10
    )
    plane = Pendulum(24.0 * DEGREE)
    np.testing.assert_allclose(
        pendulum_cases.plane_swing(s, plane.lean, time), pendulum_cases.pendulum_ode(s, plane, time)[0], atol=1e-10
    )

    def fall(_, y):
        return [y[1], s.fall - s.kappa * np.exp(y[0] / vertical_descent.SCALE_HEIGHT) * y[1] ** 2]

    y = solve_ivp(fall, (0, 30), [0.0, s.terminal_speed], "DOP853", time, rtol=1e-12, atol=1e-12).y
    np.testing.assert_allclose(vertical_descent.exponential_speed(s, y[0]), y[1], rtol=1e-11)

    mass, stiffness, pull = bounce._relative(s, 1.0)

    def spring(_, y):
        return [y[1], pull - stiffness / mass * max(y[0], 0.0)]

    begin = [-bounce.SLACK_AT_START, 0.0]
    y = solve_ivp(spring, (0, 10), begin, "DOP853", time / 3.0, rtol=1e-12, atol=1e-12, max_step=1e-3).y
    np.testing.assert_allclose(bounce.stretch(s, 1.0, time / 3.0), y[0], atol=2e-6)

    inertia = np.array([capsule_cases.AXIAL_INERTIA, capsule_cases.LATERAL_INERTIA, capsule_cases.LATERAL_INERTIA])
    rate = solve_ivp(
        lambda _, w: -np.cross(w, inertia * w) / inertia,
        (0, 30),
        capsule_cases.SPIN,
        "DOP853",
        time,
        rtol=1e-12,
        atol=1e-13,
    ).y.T
    turned, attitude = capsule_cases.top(time)
    np.testing.assert_allclose(turned, rate, atol=1e-10)
    np.testing.assert_allclose(
        attitude.apply(inertia * turned), np.tile(inertia * capsule_cases.SPIN, (61, 1)), atol=1e-6
    )
    np.testing.assert_allclose(_spin(attitude, time), turned[1:-1], atol=2e-3)


def _spin(attitude, time):
    """Body rate by differences of attitude, at the inner samples."""
    step = (attitude[:-2].inv() * attitude[2:]).as_rotvec()
    return step / (time[2:] - time[:-2])[:, None]


def test_scaled_exponential_integral_on_both_sides_of_where_its_forms_meet():
    """It obeys f' = 1/s - f, and at s = 1 it is Ei(1)/e with Ei(1) = 1.89511781635593675546652 (A091725)."""
    s = np.array([1.0, 10.0, 49.9, 50.1, 60.0, 200.0, 960.8])
    y = solve_ivp(
        lambda s, f: 1.0 / s - f, (1.0, 1000.0), [1.8951178163559368 / np.e], "LSODA", s, rtol=1e-12, atol=1e-15
    ).y[0]
    np.testing.assert_allclose(vertical_descent.scaled_exponential_integral(s), y, rtol=1e-9)
