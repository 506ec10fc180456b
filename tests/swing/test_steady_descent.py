"""Windows of steady descent in made-up logs whose phases are known."""

from pathlib import Path

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.records.read import ColumnSpec, read_record
from bayeschute.swing.steady_descent import parachute_window

DT = 0.05


def descent(phases, start=1500.0, rest=15.0, noise=0.3, seed=0):
    """Altitude from (duration, rate) pairs, rates smoothed over half a second, then the ground."""
    rates = np.concatenate([np.full(round(d / DT), v) for d, v in [*phases, (rest, 0.0)]])
    rates = np.convolve(np.pad(rates, 5, mode="edge"), np.ones(11) / 11, mode="valid")
    altitude = start - np.cumsum(rates) * DT
    time = np.arange(rates.size) * DT
    return time, altitude + noise * np.random.default_rng(seed).standard_normal(time.size)


DROGUE = [(3.0, -10.0), (20.0, 28.0), (30.0, 6.0)]  # still climbing, drogue, main; touchdown at 53 s


@pytest.mark.parametrize("seed", range(4))
def test_main_after_drogue(seed):
    window = parachute_window(*descent(DROGUE, seed=seed))
    assert 23.0 < window.start < 25.0
    assert 50.5 < window.end < 53.0
    assert window.descent_rate == pytest.approx(6.0, rel=0.03)
    assert window.landed


def test_a_single_parachute_from_high_up_is_one_window():
    """Speed falls with the square root of the density; the equivalent airspeed does not."""
    time = np.arange(0.0, 900.0, 0.5)
    altitude, out = 14000.0, []
    for _ in time:
        out.append(max(altitude, 0.0))
        altitude -= 0.5 * 11.0 * np.exp(altitude / 2.0 / 8500.0)
    window = parachute_window(time, np.array(out))
    assert window.start < 30.0
    assert window.end == pytest.approx(time[np.argmin(out)], abs=3.0)


def test_a_log_that_ends_in_the_air():
    window = parachute_window(*descent(DROGUE, rest=0.0))
    assert 23.0 < window.start < 25.0 and 50.5 < window.end <= 53.0
    assert not window.landed


def test_spikes_and_gaps_do_no_harm():
    time, altitude = descent(DROGUE)
    plain = parachute_window(time, altitude)
    altitude[460:463] += 200.0
    altitude[700:730] = np.nan
    spoilt = parachute_window(time, altitude)
    assert spoilt.start == pytest.approx(plain.start, abs=0.6) and spoilt.end == pytest.approx(plain.end, abs=0.6)


def test_shocks_cut_the_window():
    time, altitude = descent(DROGUE)
    force = np.tile([0.0, 0.0, 9.8], (time.size, 1))
    plain = parachute_window(time, altitude, force)
    force[np.searchsorted(time, 26.0)] *= 9.0  # a second opening shock
    force[np.searchsorted(time, 52.0)] *= 20.0  # touchdown, by the accelerometer
    force[np.searchsorted(time, 45.0)] *= 4.0  # a knock on the way
    cut = parachute_window(time, altitude, force)
    assert (cut.start, cut.end) == pytest.approx((26.5, 51.5), abs=0.06)
    assert cut.start > plain.start


def test_bad_input():
    with pytest.raises(InputError, match="at least 20"):
        parachute_window(np.arange(10.0), np.arange(10.0))
    time = np.arange(0.0, 60.0, 0.1)
    with pytest.raises(InputError, match="a log of a descent"):
        parachute_window(time, 5.0 * time)
    with pytest.raises(InputError, match="a steady descent of"):
        parachute_window(*descent([(20.0, 28.0), (3.0, 6.0)]))


HALCYON = Path(__file__).resolve().parents[3] / "shared" / "realdata" / "halcyon" / "altimeter_halcyon_10hz.csv.gz"


@pytest.mark.skipif(not HALCYON.is_file(), reason="no measured descent in ../shared/realdata/halcyon")
def test_a_measured_descent_through_thermals():
    """Apogee at 29 s, canopy open at 35 s, ground at about 655 s; the rate wanders between 2 and 7 m/s."""
    columns = {"time": ColumnSpec("ts", "s"), "altitude": ColumnSpec("filtered_altitude_AGL", "m")}
    record = read_record(HALCYON, columns)
    window = parachute_window(record["time"].values, record["altitude"].values)
    assert 30.0 < window.start < 40.0 and 650.0 < window.end < 657.0
