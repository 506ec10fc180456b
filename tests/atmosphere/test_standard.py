"""US Standard Atmosphere 1976 against its printed tables."""

import numpy as np
import pytest

from bayeschute.atmosphere.standard import (
    SEA_LEVEL_DENSITY,
    pressure_altitude,
    standard_density,
    standard_pressure,
    standard_temperature,
)
from bayeschute.core.errors import InputError

# Geometric altitude [m], temperature [K], pressure [Pa], density [kg/m^3], from table I of the 1976 standard.
TABLE = np.array(
    [
        [0, 288.150, 101325.0, 1.2250],
        [1000, 281.651, 89876.0, 1.1117],
        [5000, 255.676, 54048.0, 0.73643],
        [10000, 223.252, 26500.0, 0.41351],
        [15000, 216.650, 12111.0, 0.19476],
        [20000, 216.650, 5529.3, 0.088910],
        [30000, 226.509, 1197.0, 0.018410],
    ]
)


def test_matches_the_printed_tables():
    z = TABLE[:, 0]
    np.testing.assert_allclose(standard_temperature(z), TABLE[:, 1], atol=2e-3)
    np.testing.assert_allclose(standard_pressure(z), TABLE[:, 2], rtol=1e-4)
    np.testing.assert_allclose(standard_density(z), TABLE[:, 3], rtol=1e-4)


def test_is_continuous_and_falls_everywhere():
    density = standard_density(np.linspace(-5000, 32000, 20001))
    assert (np.diff(density) < 0).all()
    assert np.abs(np.diff(np.log(density))).max() < 4e-4


def test_pressure_altitude_is_the_inverse():
    z = np.linspace(-4900, 31900, 301)
    np.testing.assert_allclose(pressure_altitude(standard_pressure(z)), z, atol=1e-5)


def test_nan_stays_nan_and_shape_is_kept():
    z = np.array([[0.0, np.nan], [1000.0, 15000.0]])
    assert np.isnan(standard_density(z)).tolist() == [[False, True], [False, False]]
    assert np.isnan(pressure_altitude(np.array([np.nan]))).all()


@pytest.mark.parametrize("altitude", [-5001.0, 32001.0])
def test_altitudes_beyond_the_standard_are_refused(altitude):
    with pytest.raises(InputError, match="Give a recorded density"):
        standard_density(altitude)


def test_pressures_beyond_the_standard_are_refused():
    with pytest.raises(InputError, match="pressure altitude"):
        pressure_altitude([1e6])


def test_the_density_at_sea_level_is_that_of_the_table():
    assert SEA_LEVEL_DENSITY == pytest.approx(TABLE[0, 3], rel=1e-4)
    assert SEA_LEVEL_DENSITY == pytest.approx(float(standard_density(np.array(0.0))), rel=1e-5)
