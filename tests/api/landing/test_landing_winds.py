"""Statistics of the wind from arrays: the same as a campaign file says them."""

from __future__ import annotations

import doctest
from importlib import import_module

import numpy as np
import pytest

import bayeschute as bc
from bayeschute.api.landing.landing_winds import wind_climatology
from bayeschute.study.landing_campaign.campaign_climatology import ClimatologyTable

ALTITUDE, NORTH, EAST = [0, 500.5, 2000.0], np.array([3.0, -0.1, 6.0]), [1.0, -2.0, 1e-3]
NORTH_SD, EAST_SD = [2.0, 2.5, 4.0], (1.5, 0.1, 5.0)


def test_it_is_the_table_of_a_campaign_file_in_its_units():
    made = wind_climatology(ALTITUDE, NORTH, EAST, NORTH_SD, EAST_SD, length=1500, correlation=[0.1, -0.2, 0.9])
    written = ClimatologyTable.model_validate({
        "altitude": ["0 m", "0.5005 km", "2 km"], "north": ["10.8 km/h", "-0.1 m/s", "6 m/s"],
        "east": ["1 m/s", "-2 m/s", "1 mm/s"], "north_sd": ["2 m/s", "2.5 m/s", "4 m/s"],
        "east_sd": ["1.5 m/s", "0.1 m/s", "5 m/s"], "length": "1.5 km", "correlation": [0.1, -0.2, 0.9],
    })  # fmt: skip
    for name in ("altitude", "north", "east", "north_sd", "east_sd", "correlation", "length"):
        np.testing.assert_allclose(getattr(made, name), getattr(written, name), rtol=1e-14, err_msg=name)
    assert made.length == 1500.0 and made.correlation == (0.1, -0.2, 0.9)


def test_numbers_are_those_that_were_given_to_the_last_digit():
    values = np.random.default_rng(0).uniform(0.1, 9.0, (4, 3))
    made = wind_climatology(ALTITUDE, *values, length=1.0 / 3.0)
    for name, row in zip(("north", "east", "north_sd", "east_sd"), values, strict=True):
        assert getattr(made, name) == tuple(row), name
    assert made.altitude == (0.0, 500.5, 2000.0) and made.length == 1.0 / 3.0


def test_without_a_correlation_north_and_east_are_independent():
    made = wind_climatology(ALTITUDE, NORTH, EAST, NORTH_SD, EAST_SD, length=800.0)
    none = wind_climatology(ALTITUDE, NORTH, EAST, NORTH_SD, EAST_SD, length=800.0, correlation=np.zeros(3))
    assert made.rows()[0][1].tolist() == none.rows()[0][1].tolist()
    (_, table), *_ = made.rows()
    np.testing.assert_array_equal(table[:, -1], 0.0)


def test_columns_may_be_upright():
    upright = [np.reshape(one, (-1, 1)) for one in (ALTITUDE, NORTH, EAST, NORTH_SD, EAST_SD)]
    made = wind_climatology(*upright, length=800.0, correlation=[[0.1], [0.2], [0.3]])
    assert made == wind_climatology(ALTITUDE, NORTH, EAST, NORTH_SD, EAST_SD, length=800.0, correlation=[0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"altitude": [0.0, 500.0, 400.0]}, "altitude"), ({"north": [1.0, 2.0]}, "north"),
        ({"north_sd": [1.0, -2.0, 1.0]}, "north_sd"), ({"east_sd": [1.0, np.nan, 1.0]}, "east_sd"),
        ({"length": 0.0}, "length"), ({"length": -5.0}, "length"), ({"correlation": [0.0, 0.0, 1.5]}, "correlation"),
        ({"correlation": [0.0, 0.0]}, "correlation"),
    ],
)  # fmt: skip
def test_what_is_no_climatology_is_refused_by_its_column(change, where):
    given = {
        "altitude": ALTITUDE,
        "north": NORTH,
        "east": EAST,
        "north_sd": NORTH_SD,
        "east_sd": EAST_SD,
        "length": 9.0,
    }
    with pytest.raises(bc.InputError, match=f"wind_climatology.*{where}"):
        wind_climatology(**given | change)


def test_the_example_of_the_docstring_runs():
    found = doctest.testmod(import_module("bayeschute.api.landing.landing_winds"))
    assert found.failed == 0 and found.attempted == 3
