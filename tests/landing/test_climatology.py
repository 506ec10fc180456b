"""Winds of a climatology: mean, standard deviation and correlation come back; other winds keep their numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.landing.climatology import DAYS, NODES, Scatter
from bayeschute.landing.turbulence import Turbulence
from bayeschute.landing.wind_plan import STEP, Event, Profile, WindPlan

ALTITUDE = np.arange(0.0, 1000.0, STEP)
H = np.array([0.0, 400.0, 1200.0])
MEAN = Profile(H, np.array([[1.0, -2.0, 0.0], [4.0, -3.0, 0.0], [9.0, 1.0, 0.0]]))
SCATTER = Scatter(H, np.array([[1.0, 2.0], [3.0, 2.5], [5.0, 6.0]]), np.array([-0.5, 0.2, 0.6]))


def winds(plan, count=20_000, seed=0, altitude=ALTITUDE[::10]):
    return plan.by_altitude(np.random.default_rng(seed).standard_normal((plan.size, count)), altitude)


@pytest.mark.parametrize("length", [60.0, 800.0])
def test_mean_and_scatter_come_back_at_every_altitude(length):
    """Between the nodes of the process, too, where lines between them would have too little."""
    made = winds(WindPlan((MEAN,), scatter=(SCATTER,), scatter_length=length))
    h = ALTITUDE[::10]
    sd = np.stack([np.interp(h, H, v) for v in SCATTER.sd.T], axis=1)
    np.testing.assert_allclose(made[:, :2].std(axis=2), sd, rtol=0.035)
    want = np.stack([np.interp(h, H, v) for v in MEAN.wind.T], axis=1)
    np.testing.assert_allclose((made.mean(axis=2) - want)[:, :2] / sd, 0.0, atol=0.035)
    assert not made[:, 2].any()
    r = [np.corrcoef(each)[0, 1] for each in made[:, :2]]
    np.testing.assert_allclose(r, np.interp(h, H, SCATTER.correlation), atol=0.04)


def test_winds_are_correlated_in_altitude_by_the_length():
    made = winds(WindPlan((MEAN,), scatter=(SCATTER,), scatter_length=300.0))
    for apart in (5, 15, 30):
        seen = np.corrcoef(made[10, 0], made[10 + apart, 0])[0, 1]
        assert seen == pytest.approx(np.exp(-apart * 10 * STEP / 300.0), abs=0.03)


def test_months_are_as_likely_as_they_have_days():
    june = Profile(H, np.full((3, 3), 6.0))
    plan = WindPlan((MEAN, june), weights=(DAYS[1], DAYS[5]), scatter=(SCATTER, SCATTER))
    u = np.random.default_rng(5).standard_normal((plan.size, 40_000))
    share = np.bincount(plan.member(u)) / 40_000
    np.testing.assert_allclose(share, np.array([28.2425, 30.0]) / 58.2425, atol=0.008)
    made = plan.by_altitude(u, ALTITUDE[::100])
    assert made[0, 0, plan.member(u) == 1].mean() == pytest.approx(6.0, abs=0.05)
    assert plan.member(np.full((plan.size, 1), 50.0))[0] == 1 and sum(DAYS) == 365.2425


def test_events_errors_and_factors_add_to_it():
    gust = Event("gust", 600.0, 0.0, 80.0, (0.0, 0.0, 3.0))
    plan = WindPlan((MEAN,), events=(gust,), scatter=(SCATTER,), error_sd=4.0, error_length=5000.0)
    np.testing.assert_allclose(winds(plan, 500, altitude=ALTITUDE)[:, 2].max(axis=0), 3.0, atol=0.02)
    np.testing.assert_allclose(winds(plan)[0, :2].std(axis=1), np.sqrt(np.array([1.0, 2.0]) ** 2 + 4.0**2), rtol=0.03)
    still = Scatter(H, 0.0 * SCATTER.sd, SCATTER.correlation)
    u = np.random.default_rng(1).standard_normal((plan.size, 50))
    sure = replace(plan, scatter=(still,), scale_sd=0.2)
    np.testing.assert_array_equal(
        sure.by_altitude(u, ALTITUDE), replace(sure, scatter=()).by_altitude(_without_scatter(u), ALTITUDE)
    )


def _without_scatter(u):
    return np.concatenate([u[: 3 + 2 * NODES], u[3 + 4 * NODES :]])


def test_winds_without_a_climatology_are_what_they_were():
    """Their numbers, by the words of the docstring: member, factor, azimuth, error at 24 altitudes, two of each event."""
    events = (
        Event("shear", 400.0, 30.0, 100.0, (5.0, 1.0, 0.0), 0.5),
        Event("gust", 600.0, 0.0, 80.0, (0.0, 0.0, 3.0)),
    )
    members = (MEAN, Profile(H, -MEAN.wind))
    plan = WindPlan(members, 0.1, False, 2.0, 300.0, events, Turbulence("ou", 1.0, 1.0, 50.0, 50.0))
    assert WindPlan().size == 51 and plan.size == 55
    u = np.random.default_rng(2).standard_normal((plan.size, 9))
    made = plan.by_altitude(u, ALTITUDE)
    nodes = np.linspace(ALTITUDE[0], ALTITUDE[-1], 24)
    keep = np.exp(-(nodes[1] - nodes[0]) / 300.0)
    for b in range(9):
        want = np.stack([np.interp(ALTITUDE, H, v) for v in members[int(u[0, b] > 0.0)].wind.T], axis=1)
        want *= np.exp(0.1 * u[1, b])
        z = u[3:51, b].reshape(24, 2)
        x = [z[0]]
        for row in z[1:]:
            x.append(keep * x[-1] + np.sqrt(1.0 - keep**2) * row)
        want[:, :2] += 2.0 * np.stack([np.interp(ALTITUDE, nodes, v) for v in np.array(x).T], axis=1)
        if u[52, b] <= 0.0:
            want += np.clip((400.0 + 30.0 * u[51, b] - ALTITUDE) / 100.0 + 0.5, 0.0, 1.0)[:, None] * [5.0, 1.0, 0.0]
        below = np.clip((600.0 - ALTITUDE) / 80.0 + 0.5, 0.0, 1.0)
        want[:, 2] += 1.5 * (1.0 - np.cos(2.0 * np.pi * below))
        np.testing.assert_allclose(made[:, :, b], want, atol=1e-12)
