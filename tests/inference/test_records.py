"""From a record to data that can be fitted."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bayeschute.errors import InputError
from bayeschute.inference.latent import Latent
from bayeschute.inference.records import density_profile, descent_data, filled

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


def test_missing_variables_are_named():
    with pytest.raises(InputError, match="no density"):
        descent_data(_record().drop_vars("density"), GUSTS)
