"""Measured descents that lie beside the project: what is known to be in them is found, nothing is tuned to one file."""

from pathlib import Path

import numpy as np
import pytest

from bayeschute.records.clean import clean, repairs
from bayeschute.records.derive import derive
from bayeschute.records.read import ColumnSpec, read_record
from bayeschute.records.record import load_record, write_record

HERE = Path(__file__).resolve().parents[3] / "shared" / "realdata"
pytestmark = pytest.mark.skipif(not HERE.is_dir(), reason="no measured descents in ../shared/realdata")

C = ColumnSpec
SONDE = {
    "time": C("time_s", "s"),
    "altitude": C("gpsalt_m", "m"),
    "pressure": C("pres_hPa", "hPa"),
    "temperature": C("tdry_C", "degC"),
    "latitude": C("lat_deg", "deg"),
    "longitude": C("lon_deg", "deg"),
}
ROCKET = {
    "time": C("t_s", "s"),
    "pressure": C("pressure_pascals", "Pa"),
    "temperature": C("temperature_celsius", "degC"),
    **{f"capsule_rate.{a}": C(f"raw_angular_rate_{a}_deg_per_s", "deg/s") for a in "xyz"},
    **{f"capsule_specific_force.{a}": C(f"raw_acceleration_{a}_gs", "g_0") for a in "xyz"},
    **{f"capsule_attitude.{q}": C(f"est_quaternion_{q}", "1") for q in "wxyz"},
}
SONDES = (
    "D20200117_143249", "D20240811_173334", "D20240818_143151", "D20240831_130430",
    "D20240831_130923", "D20240831_132051", "D20240921_154046", "D20240926_142426",
)  # fmt: skip


def sonde(name, rate=1.0, **kwargs):
    return clean(read_record(HERE / "dropsonde" / f"{name}.csv.gz", SONDE), rate, **kwargs)


@pytest.mark.parametrize("name", SONDES)
def test_every_sonde_gives_a_plausible_descent(name, tmp_path):
    out = derive(sonde(name, skip_first=20.0))
    rate = out["descent_rate"].values
    inner = rate[np.isfinite(rate)]
    assert inner.size > 150
    assert 5 < np.median(inner) < 35
    assert (np.abs(inner - np.median(inner)) < 40).all()
    assert 0.2 < float(out["density"].min()) < 0.7 and 1.1 < float(out["density"].max()) < 1.25
    assert load_record(write_record(out, tmp_path / "s.nc")).equals(out)


@pytest.mark.parametrize("name", SONDES)
def test_pressure_is_never_taken_for_faulty(name):
    """The barometers of these sondes are clean: whatever is dropped there is a false alarm."""
    found = [r for r in repairs(sonde(name)) if r.variable in ("pressure", "temperature") and r.kind != "gap"]
    assert found == []


def test_jump_of_the_gps_altitude_at_420_s():
    out = sonde("D20240831_130923")
    (shift,) = [r for r in repairs(out) if r.variable == "altitude" and r.kind == "level_shift" and r.start == 420.0]
    assert shift.end == 427.0
    assert np.isnan(out["altitude"].sel(time=slice(420.5, 426.5))).all()


def test_jumps_after_release():
    found = 0
    for name in SONDES:
        early = [r for r in repairs(sonde(name)) if r.variable == "altitude" and r.start < 15.0]
        found += any(r.kind in ("level_shift", "spike") for r in early)
    assert found >= 6


def test_a_gap_of_326_s_stays_open():
    out = sonde("D20240921_154046")
    (gap,) = [r for r in repairs(out) if r.variable == "altitude" and r.kind == "gap" and r.end - r.start > 300]
    assert (gap.start, gap.end) == (59.5, 385.5)
    assert np.isnan(out["altitude"].sel(time=slice(60, 385))).all()


def test_gps_altitude_agrees_with_the_barometer_away_from_marked_shifts():
    """Altitude differences over 10 s, GPS against hydrostatic: they part where a shift was marked, not elsewhere."""
    out = sonde("D20240831_130430", skip_first=20.0)
    altitude = out["altitude"].values
    hydrostatic = derive(out.drop_vars("altitude"))["altitude"].values
    off = (altitude - hydrostatic)[10:] - (altitude - hydrostatic)[:-10]
    assert np.nanmax(np.abs(off)) < 5.0


@pytest.mark.parametrize("launch", [1, 3])
def test_rocket_logs(launch):
    record = read_record(HERE / "ncsu_firm" / f"jackpot_launch_{launch}_descent.csv.gz", ROCKET)
    out = clean(record, 10.0)
    assert all(float(np.isfinite(out[name]).mean()) > 0.97 for name in out.data_vars)
    np.testing.assert_allclose(np.linalg.norm(out["capsule_attitude"], axis=1), 1.0)
    assert (np.sum(out["capsule_attitude"].values[1:] * out["capsule_attitude"].values[:-1], axis=1) > -1e-9).all()
    # The ejection charge blows into the barometer.
    assert any(r.variable == "pressure" and r.kind in ("spike", "level_shift") and r.start < 5 for r in repairs(out))
    # Spin to some hundred degrees per second is real, not an outlier.
    assert np.abs(out["capsule_rate"]).max() > np.deg2rad(300)
    full = derive(out)
    main = full["descent_rate"].sel(time=slice(27, 42) if launch == 1 else slice(45.5, 54))
    assert 3 < float(main.median()) < 30


def test_halcyon():
    columns = {"time": C("ts", "s"), "altitude": C("filtered_altitude_AGL", "m")}
    out = clean(read_record(HERE / "halcyon" / "altimeter_halcyon_10hz.csv.gz", columns), 10.0)
    found = [r for r in repairs(out) if r.kind in ("level_shift", "spike")]
    assert found and all(27.0 < r.start < 29.0 for r in found)  # the ejection charge, again
    rate = derive(out)["descent_rate"].sel(time=slice(100, 500)).values
    assert 3 < np.median(rate) < 12
    gnss = {"time": C("ts", "s"), "latitude": C("latitude", "deg"), "longitude": C("longitude", "deg")}
    path = HERE / "halcyon" / "gnss_halcyon.csv"
    fixes = clean(read_record(path, gnss), 5.0)
    assert float(fixes["time"][-1]) < 610 and float(np.isfinite(fixes["latitude"]).mean()) > 0.6
    with pytest.raises(ValueError, match="a record from -0.69 to 609.11 s"):
        read_record(path, gnss, window=(0.0, 620.0))
