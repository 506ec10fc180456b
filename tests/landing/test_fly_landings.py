"""Landings: the simulator's own trajectories, closed forms, and rows that depend on nothing but their numbers."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest

from bayeschute.atmosphere.standard import standard_density
from bayeschute.compiler.integrate import trajectory_compiled
from bayeschute.dynamics.cluster_flight import ClusterFlight, ClusterInputs
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.state import pack, unpack
from bayeschute.landing.campaign_plan import flight_model
from bayeschute.landing.descend import SAMPLE, SECOND, Weather, descend
from bayeschute.landing.fly_landings import fly, nested
from bayeschute.landing.landing_model import density_law, flown, rows
from bayeschute.landing.measures import LABELS, MEASURES
from bayeschute.landing.start_plan import SIZE, StartPlan, begin
from bayeschute.landing.wind_plan import WindPlan


@jax.tree_util.register_pytree_node_class
class Begun:
    """A flight that begins at a given state."""

    def __init__(self, flight, x):
        self.flight, self.x = flight, x

    def tree_flatten(self):
        return (self.flight, self.x), None

    @classmethod
    def tree_unflatten(cls, _, leaves):
        return cls(*leaves)

    def initial(self, numbers, start):
        return self.x

    def __getattr__(self, name):
        return getattr(self.flight, name)


@pytest.fixture(scope="module")
def landed(plan):
    return fly(plan, nested(plan.draws, 48))


def test_the_density_is_the_standard_one():
    law, middle, half = density_law(-800.0, 4000.0)
    h = np.linspace(-800.0, 4000.0, 97)
    made = np.exp(np.polynomial.polynomial.polyval((h - middle) / half, law))
    np.testing.assert_allclose(made, standard_density(h), rtol=1e-7)


def test_a_second_of_flight_is_that_of_the_simulator(plan):
    """Same cluster, same wind and density by time in a `ClusterFlight`, whose air is that of the capsule's altitude."""
    model = flight_model(plan, 0)
    theta = plan.models[0].theta[:3].T
    x = begin(plan.start, model, theta, np.random.default_rng(1).standard_normal((SIZE, 3)), np.zeros((3, 3)))
    wind = np.array([3.0, -1.0, 0.5])
    error = np.zeros((SECOND + 1, rows(2), 3))
    error[:, 0:3], error[:, 3:6] = wind[:, None], wind[:, None]
    even = replace(model, density=np.array([np.log(1.1), 0.0, 0.0, 0.0, 0.0, 0.0]))
    made = flown(even, theta, x, error)
    inputs = ClusterInputs(
        np.tile(wind, (SECOND + 1, 1)), np.full(SECOND + 1, 1.1), np.ones((SECOND + 1, 2)), np.zeros((SECOND + 1, 4))
    )
    for b in range(3):
        flight = ClusterFlight(
            plan.models[0].base, None, None, inputs, SAMPLE, model.structure, model.names, (), model.substeps
        )
        want = trajectory_compiled(Begun(flight, x[:, b]), theta[:, b], np.zeros(0), np.zeros((SECOND + 1, 3)))
        np.testing.assert_allclose(made[:, :, b], want, rtol=1e-9, atol=1e-7)


def test_a_steady_vertical_descent_has_the_speed_of_its_drag(plan):
    """Two canopies beside each other without transverse force: weight = drag along the vertical (flyout is small)."""
    one = plan.models[0]
    model = replace(
        flight_model(plan, 0), structure=Structure(("1",), (), 2), names=("axial[1]",),
        base=replace(one.base, axial=(0.9,), transverse=(), capsule=replace(one.base.capsule, axial_force=0.0)),
    )  # fmt: skip
    theta, u = np.array([[0.9]]), np.zeros((SIZE, 1))
    x = begin(StartPlan((700.0, 0.0), flyout=(0.0, 0.0)), model, theta, u, np.zeros((3, 1)))
    # Canopies above each other would be one place: they are set a little apart, and fall straight.
    weather = Weather(0.0, np.zeros((600, 3, 1)), np.zeros((400, 10, 1)), np.zeros((2, 1)))
    landed = descend(model, theta, x, weather, 302.0)
    assert landed.outcome.tolist() == [0]
    numbers = one.base
    weight = (numbers.capsule.mass + 2.0 * numbers.canopies.dry_mass) * 9.80665
    above = 302.0 + float(numbers.risers.length)
    speed = np.sqrt(2.0 * weight / (standard_density(np.array([above]))[0] * 2.0 * numbers.canopies.area * 0.9))
    assert landed.states[5, 0] == pytest.approx(speed, rel=0.01)
    assert -landed.states[2, 0] == pytest.approx(302.0, abs=0.02)
    assert landed.time[0] == pytest.approx(398.0 / speed, rel=0.02)


