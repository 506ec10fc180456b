"""Quantities implied by simple logs."""

import numpy as np
import pytest

from bayeschute.atmosphere.standard import standard_density, standard_pressure, standard_temperature
from bayeschute.core.errors import InputError
from bayeschute.records.clean import clean
from bayeschute.records.derive import (
    derive,
    descent_rate_from_altitude,
    ideal_gas_density,
    measured,
    sea_level_rate,
    smoothing_window,
    tangent_plane,
)
from bayeschute.records.record import make_record, repairs

T = np.arange(200) * 1.0
Z = 5000 - 12.0 * T


def test_density_of_dry_air():
    assert ideal_gas_density(np.array(101325.0), np.array(288.15)) == pytest.approx(1.225, rel=1e-4)


def test_simple_log_gets_everything():
    record = make_record(
        time=T, altitude=Z, pressure=standard_pressure(Z), temperature=standard_temperature(Z),
        latitude=0.8 + 1e-6 * T, longitude=np.full(T.size, -0.2),
    )  # fmt: skip
    out = derive(record)
    np.testing.assert_allclose(out["density"], standard_density(Z), rtol=1e-6)
    np.testing.assert_allclose(out["descent_rate"], 12.0)
    np.testing.assert_allclose(out["capsule_position"][:, 2], -Z)
    np.testing.assert_allclose(out["capsule_position"][-1, 0], 199e-6 * 6.366e6, rtol=1e-3)
    np.testing.assert_allclose(out["capsule_position"][:, 1], 0.0, atol=1e-9)
    assert [(r.kind, r.variable) for r in repairs(out)] == [
        ("derived", "density"), ("derived", "capsule_position"), ("derived", "descent_rate"),
    ]  # fmt: skip
    assert "humidity is ignored" in repairs(out)[0].detail
    assert out["capsule_position"].attrs["units"] == "m"


def test_altitude_and_time_are_enough():
    out = derive(make_record(time=T, altitude=Z))
    np.testing.assert_allclose(out["density"], standard_density(Z))
    assert "1976" in repairs(out)[0].detail


@pytest.mark.parametrize("warm", [0.0, 15.0])
def test_altitude_from_pressure_is_hypsometric(warm):
    """In an isothermally warmer column, the height between two pressures grows with the mean temperature."""
    p, t = standard_pressure(Z), standard_temperature(Z) + warm
    out = derive(make_record(time=T, pressure=p, temperature=t))
    rise = np.ptp(out["altitude"].values)
    assert rise == pytest.approx(np.ptp(Z) * (1 + warm / standard_temperature(Z).mean()), rel=2e-3)
    assert out["altitude"].values[-1] == pytest.approx(Z[-1], abs=1e-3)


@pytest.mark.parametrize("upward", [False, True])
def test_altitude_of_one_temperature_is_the_closed_form(upward):
    """z - z_0 = (R T/g) ln(p_0/p), sample by sample, from the lowest one on: whichever way a record goes."""
    p, warm = standard_pressure(Z), 300.0
    p = p[::-1] if upward else p
    out = derive(make_record(time=T, pressure=p, temperature=np.full(T.size, warm)))["altitude"].values
    wanted = Z[-1] + 287.053 * warm / 9.80665 * np.log(p.max() / p)
    np.testing.assert_allclose(out, wanted, atol=2e-2)
    np.testing.assert_allclose(np.sign(np.diff(out)), 1.0 if upward else -1.0)


def test_recorded_variables_are_not_replaced():
    record = make_record(time=T, altitude=Z, density=np.full(T.size, 0.5), descent_rate=np.full(T.size, 7.0))
    out = derive(record)
    assert (out["density"] == 0.5).all() and (out["descent_rate"] == 7.0).all() and repairs(out) == ()


def test_vertical_velocity_is_preferred_to_differentiation():
    velocity = np.tile([1.0, 2.0, 11.5], (T.size, 1))
    out = derive(make_record(time=T, capsule_velocity=velocity, altitude=Z))
    assert (out["descent_rate"] == 11.5).all()


