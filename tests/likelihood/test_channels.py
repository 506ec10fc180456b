"""From a record to data that can be fitted."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bayeschute.compiler.runge_kutta import Stepping
from bayeschute.core.errors import InputError
from bayeschute.dynamics.initial_state import deviation_names
from bayeschute.likelihood import channels
from bayeschute.likelihood.channels import density_profile, descent_data, filled, initial_motion
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import joint_mode as optimum
from bayeschute.records.clean import clean
from bayeschute.records.record import make_record

GUSTS = Latent(("drift",), ((0, 0),))


def _record(samples=60):
    time = 0.5 * np.arange(samples)
    altitude = 2000.0 - 9.0 * time
    density = 1.225 * np.exp(-altitude / 9000.0)
    made = xr.Dataset(coords={"time": time})
    for name, values in {"altitude": altitude, "density": density, "descent_rate": np.full(samples, 9.0)}.items():
        made[name] = ("time", values.copy())
    return made


def test_gaps_of_inputs_are_filled():
    values = np.array([[np.nan, 1.0], [2.0, np.nan], [np.nan, 3.0], [4.0, np.nan]])
    np.testing.assert_allclose(filled(values, "x"), [[2.0, 1.0], [2.0, 2.0], [3.0, 3.0], [4.0, 3.0]])
    assert np.isnan(values[0, 0])  # the caller's array is left alone


def test_an_empty_input_is_refused():
    with pytest.raises(InputError, match="no value in the window"):
        filled(np.full(4, np.nan), "wind")


@pytest.mark.parametrize("top", [800.0, 9000.0])
def test_density_profile_follows_the_atmosphere(top):
    altitude = np.linspace(top, 0.0, 400)
    density = 1.225 * np.exp(-altitude / 9000.0)
    spoiled = np.where(np.arange(400) % 7 == 0, np.nan, density)
    np.testing.assert_allclose(density_profile(altitude, spoiled).density(altitude), density, rtol=1e-4)


def test_density_profile_passes_through_what_was_measured_at_its_nodes():
    """One sample at each; the air is a little denser and thinner by turns than the straight line through its logarithm."""
    altitude = np.arange(0.0, 2500.0, 100.0)
    density = np.exp(0.2 - altitude / 9000.0 + 0.01 * np.sin(altitude / 300.0))
    np.testing.assert_allclose(density_profile(altitude, density).density(altitude), density, rtol=1e-6)


def test_descent_data():
    record = _record()
    record["descent_rate"][5:8] = np.nan
    made = descent_data(record, GUSTS, until=20.0)
    assert made.observed.shape == made.present.shape == (60, 1)
    assert not made.present[5:8].any() and not made.present[41:].any() and made.present[:5].all()
    assert np.isfinite(made.observed).all()
    assert float(made.dt) == 0.5 and made.latent is GUSTS
    assert (made.starts, made.samples) == (1, 60)
    assert made.still().start.shape == (1,) and made.still().process_noise.shape == (60, 1)


def test_the_zero_of_the_clock_does_not_matter():
    record = _record()
    late = record.assign_coords(time=record["time"] + 300.0)
    one, other = descent_data(record, GUSTS, until=20.0), descent_data(late, GUSTS, until=320.0)
    assert float(other.dt) == float(other.model.dt) == 0.5 and other.model.stepping == one.model.stepping == Stepping(2)
    for name in ("observed", "present"):
        np.testing.assert_array_equal(getattr(other, name), getattr(one, name))


def test_a_slow_series_on_a_fast_clock_tells_no_more_than_on_its_own():
    """Descent rates two seconds apart, white noise: the same interval on their own clock and on one four times as fast."""
    rng, slow = np.random.default_rng(3), 2.0 * np.arange(31)
    rate = 9.0 + 0.3 * rng.standard_normal(slow.size)
    fast = 0.5 * np.arange(121)
    altitude = 2000.0 - 9.0 * fast
    spread = np.full(fast.size, np.nan)
    spread[::4] = rate
    noise = Noise(np.array([0.3]), np.array([1e-3]), np.array([1.0]))
    hyper = NoiseParameters(noise, (np.array([0.05, 5.0]),))
    priors = [Prior("cds_over_mass", np.log(0.2), 0.5, True, "m^2/kg", "")]
    sds = []
    for step, values in ((1, spread), (4, rate)):
        time, h = fast[::step], altitude[::step]
        made = make_record(time=time, altitude=h, density=1.225 * np.exp(-h / 9000.0), descent_rate=values)
        flight = descent_data(clean(made, 1.0 / (time[1] - time[0])), GUSTS)
        assert flight.present.sum() == slow.size
        sds.append(np.sqrt(optimum.fit([flight], hyper, priors, np.array([np.log(0.2)])).covariance[0, 0]))
    assert sds[0] == pytest.approx(sds[1], rel=0.03)


def test_missing_variables_are_named():
    with pytest.raises(InputError, match="no density"):
        descent_data(_record().drop_vars("density"), GUSTS)


def test_an_opening_is_a_quadratic_and_what_the_record_scatters_about_it():
    """The first second and a half alone; a gap is passed over, few samples have a mean, none have nothing."""
    time, rng = 3.0 + 0.1 * np.arange(60), np.random.default_rng(1)
    t = time - time[0]
    smooth = np.stack([2.0 - 0.5 * t + 0.3 * t**2, 1.0 + 4.0 * t], axis=1)
    smooth[t > 1.55] = 1e3
    smooth[4:7, 0] = np.nan
    made = initial_motion(time, smooth)
    np.testing.assert_allclose(made.value, [2.0, 1.0])
    np.testing.assert_allclose(made.slope, [-0.5, 4.0])
    np.testing.assert_allclose(made.scatter, 0.0, atol=1e-12)
    fast = 3.0 + 1e-3 * np.arange(2000)
    noisy = initial_motion(fast, 1.0 + 0.2 * rng.standard_normal((2000, 3, 2)))
    assert noisy.value.shape == noisy.slope.shape == noisy.scatter.shape == (3, 2)
    np.testing.assert_allclose(noisy.scatter, 0.2, rtol=0.06)
    few = np.full((60, 2), np.nan)
    few[[0, 5, 9], 0] = 1.0, 2.0, 6.0
    seen = initial_motion(time, few)
    np.testing.assert_allclose([seen.value[0], seen.slope[0], seen.scatter[0]], [3.0, 0.0, np.sqrt(14.0 / 3.0)])
    assert np.isnan([part[1] for part in seen]).all()


def _widths(velocity=0.0, rate: float | None = 0.0, direction=0.0, attitude=True):
    """Standard deviations of the start by kind, all of a kind alike."""
    made = channels._start_scale(2, attitude, channels._Scatter(velocity, rate, direction))
    kinds = [name.split(".")[0] for name in deviation_names(2)]
    assert made.shape == (len(kinds),)
    found = {kind: {float(x) for x, k in zip(made, kinds, strict=True) if k == kind} for kind in kinds}
    assert all(len(values) == 1 for values in found.values())
    return {kind: values.pop() for kind, values in found.items()}


def test_what_a_record_s_opening_scatters_widens_the_start():
    least = {"velocity": 0.5, "attitude": 0.02, "rate": 0.02, "direction": 0.01, "turning": 0.02}
    assert _widths() == least == _widths(0.01, 0.001, 0.001)
    wide = _widths(0.4, 0.1, 0.03)
    assert wide == pytest.approx(least | {"velocity": 1.2, "rate": 0.3, "direction": 0.09, "turning": 0.06})
    assert _widths(rate=None, attitude=False) == least | {"attitude": 0.1, "rate": 0.2}