def test_rows_hold_together(landed):
    assert (landed["outcome"] == 0).all()
    speed = np.hypot(landed["vertical_speed"], landed["horizontal_speed"])
    body = np.sqrt(sum(landed[f"velocity_{a}"] ** 2 for a in "xyz"))
    np.testing.assert_allclose(body, speed, rtol=1e-3)
    np.testing.assert_allclose(np.cos(landed["incidence"]), -landed["velocity_x"] / body, atol=1e-9)
    ratio = np.sqrt(standard_density(np.array([302.0]))[0] / 1.225)
    np.testing.assert_allclose(landed["sea_level_vertical_speed"], ratio * landed["vertical_speed"], rtol=1e-4)
    assert {LABELS[i] for i in landed["label"]} <= set(LABELS)
    assert all(np.isfinite(landed[name]).all() for name in MEASURES)
    weight = 9463.0 * 9.81
    assert np.median(landed["riser_tension_sum"]) == pytest.approx(weight, rel=0.2)


def test_a_landing_is_the_same_in_another_batch_and_order(plan, landed):
    ids = nested(plan.draws, 48)
    some = np.array([31, 5, 5, 17])
    again = fly(plan, ids[some])
    for name in landed.dtype.names:
        np.testing.assert_allclose(again[name], landed[name][some], rtol=1e-10, atol=1e-10)


def test_landings_that_share_all_but_one_differ_by_that(plan):
    ids = np.array([[0, 1, 1, 1, 1, 1], [0, 1, 1, 2, 1, 1], [1, 1, 1, 1, 1, 1]])
    made = fly(plan, ids)
    assert (made["start_altitude"][0] == made["start_altitude"]).all()
    assert (made["wind_shear"][0] == made["wind_shear"]).all()
    assert len(set(made["vertical_speed"])) == 3


def test_drift_is_that_of_the_wind(plan):
    calm = replace(plan, winds=WindPlan(), models=(_quiet(plan.models[0]),))
    windy = replace(calm, winds=replace(plan.winds, error_sd=0.0))
    ids = nested(plan.draws, 8)
    without, with_ = fly(calm, ids), fly(windy, ids)
    assert np.abs(without["surface_wind_north"]).max() < 1e-7
    profile = plan.winds.profiles[0]
    h = np.arange(302.0, 700.0)
    mean = np.interp(h, profile.altitude, profile.wind[:, 0]).mean()
    np.testing.assert_allclose((with_["drift_north"] - without["drift_north"]) / with_["time"], mean, atol=1.0)
    np.testing.assert_allclose(
        with_["surface_wind_north"], np.interp(302.0, profile.altitude, profile.wind[:, 0]), atol=0.05
    )


def _quiet(one):
    return replace(one, laws=tuple(np.concatenate([1e-9 * law[:, :1], law[:, 1:]], axis=1) for law in one.laws))


def test_what_does_not_come_down_or_diverges_is_told(plan):
    model, theta = flight_model(plan, 0), plan.models[0].theta[:2].T
    x = begin(plan.start, model, theta, np.zeros((SIZE, 2)), np.zeros((3, 2))).copy()
    x[3, 1] = np.nan
    weather = Weather(0.0, np.zeros((600, 3, 2)), np.zeros((3 * SECOND + 1, 10, 2)), np.zeros((2, 2)))
    landed = descend(model, theta, x, weather, 302.0)
    assert landed.outcome.tolist() == [2, 1] and np.isnan(landed.time).all()


def test_a_landing_that_diverges_on_the_way_is_counted_and_leaves_the_others_alone(plan):
    """One of three meets air that is no number after two seconds; the campaign goes on for all that time and longer."""
    model, theta = flight_model(plan, 0), plan.models[0].theta[:3].T
    x = begin(StartPlan((700.0, 0.0)), model, theta, np.zeros((SIZE, 3)), np.zeros((3, 3)))
    latent = 0.1 * np.random.default_rng(2).standard_normal((400, 10, 3))
    sound = descend(model, theta, x, Weather(0.0, np.zeros((600, 3, 3)), latent, np.zeros((2, 3))), 302.0)
    latent = latent.copy()
    latent[2 * SECOND + 1, 0, 1] = np.nan
    landed = descend(model, theta, x, Weather(0.0, np.zeros((600, 3, 3)), latent, np.zeros((2, 3))), 302.0)
    assert landed.outcome.tolist() == [0, 1, 0] and np.isnan(landed.states[:, 1]).all()
    np.testing.assert_allclose(landed.states[:, ::2], sound.states[:, ::2], rtol=1e-9, atol=1e-9)


def test_starts_are_what_the_plan_says(plan):
    model, rng = flight_model(plan, 0), np.random.default_rng(4)
    start = StartPlan((700.0, 0.0), swing=(0.2, 0.0), azimuth=0.5, swing_rate=(0.1, 0.0), flyout=(0.1, 0.0), tilt=0.0)
    theta = np.repeat(plan.models[0].theta[:1].T, 4, axis=1)
    x = begin(start, model, theta, rng.standard_normal((SIZE, 4)), np.zeros((3, 4)))
    state = unpack(x, 2)
    away = np.stack(
        [np.asarray(c) for c in (state.canopy_position.x, state.canopy_position.y, state.canopy_position.z)]
    )
    mean = (away - x[0:3, None]).mean(axis=1)
    np.testing.assert_allclose(np.arctan2(np.hypot(mean[0], mean[1]), -mean[2]), 0.2, atol=0.01)
    np.testing.assert_allclose(np.arctan2(mean[1], mean[0]), 0.5, atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(x[6:10], axis=0), 1.0, atol=1e-12)
    np.testing.assert_array_equal(np.asarray(pack(state)), x)