def test_gaps_stay_gaps():
    z = Z.copy()
    z[50:60] = np.nan
    out = derive(make_record(time=T, altitude=z))
    assert np.isnan(out["density"].values[50:60]).all()
    assert np.isnan(out["descent_rate"].values[48:62]).all()
    assert np.isfinite(out["descent_rate"].values[62:]).all()


def test_tangent_plane_near_the_date_line_and_by_latitude():
    got = tangent_plane(np.array([0.5]), np.array([-np.pi + 1e-4]), (0.5, np.pi - 1e-4))
    assert got[0, 1] == pytest.approx(
        2e-4 * 6378137 / np.sqrt(1 - 0.00669438 * np.sin(0.5) ** 2) * np.cos(0.5), rel=1e-6
    )
    # Lengths of a minute of latitude at the equator and 45 degrees, from geodetic tables [m].
    minute = np.deg2rad(1 / 60)
    for latitude, length in ((0.0, 1842.9), (45.0, 1852.2)):
        phi = np.deg2rad(latitude)
        assert tangent_plane(np.array([phi + minute]), np.zeros(1), (phi, 0.0))[0, 0] == pytest.approx(length, rel=2e-4)


def test_window_spans_two_seconds_and_is_odd():
    assert [smoothing_window(dt) for dt in (1.0, 0.5, 0.1, 0.01)] == [5, 5, 21, 201]
    rate = descent_rate_from_altitude(1000 - 4.0 * np.arange(100) * 0.1, 0.1)
    np.testing.assert_allclose(rate, 4.0)


def test_sea_level_rate():
    assert sea_level_rate(np.array(10.0), np.array(1.225 / 4)) == pytest.approx(5.0)


def test_unfit_records_are_refused():
    uneven = make_record(time=T**1.1, altitude=Z)
    with pytest.raises(InputError, match="uniform rate"):
        derive(uneven)
    with pytest.raises(InputError, match="between -5000 and 32000"):
        derive(make_record(time=T, altitude=Z + 40000))
    nowhere = make_record(time=T, altitude=Z, latitude=np.full(T.size, np.nan), longitude=np.zeros(T.size))
    with pytest.raises(InputError, match="no fix"):
        derive(nowhere)


def _cleaned(t, rate, **arrays):
    return derive(clean(make_record(time=t, **arrays), rate))


@pytest.mark.parametrize("zero", [0.0, 3e5])
def test_what_was_bridged_is_no_measurement(zero):
    """Whenever the clock began."""
    t = np.arange(200) * 0.1
    canopies = np.tile(np.stack([0.3 * t, 0.1 * t, -8.0 * t], axis=1)[:, None], (1, 2, 1))
    canopies[50:53, 0] = np.nan
    record = _cleaned(zero + t, 10.0, canopy_position=canopies)
    assert np.isfinite(record["canopy_position"].values).all()
    first, second = (measured(record, f"canopy_position.{i}") for i in (1, 2))
    np.testing.assert_array_equal(np.flatnonzero(~first), [50, 51, 52])
    assert second.all()


@pytest.mark.parametrize("late", [0.0, 0.13])
def test_every_sample_of_a_slow_series_counts_once(late):
    """A second apart on a clock of ten a second, one missing; what is derived is no better than its source."""
    t = np.unique(np.concatenate([np.arange(0.0, 30.05, 0.1), late + np.arange(30.0)]))
    slow = np.isin(t, late + np.arange(30.0))
    slow[np.flatnonzero(slow)[12]] = False
    altitude = np.where(slow, 2000.0 - 9.0 * t - 0.05 * t**2, np.nan)
    density = 1.2 + 0.001 * t
    record = _cleaned(t, 10.0, altitude=altitude, density=density)
    nearest = np.rint(10.0 * t[slow]).astype(int)
    for name in ("altitude", "descent_rate"):
        np.testing.assert_array_equal(np.flatnonzero(measured(record, name)), nearest)
    assert measured(record, "density").all()
    assert np.isfinite(record["descent_rate"].values).sum() > 5 * nearest.size


def test_a_fast_series_on_a_slow_clock_is_measured_throughout():
    t = np.arange(400) * 0.05
    record = _cleaned(t, 2.0, altitude=2000.0 - 9.0 * t, density=1.2 + 0.0 * t)
    assert measured(record, "altitude").all()
