"""The planar dumbbell against two particles and a line, its conserved quantities, and the three-body cluster."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import ellipk
from tests.twins import naive_dumbbell, small_cluster

from bayeschute.compiler.integrate import outputs, trajectory, trajectory_compiled
from bayeschute.core.units import to_si
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.forces import pitch_plane
from bayeschute.dynamics.parameters import Canopies, Risers, Structure
from bayeschute.reduced.dumbbell import (
    Dumbbell,
    DumbbellFlight,
    DumbbellInputs,
    airflow,
    centre_velocity,
    state_rate,
    steady_descent,
    steady_speed,
)
from bayeschute.reduced.planar import PlanarAero

naive, small = naive_dumbbell, small_cluster

FT, SLUG = to_si("1 ft", "m"), to_si("1 slug", "kg")
G = 32.174 * FT
DRY, VOLUME = 328.0 / 32.174 * SLUG, 140164.0 * FT**3
RHO = (307.0 * SLUG - DRY) / VOLUME
MODEL = Dumbbell(21906.0 / 32.174 * SLUG, 235.0 * FT, Canopies(10563.0 * FT**2, 116.0 * FT, 32.0 * FT, DRY, VOLUME), G)
AERO = PlanarAero(0.927, -0.329, 0.189, 0.1901, -0.988)
SAMPLES, DT = 201, 0.1
TIME = np.arange(SAMPLES) * DT
NAMES = ("C_A0", "C_Aalpha", "alpha_0", "C_Nalpha", "C_Nalphadot", "capsule_mass", "length")


def numbers(model=MODEL, aero=AERO, rho=RHO, wind=(0.0, 0.0)):
    coefficients = (aero.C_A0, aero.C_Aalpha, aero.alpha_0, aero.C_Nalpha, aero.C_Nalphadot)
    return naive.Numbers(
        model.capsule_mass, model.canopy_mass(rho), model.canopy_weight(), model.length, model.gravity, rho,
        model.canopies.area, model.count, coefficients, wind,
    )  # fmt: skip


def flight(start, aero=AERO, model=MODEL, wind=(0.0, 0.0), names=(), density=RHO):
    record = DumbbellInputs(np.tile(np.asarray(wind, float), (SAMPLES, 1)), np.full(SAMPLES, density))
    return DumbbellFlight(jax.tree.map(float, model), jax.tree.map(float, aero), np.asarray(start), record, DT, names)


def fly(one, theta=None, deviation=None):
    theta = np.zeros(0) if theta is None else theta
    deviation = np.zeros(4) if deviation is None else deviation
    return np.asarray(trajectory_compiled(one, theta, deviation, np.zeros((SAMPLES, 2))))


def descending(swing, rate=0.0, along=0.0, down=10.0):
    return np.array([3.0, -2.0, along, down, swing, rate])


@pytest.mark.parametrize("seed", range(4))
def test_accelerations_are_those_of_two_particles_on_a_line(seed):
    rng = np.random.default_rng(seed)
    x = np.concatenate([rng.normal(size=2), rng.normal(0, 4, 2) + [0, 10], rng.normal(0, 0.4, 2)])
    wind, rho = rng.normal(size=2), rng.uniform(0.7, 1.3)
    want = naive.rate(naive.cartesian(x, MODEL.length), numbers(rho=rho, wind=wind))
    got = np.asarray(state_rate(jnp.asarray(x), MODEL, AERO, wind, rho))
    np.testing.assert_allclose(got[:2], want[:2], rtol=1e-14)
    np.testing.assert_allclose(got[2:4], want[4:6], rtol=1e-10, atol=1e-10)
    s, c = np.sin(x[4]), np.cos(x[4])
    apart = want[4:6] - want[6:8]  # a_L - a_C = L (theta'' (c, -s) - theta'^2 (s, c))
    np.testing.assert_allclose(got[5] * MODEL.length, apart @ [c, -s], rtol=1e-10, atol=1e-10)


def test_flight_follows_scipy():
    x0, wind = descending(0.3, 0.05), (2.0, -0.5)
    swing, velocity = naive.fly(x0, numbers(wind=wind), TIME)
    x = fly(flight(x0, wind=wind))
    np.testing.assert_allclose(x[:, 4], swing, atol=1e-6)
    np.testing.assert_allclose(x[:, 2:4], velocity, atol=2e-5)


def test_energy_is_kept_without_air():
    thin = replace(MODEL, canopies=replace(MODEL.canopies, enclosed_volume=VOLUME * 1e12))
    x = fly(flight(descending(1.0, 0.2, 3.0), model=thin, density=RHO * 1e-12))
    m_L, m_C, W_C, L = MODEL.capsule_mass, MODEL.canopy_mass(RHO), MODEL.canopy_weight(), MODEL.length
    s, c = np.sin(x[:, 4]), np.cos(x[:, 4])
    canopy = x[:, 2:4] - L * x[:, 5:6] * np.stack([c, -s], axis=1)
    kinetic = 0.5 * m_L * (x[:, 2:4] ** 2).sum(1) + 0.5 * m_C * (canopy**2).sum(1)
    potential = -m_L * G * x[:, 1] - W_C * (x[:, 1] - L * c)
    np.testing.assert_allclose(kinetic + potential, (kinetic + potential)[0], rtol=1e-6)
    assert np.ptp(x[:, 4]) > 1.0


def test_period_without_normal_force_is_an_elliptic_integral():
    """With C_N = 0 the drag, whatever it is, leaves theta alone (6.3.1-7)."""
    amplitude = np.deg2rad(24.0)
    aero = replace(AERO, C_Nalpha=0.0, C_Nalphadot=0.0)
    x = fly(flight(descending(amplitude, along=4.0), aero))
    w0 = np.sqrt((G - MODEL.canopy_weight() / MODEL.canopy_mass(RHO)) / MODEL.length)
    quarter = float(ellipk(np.sin(amplitude / 2) ** 2) / w0)
    assert 4 * quarter == pytest.approx(17.4614, abs=1e-4)  # CHECKCASES 6a
    place = np.interp([quarter, 3 * quarter], TIME, x[:, 4])
    np.testing.assert_allclose(place, 0.0, atol=2e-5)  # linear interpolation
    np.testing.assert_allclose(np.interp(4 * quarter, TIME, x[:, 4]), amplitude, atol=1e-4)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("stable", [False, True])
def test_steady_descent_stays(side, stable):
    aero = replace(AERO, statically_stable=stable, C_Nalphadot=0.988)
    start = steady_descent(MODEL, aero, RHO, side)
    x = fly(flight(start, aero))
    np.testing.assert_allclose(x[:, 2:], np.tile(start[2:], (SAMPLES, 1)), atol=1e-9)
    u, w = airflow(x.T, np.zeros(2), MODEL.length)
    alpha = np.arctan2(w, u)
    np.testing.assert_allclose(alpha, 0.0 if stable else side * 0.189, atol=1e-10)
    if not stable:  # CHECKCASES 4
        assert float(steady_speed(MODEL, aero, RHO)) / FT == pytest.approx(32.9866, abs=1e-4)
        np.testing.assert_allclose(np.abs(start[2:4]) / FT, [6.19742, 32.3992], rtol=1e-5)


def test_n_canopies_are_one_of_the_same_sum():
    c = MODEL.canopies
    three = replace(
        MODEL,
        count=3,
        canopies=replace(c, area=c.area / 1.5, dry_mass=c.dry_mass / 1.5, enclosed_volume=c.enclosed_volume / 1.5),
    )
    start = descending(0.2, 0.1, 1.0)
    np.testing.assert_allclose(fly(flight(start, model=three)), fly(flight(start)), rtol=1e-9, atol=1e-9)


def test_uniform_wind_carries_everything_along():
    start, wind = descending(0.2, 0.1, 1.0), np.array([6.0, -1.0])
    still, carried = fly(flight(start)), fly(flight(start + [0, 0, *wind, 0, 0], wind=wind))
    np.testing.assert_allclose(carried[:, 4:], still[:, 4:], atol=1e-10)
    np.testing.assert_allclose(carried[:, 0:2], still[:, 0:2] + TIME[:, None] * wind, atol=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_centre_of_mass_is_accelerated_by_the_outer_forces(seed):
    """6.3.1-5."""
    rng = np.random.default_rng(seed)
    x = jnp.asarray(np.concatenate([np.zeros(2), rng.normal(0, 4, 2) + [0, 10], rng.normal(0, 0.4, 2)]))
    rate = state_rate(x, MODEL, AERO, np.zeros(2), RHO)
    _, got = jax.jvp(lambda s: jnp.stack(centre_velocity(s, MODEL, RHO)), (x,), (rate,))
    p = numbers()
    y = naive.cartesian(np.asarray(x), p.L)
    force = naive.canopy_force(p, y[0:2] - y[2:4], y[6:8], float(x[5])) + [0.0, p.m_L * p.g + p.W_C]
    np.testing.assert_allclose(got, force / (p.m_L + p.m_C), rtol=1e-11, atol=1e-11)


def test_derivatives_match_differences_through_zero_angle_of_attack():
    start = descending(0.25, 0.0, 0.0)
    one = flight(start, names=NAMES)
    theta = np.array([0.927, -0.329, 0.189, 0.1901, -0.988, MODEL.capsule_mass, MODEL.length])
    weights = np.linspace(1.0, 0.0, SAMPLES)[:, None]

    def traced(z):
        t, d, k = jnp.split(z, (7, 11))
        return outputs(one, trajectory(one, t, d, weights * k), t)

    by = jax.jit(jax.jacfwd(traced))(jnp.concatenate([theta, jnp.zeros(6)]))
    _, across = airflow(np.moveaxis(fly(one, theta), 1, 0), np.zeros(2), MODEL.length)
    assert np.min(across) < 0.0 < np.max(across)

    def out(t, d, k):
        states = trajectory_compiled(one, t, d, weights * k)
        return np.asarray(outputs(one, states, t))

    def difference(i, h):
        moved = [np.zeros(7), np.zeros(4), np.zeros(2)]
        block, place = (0, i) if i < 7 else (1, i - 7) if i < 11 else (2, i - 11)
        moved[block][place] = h
        up = out(theta + moved[0], moved[1], moved[2])
        return (up - out(theta - moved[0], -moved[1], -moved[2])) / (2 * h)

    for i in range(by.shape[2]):
        h = 1e-3 * (abs(theta[i]) if i < 7 else 1e-1)
        want = (4.0 * difference(i, h / 2) - difference(i, h)) / 3.0  # Richardson
        np.testing.assert_allclose(by[:, :, i], want, atol=1e-6 * np.abs(want).max(), err_msg=f"column {i}")


def test_a_batch_is_its_members():
    one = flight(descending(0.1), names=("C_Nalphadot", "capsule_mass"))
    theta = np.array([[-0.988, 0.5, 0.0], [9000.0, 9900.0, 11000.0]])
    deviation = np.random.default_rng(5).normal(0, 0.1, (4, 3))
    together = np.asarray(trajectory_compiled(one, theta, deviation, np.zeros((SAMPLES, 2, 1))))
    for b in range(3):
        np.testing.assert_allclose(together[..., b], fly(one, theta[:, b], deviation[:, b]), rtol=1e-9, atol=1e-9)


def test_unknown_parameter_is_named():
    with pytest.raises(KeyError, match="C_D.*C_Nalphadot"):
        fly(flight(descending(0.1), names=("C_D",)), np.zeros(1))


def cluster_error(law, axial, transverse, aero, stiffer):
    """Greatest difference of swing [rad] and capsule velocity [m/s] between the cluster and the dumbbell."""
    swing, turning = 0.35, 0.1
    x0 = np.array([0.0, 0.0, 2.0, 10.0, swing, turning])
    want = fly(flight(x0, aero))
    direction = np.array([[-np.sin(swing), 0.0, -np.cos(swing)]] * 2).T
    rate = -turning * np.array([[np.cos(swing), 0.0, -np.sin(swing)]] * 2).T
    stiffness = 15000.0 * to_si("1 lbf", "N") / FT * stiffer
    # Tension of the rigid line: m_L a_L = W_L - T b_1.
    a = np.asarray(state_rate(jnp.asarray(x0), MODEL, aero, np.zeros(2), RHO))[2:4]
    pull = MODEL.capsule_mass * (G * np.cos(swing) - a @ [np.sin(swing), np.cos(swing)]) / 2
    zero = Vec3(0.0, 0.0, 0.0)
    particle = replace(
        small.CAPSULE, mass=MODEL.capsule_mass, attach_b=zero, reference_centre_b=zero, axial_force=0.0,
        normal_force_slope=0.0, moment_slope=0.0, roll_damping=0.0, pitch_damping=0.0,
    )  # fmt: skip
    risers = Risers(MODEL.length - pull / stiffness, stiffness, stiffness * 2.0 / 3.0, 0.25 * pull / stiffness)
    model = replace(
        small.cluster(tuple(axial.values()), tuple(transverse.values()), capsule=particle, canopies=MODEL.canopies,
                      risers=risers),
        gravity=G,
    )  # fmt: skip
    structure = Structure(tuple(axial), tuple(transverse), 2, "riser", law)
    x = small.fly(small.flight(model, small.start(direction, rate, (2.0, 0.0, 10.0)), structure, density=RHO))
    line = x[:, 0:3, None] - x[:, 13:19].reshape(-1, 3, 2)
    lean = np.arctan2(line[:, 0], line[:, 2])
    np.testing.assert_allclose(lean[:, 0], lean[:, 1], atol=1e-10)
    np.testing.assert_allclose(x[:, [1, 4]], 0.0, atol=1e-9)
    return np.abs(lean[:, 0] - want[:, 4]).max(), np.abs(x[:, [3, 5]] - want[:, 2:4]).max()


def test_cluster_with_the_same_law_follows_within_the_elasticity_of_its_risers():
    axial = {"C_A0": 0.927, "C_Aalpha": -0.329, "alpha_0": 0.189}
    transverse = {"C_Nalpha": 0.1901, "C_Nalphadot": -0.988}
    nominal, stiff = (cluster_error(pitch_plane, axial, transverse, AERO, f) for f in (1.0, 10.0))
    assert np.rad2deg(nominal[0]) < 0.15
    assert nominal[0] / stiff[0] == pytest.approx(10.0, abs=0.3)
    assert nominal[1] / stiff[1] == pytest.approx(10.0, abs=0.5)


def test_cluster_with_equivalent_terms_follows_likewise():
    aero = replace(AERO, rate="riser", C_Nalphadot=-0.5, statically_stable=True)
    a, k = aero.alpha_0, aero.C_Nalpha
    axial = {"1": aero.C_A0, "alpha^2": 0.5 * aero.C_Aalpha / a}
    transverse = {"angle": k, "angle*alpha": 1.5 * k / a, "angle*alpha^2": 0.5 * k / a**2, "rate": aero.C_Nalphadot}
    nominal, stiff = (cluster_error(None, axial, transverse, aero, f) for f in (1.0, 10.0))
    assert np.rad2deg(nominal[0]) < 0.15
    assert nominal[0] / stiff[0] == pytest.approx(10.0, abs=0.3)
