"""What a forecast tells people: angles in deg as figures have them, while data stay in SI."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bayeschute.api.forecast import Forecast


@pytest.fixture
def swinging() -> Forecast:
    draws = np.deg2rad(np.linspace(4.0, 6.0, 101))[:, None] * np.ones(5)
    values = {
        "swing_angle": (("draw", "time"), draws, {"units": "rad"}),
        "descent_rate": (("draw", "time"), 10.0 + draws, {"units": "m/s"}),
    }
    data = xr.Dataset(values, {"time": np.arange(5.0)}, {"failed": 0, "flight": "a"})
    return Forecast("a", data, np.zeros(5, bool), {}, None, {}, 101, {}, 0)


def test_the_table_has_the_units_of_the_figure(swinging):
    told = swinging.summary("maximum")
    assert told["unit"].to_dict() == {"swing_angle": "deg", "descent_rate": "m/s"}
    assert told.loc["swing_angle", "median"] == pytest.approx(5.0)
    assert "<td>deg</td>" in swinging._repr_html_() and "rad" not in swinging._repr_html_()


def test_data_stay_in_si(swinging):
    band = swinging.band("swing_angle")
    assert band.attrs["units"] == "rad" and float(band["median"][0]) == pytest.approx(np.deg2rad(5.0))
    assert swinging.statistic("swing_angle").attrs["units"] == "rad"
