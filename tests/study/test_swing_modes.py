"""`bayeschute modes`: a log made by hand, measured rockets where they lie beside the project, and bad input."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.twins import damped_swing, hanging_body
from typer.testing import CliRunner

from bayeschute.cli import app
from bayeschute.core.errors import InputError
from bayeschute.records.read import ColumnSpec
from bayeschute.study import swing_modes as door
from bayeschute.swing.modal import SwingFit

ROOT = Path(__file__).parents[2]
REAL = ROOT.parent / "shared" / "realdata" / "ncsu_firm"
DT = 0.011
COLUMNS = ["time=t:s", "altitude=h:ft", "capsule_rate=gyro_*:deg/s", "capsule_specific_force=acc_*:g_0"]


def options(columns):
    return [word for column in columns for word in ("--column", column)]


def modes(*arguments):
    return CliRunner().invoke(app, ["modes", *map(str, arguments)])


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A log in the units of its maker: 15 s of tumbling, 25 s of swinging and spinning, 10 s on the ground."""
    swinging, body, rng = damped_swing, hanging_body, np.random.default_rng(4)
    n = [round(d / DT) for d in (15.0, 25.0, 10.0)]
    swing = swinging.Swing(
        frequency=0.9, damping_ratio=0.02, amplitude=(0.12, 0.08), forcing=0.05, colored=0.003, tau=2.0, white=0.0,
        samples=n[1], dt=DT, observed="angle",
    )  # fmt: skip
    tilt = swinging.make(swing, rng, kicks=1)
    mounted = Rotation.from_euler("xyz", [20.0, 100.0, -35.0], degrees=True)
    rate, force = body.log(tilt, np.linspace(-5.0, 5.0, n[1]), DT, mounted, offset=(0.04, -0.03))
    tumble = 5.0 * np.cumsum(rng.standard_normal((n[0], 3)), axis=0) * np.sqrt(DT)
    rates = np.concatenate([tumble, rate, np.zeros((n[2], 3))]) + 0.003 * rng.standard_normal((sum(n), 3))
    forces = np.concatenate([15.0 * rng.standard_normal((n[0], 3)), force, np.tile([0.0, 9.8, 0.0], (n[2], 1))])
    forces[n[0]], forces[n[0] + n[1]] = 8.0 * forces[n[0]], 12.0 * forces[n[0] + n[1]]  # opening, touchdown
    altitude = 800.0 - np.cumsum(np.repeat([25.0, 5.0, 0.0], n)) * DT + 0.2 * rng.standard_normal(sum(n))
    table = np.column_stack([np.arange(sum(n)) * DT, altitude / 0.3048, np.rad2deg(rates), forces / 9.80665])
    path = tmp_path_factory.mktemp("log") / "drop.csv"
    header = ["t", "h", *(f"gyro_{a}" for a in "xyz"), *(f"acc_{a}" for a in "xyz")]
    np.savetxt(path, table, delimiter=",", header=",".join(header), comments="", fmt="%.9g")
    return path, swing


def test_a_log_in_its_own_units(log, tmp_path):
    path, swing = log
    out = tmp_path / "modes.json"
    result = modes(path, *options(COLUMNS), "--json", out)
    assert result.exit_code == 0, result.output
    told = json.loads(out.read_text(encoding="utf-8"))
    frequency, damping = told["quantities"]["frequency"], told["quantities"]["damping_ratio"]
    assert abs(frequency["mean"] - swing.damped_frequency) < 3.0 * frequency["sd"] < 0.06
    assert abs(damping["mean"] - swing.damping_ratio) < 3.0 * damping["sd"] < 0.06
    assert told["quantities"]["amplitude"]["unit"] == "deg" and 2.0 < told["quantities"]["amplitude"]["mean"] < 14.0
    assert told["trusted"] and told["forcing"] and told["halves"]["compared"]
    assert 14.5 < told["window"][0] < 17.5 and 37.0 < told["window"][1] < 40.5
    assert f"{frequency['mean']:.4f}" in result.stdout and "excited by gusts" in result.stdout


def test_window_and_freedom_are_handed_on(log):
    path, _ = log
    given = modes(path, *options(COLUMNS), "--window", 20, 38, "--json", "-")
    free = modes(path, *options(COLUMNS), "--window", 20, 38, "--free", "--band", 0.5, 1.5, "--json", "-")
    assert given.exit_code == free.exit_code == 0
    given, free = json.loads(given.stdout), json.loads(free.stdout)
    assert given["window"] == free["window"] == [20.0, 38.0] and given["descent_rate"] is None
    assert not free["forcing"]
    assert free["quantities"]["frequency"]["sd"] < given["quantities"]["frequency"]["sd"]


