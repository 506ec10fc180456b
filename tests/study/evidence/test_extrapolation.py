"""Predicted flights that swing further than any that was fitted."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from bayeschute.calibration.label import Claim, Level
from bayeschute.study.evidence.extrapolation import beyond, extrapolated


def _flight(role, most):
    """Draws of a swing between nothing and some angle [rad], evenly; one fails on the way."""
    draws = np.linspace(0.0, most, 2000).reshape(20, 100)
    draws[3, 40:] = np.nan
    return xr.Dataset({"swing_angle_draws": (("draw", "time"), draws)}, attrs={"role": role})


@pytest.mark.parametrize("most", [0.2, 0.205])
def test_a_flight_within_the_fitted_swing_is_not_told(most):
    assert beyond({"known": _flight("identify", 0.2), "coming": _flight("predict", most)}) == ()


def test_a_flight_that_swings_further_is_told_with_its_share(tmp_path):
    flights = {"known": _flight("identify", 0.2), "coming": _flight("predict", 0.4)}
    (words,) = beyond(flights)
    assert words.startswith("coming swings further than 11.4 deg, the most that was fitted, in 52 % of its predicted")
    xr.DataTree.from_dict(flights).to_netcdf(tmp_path / "predictions.nc", engine="h5netcdf")
    assert extrapolated(tmp_path) == (words,)
    assert Claim(Level.NOT_CHECKED, lacking=("nothing",), extrapolated=(words,)).sentences[-1] == words


def test_without_a_fitted_swing_or_predictions_there_is_nothing_to_tell(tmp_path):
    gone = _flight("identify", 0.2)
    gone["swing_angle_draws"] = gone["swing_angle_draws"] * np.nan
    assert beyond({"coming": _flight("predict", 0.4)}) == beyond({"a": gone, "b": _flight("predict", 0.4)}) == ()
    assert beyond({"sonde": xr.Dataset(attrs={"role": "predict"})}) == () == extrapolated(tmp_path)
