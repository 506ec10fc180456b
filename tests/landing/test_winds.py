"""Winds and turbulence of landings against their spectra and their files' words."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtri

from bayeschute.landing.turbulence import KINDS, Turbulence, field, field_size, spectrum
from bayeschute.landing.wind_plan import STEP, Event, Profile, WindPlan, shear_of

ALTITUDE = np.arange(0.0, 1000.0, STEP)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("longitudinal", [True, False])
def test_power_integrates_to_one(kind, longitudinal):
    omega = np.geomspace(1e-8, 1e6, 400_001)
    power = spectrum(kind, longitudinal, 150.0, omega)
    assert 2.0 * np.trapezoid(power * omega, np.log(omega)) == pytest.approx(1.0, abs=3e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_field_has_its_variance_and_correlation(kind):
    law = Turbulence(kind, 2.0, 1.0, 60.0, 60.0)
    size = field_size(law, 1000.0, STEP)
    made = field(law, np.random.default_rng(0).standard_normal((3, size, 1500)), STEP)
    assert made.shape == (size, 3, 1500)
    np.testing.assert_allclose(made.std(axis=(0, 2)), [2.0, 2.0, 1.0], rtol=0.06)
    lag = 30
    seen = (made[:-lag, 2] * made[lag:, 2]).mean() / made[:, 2].var()
    if kind != "von-karman":  # vertical: exponential
        assert seen == pytest.approx(np.exp(-lag * STEP / 60.0), abs=0.03)
    across = (made[:-lag, 0] * made[lag:, 0]).mean() / made[:, 0].var()
    if kind == "dryden":  # (1 - r / 2L) exp(-r / L)
        assert across == pytest.approx((1.0 - 0.5) * np.exp(-1.0), abs=0.03)


def test_members_are_equally_likely_and_scaled():
    plan = WindPlan(tuple(Profile(np.array([0.0, 500.0]), np.full((2, 3), float(i))) for i in (1, 2, 3)), scale_sd=0.1)
    u = np.random.default_rng(1).standard_normal((plan.size, 6000))
    made = plan.by_altitude(u, ALTITUDE)
    np.testing.assert_allclose(np.bincount(plan.member(u)) / 6000.0, 1.0 / 3.0, atol=0.03)
    assert np.log(made[0, 0, plan.member(u) == 1] / 2.0).std() == pytest.approx(0.1, rel=0.1)


def test_the_error_of_a_forecast():
    plan = WindPlan(error_sd=2.0, error_length=300.0)
    made = plan.by_altitude(np.random.default_rng(2).standard_normal((plan.size, 4000)), ALTITUDE)
    assert made[::50, :2].std() == pytest.approx(2.0, rel=0.06) and not made[:, 2].any()
    apart = int(300.0 / STEP)
    seen = (made[100, 0] * made[100 + apart, 0]).mean() / made[100, 0].var()
    assert seen == pytest.approx(np.exp(-1.0), abs=0.06)


def test_events_and_their_chance():
    shear = Event("shear", 400.0, 0.0, 100.0, (5.0, 0.0, 0.0), probability=0.25)
    gust = Event("gust", 600.0, 50.0, 80.0, (0.0, 0.0, 3.0))
    plan = WindPlan(events=(shear, gust))
    u = np.random.default_rng(3).standard_normal((plan.size, 4000))
    made = plan.by_altitude(u, ALTITUDE)
    below = made[int(300 / STEP), 0]
    assert set(np.unique(below)) == {0.0, 5.0} and np.mean(below > 0.0) == pytest.approx(0.25, abs=0.03)
    assert not made[int(460 / STEP), 0].any()
    np.testing.assert_allclose(made[:, 2].max(axis=0), 3.0, atol=0.02)
    np.testing.assert_allclose(ALTITUDE[made[:, 2].argmax(axis=0)].std(), 50.0, rtol=0.05)
    np.testing.assert_allclose(shear_of(made)[below > 0.0], 5.0, atol=0.1)


def test_any_direction():
    plan = WindPlan((Profile(np.array([0.0, 500.0]), np.array([[4.0, 0.0, 0.0]] * 2)),), any_direction=True)
    u = np.random.default_rng(4).standard_normal((plan.size, 4000))
    made = plan.by_altitude(u, ALTITUDE)[0]
    np.testing.assert_allclose(np.hypot(made[0], made[1]), 4.0)
    assert abs(made[0].mean()) < 0.2 and abs(made[1].mean()) < 0.2
    quarter = np.zeros((plan.size, 1))
    quarter[2] = ndtri(0.25)
    np.testing.assert_allclose(plan.by_altitude(quarter, ALTITUDE)[0, :2, 0], [0.0, 4.0], atol=1e-9)
