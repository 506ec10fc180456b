"""From a log to frequency and damping: a log made by hand, and measured rockets where they lie beside the project."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.twins import damped_swing, hanging_body

from bayeschute.core.errors import InputError
from bayeschute.records.read import ColumnSpec, read_record
from bayeschute.records.record import make_record
from bayeschute.swing import hanging_swing as module
from bayeschute.swing.hanging_swing import hanging_swing

TWINS = Path(__file__).parents[1] / "twins"
REAL = Path(__file__).resolve().parents[3] / "shared" / "realdata" / "ncsu_firm"
MOUNTED = Rotation.from_euler("xyz", [10.0, 130.0, 45.0], degrees=True)
DT = 0.011


@pytest.fixture(scope="module")
def rocket():
    """20 s of tumbling under a drogue, 25 s under a main canopy, 10 s on the ground."""
    swinging, body, rng = damped_swing, hanging_body, np.random.default_rng(3)
    n = [round(d / DT) for d in (20.0, 25.0, 10.0)]
    swing = swinging.Swing(
        frequency=0.8, damping_ratio=0.03, amplitude=(0.12, 0.08), forcing=0.05, colored=0.003, tau=2.0, white=0.0,
        samples=n[1], dt=DT, observed="angle",
    )  # fmt: skip
    tilt = swinging.make(swing, rng, kicks=1)
    spin = np.linspace(-6.0, 5.0, n[1])
    rate, force = body.log(tilt, spin, DT, MOUNTED, offset=(0.06, -0.02))
    tumble = 5.0 * np.cumsum(rng.standard_normal((n[0], 3)), axis=0) * np.sqrt(DT)
    rates = np.concatenate([tumble, rate, np.zeros((n[2], 3))]) + 0.003 * rng.standard_normal((sum(n), 3))
    shaken = 15.0 * rng.standard_normal((n[0], 3))
    forces = np.concatenate([shaken, force, np.tile([0.0, 9.8, 0.0], (n[2], 1))])
    forces[n[0]] *= 8.0
    forces[n[0] + n[1]] *= 12.0
    altitude = 800.0 - np.cumsum(np.repeat([25.0, 5.0, 0.0], n)) * DT + 0.2 * rng.standard_normal(sum(n))
    time = np.arange(sum(n)) * DT
    record = make_record(time=time, altitude=altitude, capsule_rate=rates, capsule_specific_force=forces)
    return record, swing


def test_a_spinning_swinging_rocket(rocket):
    record, swing = rocket
    found = hanging_swing(record)
    assert 20.0 < found.window.start < 22.5 and 42.0 < found.window.end < 45.0
    fit = found.fit
    assert fit.trusted and fit.cycles > 12
    assert abs(fit.frequency.mean - swing.damped_frequency) < 3.0 * fit.frequency.sd < 0.06
    assert abs(fit.damping_ratio.mean - 0.03) < 3.0 * fit.damping_ratio.sd < 0.06
    assert abs(found.motion.spin[0]) > 3.0
    given = hanging_swing(record, window=(21.0, 43.5))
    assert abs(given.fit.frequency.mean - fit.frequency.mean) < fit.frequency.sd


@pytest.mark.parametrize(("rate", "taken"), [(150.0, 150.0), (300.0, 200.0), (500.0, 200.0)])
def test_samples_that_are_faster_than_200_hz_are_averaged(rocket, monkeypatch, rate, taken):
    slow, _ = rocket
    asked = []
    monkeypatch.setattr(module, "fit_swing", lambda rate, dt, **more: asked.append((len(rate), dt)))
    found = hanging_swing(slow.interp(time=np.arange(21.0, 43.5, 1.0 / rate)), window=(22.0, 42.0))
    ((samples, dt),) = asked
    assert dt == pytest.approx(1.0 / taken) and samples == found.time.size == pytest.approx(20.0 * taken, abs=2)


def test_bad_input(rocket):
    record, _ = rocket
    with pytest.raises(InputError, match="a record without capsule_rate"):
        hanging_swing(record.drop_vars("capsule_rate"))
    with pytest.raises(InputError, match="a record of no altitude"):
        hanging_swing(record.drop_vars("altitude"))


COLUMNS = {
    "time": ColumnSpec("t_s", "s"),
    "pressure": ColumnSpec("pressure_pascals", "Pa"),
    **{f"capsule_rate.{a}": ColumnSpec(f"raw_angular_rate_{a}_deg_per_s", "deg/s") for a in "xyz"},
    **{f"capsule_specific_force.{a}": ColumnSpec(f"raw_acceleration_{a}_gs", "g_0") for a in "xyz"},
}


@pytest.mark.skipif(not REAL.is_dir(), reason="no measured rocket descents in ../shared/realdata/ncsu_firm")
@pytest.mark.parametrize(
    ("launch", "window", "frequency", "damping"),
    [
        (1, None, 0.990, 0.022),
        (1, (27.0, 42.0), 0.990, 0.022),
        (3, None, 0.975, 0.005),
        (3, (45.5, 54.0), 0.975, 0.005),
    ],
)
def test_measured_rockets(launch, window, frequency, damping):
    """Published values ("about") lie inside the 90 % intervals, whether the window is found or given."""
    record = read_record(REAL / f"jackpot_launch_{launch}_descent.csv.gz", COLUMNS)
    found = hanging_swing(record, window)
    fit = found.fit
    assert fit.trusted
    assert fit.frequency.low < frequency < fit.frequency.high and fit.frequency.sd < 0.02
    assert fit.damping_ratio.low < damping < fit.damping_ratio.high and fit.damping_ratio.sd < 0.02
    if window is None:  # the windows that a reader of the log would choose
        start, end = ((27.0, 42.0), (45.5, 54.0))[launch // 3]
        assert abs(found.window.start - start) < 1.0 and 0.0 <= found.window.end - end < 1.5