def test_short_halves_are_said(log):
    path, _ = log
    found = door.find_modes(path, COLUMNS, (20.0, 25.0), (0.5, 1.5))
    assert found.halves is None and "longer record" in found.reason
    assert any(line.startswith("The halves of the record are not compared: swing") for line in door.lines(found))
    assert door.document(found)["halves"] == {"compared": False, "reason": found.reason}


def test_a_fit_that_is_not_trusted_is_exit_code_1(log, monkeypatch):
    path, _ = log
    find = door.find_modes

    def doubtful(*arguments):
        found = find(*arguments)
        fit = SwingFit(**{**vars(found.swing.fit), "trusted": False})
        return found._replace(swing=found.swing._replace(fit=fit))

    monkeypatch.setattr(door, "find_modes", doubtful)
    result = modes(path, *options(COLUMNS), "--window", 20, 38)
    assert result.exit_code == 1 and "Not reliable" in result.stdout


def test_columns():
    columns = door.columns_of(["time = t:s", "capsule_rate=g[*]:deg/s", "pressure=p*:hPa", "altitude=a:b:ft"])
    assert columns["capsule_rate.y"] == ColumnSpec("g[y]", "deg/s") and len(columns) == 6
    assert columns["pressure"] == ColumnSpec("p*", "hPa") and columns["altitude"] == ColumnSpec("a:b", "ft")
    assert columns["time"] == ColumnSpec("t", "s")
    with pytest.raises(InputError) as told:
        door.columns_of(["time=t", "time:s", "=t:s", "capsule_rate.x=a:1/s", "capsule_rate=b*:1/s"])
    assert len(told.value.faults) == 4 and "capsule_rate.x again" in str(told.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([], "--column: got no column for time"),
        (["time=t"], "got another form; wanted QUANTITY=COLUMN:UNIT"),
        (COLUMNS[:3], "a record without capsule_specific_force"),
        ([COLUMNS[0], *COLUMNS[2:]], "Or give the window."),
        ([*COLUMNS[:2], "capsule_rate=gyr_*:deg/s", COLUMNS[3]], "--column capsule_rate.x: got column 'gyr_x'"),
        ([*COLUMNS[:2], "capsule_rate=gyro_*:ft", COLUMNS[3]], "--column capsule_rate.x unit: got 'ft'"),
        ([*COLUMNS, "--window", "30", "20"], "--window: got 30 to 20 s"),
        ([*COLUMNS, "--window", "nan", "20"], "--window: got nan"),
        ([*COLUMNS, "--window", "20", "900"], "Shorten the window"),
        ([*COLUMNS, "--window", "20", "21"], "at least 3"),
        ([*COLUMNS, "--window", "20", "38", "--band", "2", "1"], "0 < low < high"),
        ([*COLUMNS, "--json", "/nowhere/x.json"], "folder that exists"),
    ],
)
def test_bad_input_is_exit_code_2(log, changes, words):
    path, _ = log
    columns = [c for c in changes if "=" in c]
    result = modes(path, *options(columns), *changes[len(columns) :])
    assert result.exit_code == 2
    assert words in result.stderr


def test_no_such_log(tmp_path):
    result = modes(tmp_path / "drop.csv", *options(COLUMNS))
    assert result.exit_code == 2 and "no such file" in result.stderr


def test_no_jax_is_needed(log):
    path, _ = log
    code = f"""
import sys
from pathlib import Path
from bayeschute.study.swing_modes import find_modes
find_modes(Path({str(path)!r}), {COLUMNS!r}, (20.0, 38.0))
print([name for name in ('jax', 'matplotlib', 'numpyro') if name in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.skipif(not REAL.is_dir(), reason="no measured rocket descents in ../shared/realdata/ncsu_firm")
@pytest.mark.parametrize(("launch", "frequency", "damping"), [(1, 0.990, 0.022), (3, 0.975, 0.005)])
def test_measured_rockets(launch, frequency, damping):
    columns = [
        "time=t_s:s", "pressure=pressure_pascals:Pa", "capsule_rate=raw_angular_rate_*_deg_per_s:deg/s",
        "capsule_specific_force=raw_acceleration_*_gs:g_0",
    ]  # fmt: skip
    result = modes(REAL / f"jackpot_launch_{launch}_descent.csv.gz", *options(columns), "--json", "-")
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)["quantities"]
    for name, value in (("frequency", frequency), ("damping_ratio", damping)):
        assert told[name]["low"] < value < told[name]["high"]
        assert told[name]["sd"] < 0.02
