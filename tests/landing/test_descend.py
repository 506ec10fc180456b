"""Descents to the ground: a closed form, winds by altitude, the motion before touchdown, and landings that fail."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.landing.plans import small_model

from bayeschute.atmosphere.standard import standard_density
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.parameters import Structure
from bayeschute.landing import descend as module
from bayeschute.landing.descend import SAMPLE, SECOND, WINDOW, Weather, at_altitude, descend
from bayeschute.landing.start_plan import SIZE, StartPlan, begin
from bayeschute.landing.wind_plan import STEP


def test_a_steady_vertical_descent_has_the_speed_of_its_drag(plan):
    """Two canopies beside each other without transverse force: weight = drag along the vertical (flyout is small)."""
    one = plan.models[0]
    model = replace(
        small_model(plan.models[0]), structure=Structure(("1",), (), 2), names=("axial[1]",),
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


def test_what_does_not_come_down_or_diverges_is_told(plan):
    model, theta = small_model(plan.models[0]), plan.models[0].theta[:2].T
    x = begin(plan.start, model, theta, np.zeros((SIZE, 2)), np.zeros((3, 2))).copy()
    x[3, 1] = np.nan
    weather = Weather(0.0, np.zeros((600, 3, 2)), np.zeros((3 * SECOND + 1, 10, 2)), np.zeros((2, 2)))
    landed = descend(model, theta, x, weather, 302.0)
    assert landed.outcome.tolist() == [2, 1] and np.isnan(landed.time).all()


def test_a_landing_that_diverges_on_the_way_is_counted_and_leaves_the_others_alone(plan):
    """One of three meets air that is no number after two seconds; the campaign goes on for all that time and longer."""
    model, theta = small_model(plan.models[0]), plan.models[0].theta[:3].T
    x = begin(StartPlan((700.0, 0.0)), model, theta, np.zeros((SIZE, 3)), np.zeros((3, 3)))
    latent = 0.1 * np.random.default_rng(2).standard_normal((400, 10, 3))
    sound = descend(model, theta, x, Weather(0.0, np.zeros((600, 3, 3)), latent, np.zeros((2, 3))), 302.0)
    latent = latent.copy()
    latent[2 * SECOND + 1, 0, 1] = np.nan
    landed = descend(model, theta, x, Weather(0.0, np.zeros((600, 3, 3)), latent, np.zeros((2, 3))), 302.0)
    assert landed.outcome.tolist() == [0, 1, 0] and np.isnan(landed.states[:, 1]).all()
    np.testing.assert_allclose(landed.states[:, ::2], sound.states[:, ::2], rtol=1e-9, atol=1e-9)


ATTACH = Vec3(1.5, 0.0, 0.5)
HIGH = np.array([[-3.0, 4.0], [1.0, -1.0], [-30.0, -32.0]])  # of two canopies from the attach point (3, n) [m]
SPREAD = np.array([[0.2, -0.3], [0.1, 0.4], [0.05, 0.15]])  # their velocities from the capsule's (3, n) [m/s]
UP = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])  # body x up, body z north


def straight(rates, altitude):
    """A model whose bodies keep their velocities, and states (25, B) at an altitude with these descent rates."""
    x, count = np.zeros((25, len(rates))), len(rates)
    x[2], x[3], x[4], x[5], x[6:10] = -altitude, 2.0, -1.0, rates, UP[:, None]
    attach = np.array([ATTACH.z, ATTACH.y, -ATTACH.x])  # in NED of this attitude
    x[13:19] = (x[0:3, None] + (attach[:, None] + HIGH)[..., None]).reshape(6, count)
    x[19:25] = (x[3:6, None] + SPREAD[..., None]).reshape(6, count)
    structure = SimpleNamespace(canopies=2)
    return SimpleNamespace(structure=structure, base=SimpleNamespace(capsule=SimpleNamespace(attach_b=ATTACH))), x


def kept(met=None, scale=1.0):
    """In place of `flown`: all bodies on straight lines; disturbances and states are told to `met`."""

    def fly(model, theta, x, error):
        if met is not None:
            met.append((theta, x, error))
        made = np.tile(x, (SECOND + 1, 1, 1))
        t = SAMPLE * np.arange(SECOND + 1)[:, None, None]
        made[:, 0:3] += t * x[3:6]
        made[:, 13:19] += t * x[19:25]
        made[:, 6:10] *= scale
        return made

    return fly


def weather(count, samples=400):
    """Winds linear in altitude, latent disturbances linear in time, other ones in every landing."""
    h = STEP * np.arange(120)
    slope, lane = np.array([0.02, -0.03, 0.001]), 1.0 + 0.1 * np.arange(count)
    wind = h[:, None, None] * slope[:, None] * lane
    rows = np.arange(1.0, 11.0)
    latent = 0.01 * SAMPLE * np.arange(samples)[:, None, None] * rows[:, None] * lane
    return Weather(0.0, wind, latent, np.array([[0.1], [-0.2]]) * lane), slope, lane


def test_winds_are_linear_between_rows_and_held_beyond():
    rows = np.random.default_rng(0).standard_normal((6, 3, 4))
    met = Weather(100.0, rows, np.zeros((0, 0, 0)), np.zeros((0, 0)))
    lanes = np.array([3, 1])
    altitude = np.array([[100.0, 103.0], [90.0, 109.5], [108.0, 200.0]])
    made = at_altitude(met, altitude, lanes)
    assert made.shape == (3, 3, 2)
    for i, b in np.ndindex(3, 2):
        for axis in range(3):
            want = np.interp(altitude[i, b], 100.0 + STEP * np.arange(6), rows[:, axis, lanes[b]])
            assert made[i, axis, b] == pytest.approx(want, abs=0.005)


def test_bodies_on_straight_lines_come_down_where_and_when_they_must(monkeypatch):
    """Times, states and winds at the floor, between samples; landings of other rates leave the batch one by one."""
    monkeypatch.setattr(module, "flown", kept())
    rates, floor = np.array([4.0, 9.3, 7.0, 11.7, 4.9]), 12.0
    model, x = straight(rates, 150.0)
    met, slope, lane = weather(5)
    landed = descend(model, np.zeros((1, 5)), x, met, floor)
    time = 138.0 / rates
    assert landed.outcome.tolist() == [0] * 5
    np.testing.assert_allclose(landed.time, time, rtol=1e-12)
    np.testing.assert_allclose(landed.states[0:3], [2.0 * time, -time, np.full(5, -floor)], rtol=1e-12)
    np.testing.assert_allclose(landed.states[3:6], x[3:6], rtol=1e-12)
    np.testing.assert_allclose(landed.states[13:19], x[13:19] + time * x[19:25], rtol=1e-12)
    wind = (floor * slope[:, None] + 0.01 * time * np.array([[1.0], [2.0], [3.0]])) * lane
    np.testing.assert_allclose(landed.wind, wind, rtol=1e-10)


def test_the_motion_before_touchdown_is_of_the_last_samples(monkeypatch):
    """A slow landing fills the window; one that is down before that leaves its beginning empty."""
    monkeypatch.setattr(module, "flown", kept())
    rates, floor, altitude = np.array([4.0, 11.7]), 12.0, 150.0
    model, x = straight(rates, altitude)
    met, slope, lane = weather(2)
    landed = descend(model, np.zeros((1, 2)), x, met, floor)
    for b, rate in enumerate(rates):
        last = int(np.ceil(138.0 / rate / SAMPLE))
        first = max(0, last - WINDOW + 1)
        t = SAMPLE * np.arange(first, last + 1)
        along = HIGH + SPREAD * t[:, None, None]
        unit = along[:, :2] / np.linalg.norm(along, axis=1, keepdims=True)
        np.testing.assert_allclose(landed.across[-len(t) :, :, :, b], unit, rtol=1e-10)
        assert np.isnan(landed.across[: -len(t), ..., b]).all() and len(t) <= WINDOW
        high = altitude + 1.5 - HIGH[2].mean() - (rate + SPREAD[2].mean()) * t
        wind = (high[:, None] * slope + 0.01 * t[:, None] * [1.0, 2.0, 3.0]) * lane[b]
        speed = np.array([2.0, -1.0, rate]) + SPREAD.mean(axis=1)
        np.testing.assert_allclose(landed.path[:, b], (speed - wind).mean(axis=0), rtol=1e-10)
    assert SAMPLE * WINDOW < 138.0 / 4.0 and SAMPLE * WINDOW > 138.0 / 11.7  # both cases are there


def test_what_is_met_is_of_the_landing_and_of_its_time(monkeypatch):
    """Also after others left the batch: parameters and disturbances stay with their landing."""
    met, known = [], np.array([[0.0, 1.0, 2.0, 3.0]])
    monkeypatch.setattr(module, "flown", kept(met))
    model, x = straight(np.array([9.0, 2.0, 9.0, 9.0]), 30.0)
    given, slope, lane = weather(4)
    descend(model, known, x, given, 0.0)
    assert len(met[-1][0][0]) == 1  # the slow one was alone at the end
    for k, (theta, start, error) in enumerate(met):
        here = theta[0].astype(int)
        t = k * SECOND * SAMPLE + SAMPLE * np.arange(SECOND + 1)
        latent = 0.01 * t[:, None, None] * np.arange(1.0, 11.0)[:, None] * lane[here]
        low = np.maximum(-start[2] - start[5] * SAMPLE * np.arange(SECOND + 1)[:, None], 0.0)
        np.testing.assert_allclose(error[:, 0:3], low[:, None] * slope[:, None] * lane[here] + latent[:, :3], atol=1e-9)
        np.testing.assert_allclose(error[:, 6:8], latent[:, 3:5] + np.array([[0.1], [-0.2]]) * lane[here], atol=1e-9)
        np.testing.assert_allclose(error[:, 8:13], latent[:, 5:10], atol=1e-9)


def test_attitudes_are_of_unit_length_after_every_second(monkeypatch):
    met = []
    monkeypatch.setattr(module, "flown", kept(met, 1.1))
    model, x = straight(np.array([5.0]), 20.0)
    assert descend(model, np.zeros((1, 1)), x, weather(1)[0], 0.0).outcome[0] == 0
    assert len(met) == 4
    for _, start, _ in met:
        np.testing.assert_allclose(start[6:10, 0], UP, rtol=1e-12)


def test_a_start_on_the_floor_is_down_at_once(monkeypatch):
    monkeypatch.setattr(module, "flown", kept())
    model, x = straight(np.array([5.0, 5.0]), 20.0)
    landed = descend(model, np.zeros((1, 2)), x, weather(2)[0], 20.0)
    assert landed.outcome.tolist() == [0, 0] and landed.time.tolist() == [0.0, 0.0]
    np.testing.assert_array_equal(landed.states, x)


def test_what_becomes_of_a_landing_below_the_ground_does_not_count(monkeypatch):
    """The first is down after two seconds, and no number later, while most of the batch still flies."""
    fly = kept()

    def fails_below(model, theta, x, error):
        made = fly(model, theta, x, error)
        made[:, 0, made[-1, 2] > 30.0] = np.nan
        return made

    monkeypatch.setattr(module, "flown", fails_below)
    model, x = straight(np.array([10.0, 2.0, 2.0, 2.0]), 20.0)
    landed = descend(model, np.zeros((1, 4)), x, weather(4)[0], 0.0)
    assert landed.outcome.tolist() == [0] * 4 and landed.time.tolist() == pytest.approx([2.0, 10.0, 10.0, 10.0])
