"""From a record to data that can be fitted."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bayeschute.errors import InputError
from bayeschute.flight.clean import clean
from bayeschute.flight.record import make_record
from bayeschute.inference import map as optimum
from bayeschute.inference.latent import Latent
from bayeschute.inference.noise import Noise
from bayeschute.inference.priors import Prior
from bayeschute.inference.records import density_profile, descent_data, filled
from bayeschute.inference.target import Hyper

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


def test_descent_data():
    record = _record()
    record["descent_rate"][5:8] = np.nan
    made = descent_data(record, GUSTS, until=20.0)
    assert made.observed.shape == made.present.shape == (60, 1)
    assert not made.present[5:8].any() and not made.present[41:].any() and made.present[:5].all()
    assert np.isfinite(made.observed).all()
    assert float(made.dt) == 0.5 and made.latent is GUSTS
    assert (made.starts, made.samples) == (1, 60)
    assert made.still().start.shape == (1,) and made.still().shocks.shape == (60, 1)


def test_a_slow_series_on_a_fast_clock_tells_no_more_than_on_its_own():
    """Descent rates two seconds apart, white noise: the same interval on their own clock and on one four times as fast."""
    rng, slow = np.random.default_rng(3), 2.0 * np.arange(31)
    rate = 9.0 + 0.3 * rng.standard_normal(slow.size)
    fast = 0.5 * np.arange(121)
    altitude = 2000.0 - 9.0 * fast
    spread = np.full(fast.size, np.nan)
    spread[::4] = rate
    noise = Noise(np.array([0.3]), np.array([1e-3]), np.array([1.0]))
    hyper = Hyper(noise, (np.array([0.05, 5.0]),))
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
