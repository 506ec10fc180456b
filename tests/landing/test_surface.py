"""Surfaces that landings touch: closed forms on a slope, and the sea against one that is sampled wave by wave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtri

from bayeschute.landing.fly_landings import fly, nested, normal_sizes
from bayeschute.landing.measures import ON_LEVEL_GROUND
from bayeschute.landing.surface import STEEPEST, Surface, SurfacePlan, Waves, against

OWN = ("normal_speed", "tangential_speed", "surface_angle", "surface_slope", "surface_slope_direction", "surface_rise")
SEA = Waves(2.5, 8.0, 0.6)
G = 9.80665


def touched(plan, u, velocity, axis=(0.0, 0.0, -1.0)):
    count = u.shape[1]
    given = (
        np.tile(np.reshape(each, (3, -1)), (1, count // np.reshape(each, (3, -1)).shape[1]))
        for each in (velocity, axis)
    )
    return against(plan.drawn(u), *given)


def sea(waves, rng, count):
    """Elevation by place (north, east) and time of long-crested seas, each a wave of random amplitude and phase."""
    a = rng.rayleigh(waves.height / 4.0, count)
    e = rng.uniform(0.0, 2.0 * np.pi, count)
    omega = 2.0 * np.pi / waves.period
    k = omega**2 / G

    def elevation(north, east, t):
        return a * np.cos(k * (north * np.cos(waves.direction) + east * np.sin(waves.direction)) - omega * t + e)

    return elevation


def slopes(elevation, h=1e-4):
    """Gradient (2, B) and rate of a sea at its origin, by differences."""
    north = (elevation(h, 0.0, 0.0) - elevation(-h, 0.0, 0.0)) / (2.0 * h)
    east = (elevation(0.0, h, 0.0) - elevation(0.0, -h, 0.0)) / (2.0 * h)
    return np.stack([north, east]), (elevation(0.0, 0.0, h) - elevation(0.0, 0.0, -h)) / (2.0 * h)


def test_level_ground_at_rest_has_the_measures_of_the_ground(plan):
    made = fly(plan, nested(plan.draws, 24))
    for name, known in ON_LEVEL_GROUND.items():
        np.testing.assert_allclose(made[name], made[known], rtol=1e-12, atol=1e-14)
    assert not any(made[name].any() for name in OWN[3:])


def test_speeds_on_a_slope_are_those_of_the_closed_form():
    """Down a slope s towards azimuth a: into it v cos s - w sin s, along it v sin s + w cos s, w downhill."""
    s, a, v, w, across = 0.2, 0.7, 9.0, 4.0, 1.5
    velocity = [w * np.cos(a) - across * np.sin(a), w * np.sin(a) + across * np.cos(a), v]
    made = touched(SurfacePlan((s, 0.0), a), np.zeros((3, 1)), velocity)
    assert made["normal_speed"][0] == pytest.approx(v * np.cos(s) - w * np.sin(s))
    assert made["tangential_speed"][0] == pytest.approx(np.hypot(v * np.sin(s) + w * np.cos(s), across))
    assert made["surface_angle"][0] == pytest.approx(s) and made["surface_slope"][0] == pytest.approx(s)
    assert made["surface_slope_direction"][0] == pytest.approx(a) and made["surface_rise"][0] == 0.0


@pytest.mark.parametrize("lean", [-0.3, 0.0, 0.1, 0.5])
def test_the_angle_to_a_slope_is_that_of_the_lean_less_the_slope(lean):
    """The axis leans downhill by so much: a heat shield that leans as the slope does lies flat on it."""
    s, a = 0.1, -2.0
    axis = [np.sin(lean) * np.cos(a), np.sin(lean) * np.sin(a), -np.cos(lean)]
    made = touched(SurfacePlan((s, 0.0), a), np.zeros((3, 1)), [0.0, 0.0, 9.0], axis)
    assert made["surface_angle"][0] == pytest.approx(abs(lean - s), abs=1e-12)


def test_slopes_are_drawn_to_any_side_and_held_before_they_are_walls():
    u = np.random.default_rng(0).standard_normal((3, 20_000))
    made = touched(SurfacePlan((0.1, 0.02)), u, [0.0, 0.0, 9.0])
    assert made["surface_slope"].mean() == pytest.approx(0.1, abs=1e-3)
    assert made["surface_slope"].std() == pytest.approx(0.02, rel=0.03)
    way = made["surface_slope_direction"]
    np.testing.assert_allclose([np.cos(way).mean(), np.sin(way).mean()], 0.0, atol=0.02)
    np.testing.assert_allclose(np.histogram(way, 4, (-np.pi, np.pi))[0] / u.shape[1], 0.25, atol=0.015)
    steep = touched(SurfacePlan((STEEPEST, 1.0)), u, [0.0, 0.0, 9.0])
    assert steep["surface_slope"].max() == pytest.approx(STEEPEST)
    down = touched(SurfacePlan((0.0, 0.1), 0.5), u, [0.0, 0.0, 9.0])["surface_slope_direction"]
    np.testing.assert_allclose(np.unique(down.round(9)), [0.5 - np.pi, 0.5], atol=1e-8)  # less than none: the other way


def test_moments_of_the_sea_are_those_of_one_that_is_sampled():
    """Variances and covariances of gradient, rise and drift; the drift of deep water is omega times the elevation."""
    count, rng = 200_000, np.random.default_rng(1)
    elevation = sea(SEA, rng, count)
    gradient, rise = slopes(elevation)
    drift = SEA.frequency * elevation(0.0, 0.0, 0.0) * np.array([[np.cos(0.6)], [np.sin(0.6)]])
    want = np.cov(np.concatenate([gradient, rise[None], drift]))
    drawn = SurfacePlan(waves=SEA).drawn(rng.standard_normal((3, count)))
    made = np.cov(np.concatenate([drawn.gradient, drawn.rise[None], drawn.drift]))
    scale = np.sqrt(np.outer(np.diag(want), np.diag(want)))
    np.testing.assert_allclose(made / scale, want / scale, atol=0.015)
    sd = SEA.height / 4.0
    assert np.hypot(*drawn.gradient).std() / np.sqrt(1.0 - 2.0 / np.pi) == pytest.approx(SEA.number * sd, rel=0.01)
    assert drawn.rise.std() == pytest.approx(SEA.frequency * sd, rel=0.01)
    # Laws, not only moments: amplitudes of the rise are Rayleigh's, so quantiles of a normal law.
    levels = np.array([0.01, 0.1, 0.3, 0.7, 0.9, 0.99])
    np.testing.assert_allclose(np.quantile(rise, levels), SEA.frequency * sd * ndtri(levels), atol=0.02)
    np.testing.assert_allclose(np.quantile(drawn.rise, levels), SEA.frequency * sd * ndtri(levels), atol=0.02)


def test_the_front_of_a_wave_rises_and_descends_along_its_way():
    drawn = SurfacePlan(waves=replace(SEA, direction=0.0)).drawn(np.array([[0.0], [1.0], [0.0]]))
    assert drawn.rise[0] > 0.0 and drawn.gradient[0, 0] < 0.0 and drawn.gradient[1, 0] == 0.0
    crest = SurfacePlan(waves=replace(SEA, direction=0.0)).drawn(np.array([[1.0], [0.0], [0.0]]))
    assert crest.drift[0, 0] > 0.0 and crest.rise[0] == 0.0  # at a crest the water goes along


def test_the_speed_into_the_sea_is_that_at_which_the_gap_closes():
    """A point falls on a sampled sea: minus the rate of its height over the surface, by differences, along the normal."""
    elevation, h = sea(SEA, np.random.default_rng(2), 50), 1e-5
    gradient, rise = slopes(elevation)
    drift = SEA.frequency * elevation(0.0, 0.0, 0.0) * np.array([[np.cos(0.6)], [np.sin(0.6)]])
    velocity = np.array([3.0, -2.0, 9.0])

    def gap(t):
        return -velocity[2] * t - elevation(velocity[0] * t, velocity[1] * t, t)

    closing = -(gap(h) - gap(-h)) / (2.0 * h) / np.sqrt(1.0 + (gradient**2).sum(axis=0))
    axis = np.tile([[0.0], [0.0], [-1.0]], 50)
    made = against(Surface(gradient, rise, drift), np.tile(velocity[:, None], 50), axis)
    np.testing.assert_allclose(made["normal_speed"], closing, rtol=1e-6)
    np.testing.assert_allclose(made["surface_angle"], np.arctan(np.hypot(*gradient)), rtol=1e-6)


def test_what_moves_with_the_water_has_no_speed_against_it():
    drawn = SurfacePlan(waves=SEA).drawn(np.random.default_rng(3).standard_normal((3, 40)))
    up = drawn.rise + (drawn.drift * drawn.gradient).sum(axis=0)
    made = against(drawn, np.stack([*drawn.drift, -up]), np.tile([[0.0], [0.0], [-1.0]], 40))
    np.testing.assert_allclose([made["normal_speed"], made["tangential_speed"]], 0.0, atol=1e-12)


def test_waves_of_any_direction():
    u = np.random.default_rng(4).standard_normal((3, 20_000))
    drawn = SurfacePlan(waves=replace(SEA, direction=None)).drawn(u)
    cov = np.cov(drawn.gradient)
    each = (SEA.number * SEA.height / 4.0) ** 2 / 2.0
    np.testing.assert_allclose(cov, np.diag([each, each]), atol=0.05 * each)


def test_a_surface_changes_nothing_but_its_own_columns_and_has_a_number_of_its_own(plan):
    ids = nested(plan.draws, 24)
    level, rough = fly(plan, ids), fly(replace(plan, surface=SurfacePlan(waves=SEA)), ids)
    for name in level.dtype.names:
        assert (level[name].tobytes() == rough[name].tobytes()) == (name not in OWN), name
    assert normal_sizes(plan, 0)[-1] == 0 and len(set(rough["surface_rise"])) == 24
    ids[1:] = ids[0]
    ids[:, 5] = [7, 7, *range(22)]
    again = fly(replace(plan, surface=SurfacePlan(waves=SEA)), ids)
    assert len(set(again["vertical_speed"])) == 1 and len(set(again["normal_speed"])) == 22
    assert again["normal_speed"][0] == again["normal_speed"][1]
