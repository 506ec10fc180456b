"""A record written in every foreign convention reads back as it was; what can't be read is told."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pandas as pd
import pytest

import bayeschute as bc
from bayeschute.core.errors import InputError
from bayeschute.records.foreign.attitudes import in_schema, of_euler, of_matrix, product, rate_of_attitude
from bayeschute.records.foreign.conventions import DIRECTIONS, USUAL, Conventions
from bayeschute.records.plausibility.evidence import turned

TIME = np.arange(0.0, 20.0, 0.1)
RNG = np.random.default_rng(3)


def _smooth(columns: int) -> np.ndarray:
    phase = RNG.uniform(0.0, 6.0, columns)
    return np.sin(0.5 * TIME[:, None] + phase)


POSITION, VELOCITY, FORCE, RATE = 100.0 * _smooth(3), 9.0 * _smooth(3), 9.8 * _smooth(3), 0.2 * _smooth(3)
CANOPIES = np.stack([POSITION + [1.0, 5.0, -70.0], POSITION + [2.0, -5.0, -71.0]], axis=1)
WIND = np.column_stack([4.0 * _smooth(2), np.zeros(TIME.size)])
ANGLES = 0.6 * _smooth(3)
ATTITUDE = of_euler(*ANGLES.T)


def _write(path, columns):
    pd.DataFrame(columns).to_csv(path, index=False)
    return path


def _read(tmp_path, columns, mapped, **conventions):
    path = _write(tmp_path / "record.csv", {"t": TIME, **columns})
    return bc.read_record(path, {"time": ("t", "s"), **mapped}, **conventions)


def _same(q, p):
    sign = np.sign(np.sum(q * p, axis=1, keepdims=True))
    np.testing.assert_allclose(q * sign, p, atol=1e-9)


@pytest.mark.parametrize("axes", ["NED", "ENU", "NWU", "WND", "SEU", "DEN", "UNE"])
def test_vectors_along_any_earth_axes(tmp_path, axes):
    columns, mapped = {}, {}
    for i, letter in enumerate(axes):
        row, sign = DIRECTIONS[letter]
        columns |= {f"p{i}": sign * POSITION[:, row], f"c{i}": sign * CANOPIES[:, 1, row]}
        columns[f"b{i}"] = sign * CANOPIES[:, 0, row]
        mapped[f"capsule_position.{'xyz'[i]}"] = (f"p{i}", "m")
        mapped |= {f"canopy_position.1.{'xyz'[i]}": (f"b{i}", "m"), f"canopy_position.2.{'xyz'[i]}": (f"c{i}", "m")}
    found = _read(tmp_path, columns, mapped, axes=axes)
    np.testing.assert_allclose(found["capsule_position"].values, POSITION, atol=1e-9)
    np.testing.assert_allclose(found["canopy_position"].values, CANOPIES, atol=1e-9)


def test_columns_say_their_directions(tmp_path):
    columns = {"w": -POSITION[:, 1] / 0.3048, "s": -POSITION[:, 0], "u": -POSITION[:, 2]}
    mapped = {"west": ("w", "ft"), "south": ("s", "m"), "up": ("u", "m")}
    found = _read(tmp_path, columns, {f"capsule_position.{k}": v for k, v in mapped.items()})
    np.testing.assert_allclose(found["capsule_position"].values, POSITION, atol=1e-9)


@pytest.mark.parametrize("axes", ["NED", "ENU", "NWU"])
@pytest.mark.parametrize("body", ["x y z", "-z y x", "y z x", "x -y -z"])
@pytest.mark.parametrize("attitude", ["body to earth", "earth to body"])
def test_attitudes_and_body_vectors_of_any_axes(tmp_path, axes, body, attitude):
    said = Conventions(axes, body, attitude)
    theirs = product(of_matrix(said.earth().T), product(ATTITUDE, of_matrix(said.body())))
    theirs = theirs * [1, -1, -1, -1] if attitude == "earth to body" else theirs
    columns = {f"q{i}": x for i, x in enumerate(theirs.T)}
    columns |= {f"f{i}": x for i, x in enumerate((FORCE @ said.body()).T)}
    mapped = {f"capsule_attitude.{part}": (f"q{i}", "1") for i, part in enumerate("wxyz")}
    mapped |= {f"capsule_specific_force.{part}": (f"f{i}", "m/s^2") for i, part in enumerate("xyz")}
    found = _read(tmp_path, columns, mapped, axes=axes, body_axes=body, attitude=attitude)
    _same(found["capsule_attitude"].values, ATTITUDE)
    np.testing.assert_allclose(found["capsule_specific_force"].values, FORCE, atol=1e-9)


@pytest.mark.parametrize("order", ["".join(p) for p in permutations("xyz")])
def test_euler_angles_turn_as_matrices_do(tmp_path, order):
    columns = {"yaw": np.rad2deg(ANGLES[:, 0]), "pitch": np.rad2deg(ANGLES[:, 1]), "roll": np.rad2deg(ANGLES[:, 2])}
    found = _read(tmp_path, columns, {f"capsule_attitude.{k}": (k, "deg") for k in columns}, euler=order)
    c, s = np.cos(ANGLES[7]), np.sin(ANGLES[7])
    about = {
        "z": np.array([[c[0], -s[0], 0], [s[0], c[0], 0], [0, 0, 1]]),
        "y": np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]]),
        "x": np.array([[1, 0, 0], [0, c[2], -s[2]], [0, s[2], c[2]]]),
    }
    matrix = about[order[0]] @ about[order[1]] @ about[order[2]]
    q = found["capsule_attitude"].values[7:8]
    for v in np.eye(3):
        np.testing.assert_allclose(turned(q, v)[0], matrix @ v, atol=1e-9)


@pytest.mark.parametrize("sense", ["from", "towards"])
def test_wind_by_speed_and_direction(tmp_path, sense):
    sign = -1.0 if sense == "from" else 1.0
    speed = np.hypot(*WIND[:, :2].T) / (1852.0 / 3600.0)
    direction = np.rad2deg(np.arctan2(sign * WIND[:, 1], sign * WIND[:, 0])) % 360.0
    mapped = {"wind.speed": ("v", "knot"), "wind.direction": ("d", "deg")}
    found = _read(tmp_path, {"v": speed, "d": direction}, mapped, wind_is=sense)
    np.testing.assert_allclose(found["wind"].values, WIND, atol=1e-9)


def test_wind_components_from(tmp_path):
    mapped = {"wind.east": ("e", "m/s"), "wind.north": ("n", "m/s")}
    found = _read(tmp_path, {"e": -WIND[:, 1], "n": -WIND[:, 0]}, mapped, wind_is="from")
    np.testing.assert_allclose(found["wind"].values, WIND, atol=1e-9)


def test_gain_and_offset(tmp_path):
    mapped = {"riser_tension.1": ("mV", "kN", 0.5, -2.0), "altitude": ("h", "ft", -1.0)}
    found = _read(tmp_path, {"mV": (FORCE[:, 0] + 2.0) / 0.5, "h": -POSITION[:, 0] / 0.3048}, mapped)
    np.testing.assert_allclose(found["riser_tension"].values[:, 0], 1e3 * FORCE[:, 0], atol=1e-6)
    np.testing.assert_allclose(found["altitude"].values, POSITION[:, 0], atol=1e-9)


def test_a_dead_gyro_is_told_by_the_attitude(tmp_path):
    turn = np.array([0.1, -0.3, 0.2])
    angle = np.linalg.norm(turn) * TIME
    q = np.column_stack([np.cos(angle / 2), np.sin(angle / 2)[:, None] * turn / np.linalg.norm(turn)])
    np.testing.assert_allclose(rate_of_attitude(TIME, q), np.broadcast_to(turn, (TIME.size, 3)), rtol=5e-3)
    columns = {f"q{i}": x for i, x in enumerate(q.T)} | {"p": 0.1 + 0 * TIME, "r": 0.2 + 0 * TIME}
    mapped = {f"capsule_attitude.{part}": (f"q{i}", "1") for i, part in enumerate("wxyz")}
    mapped |= {"capsule_rate.x": ("p", "rad/s"), "capsule_rate.z": ("r", "rad/s")}
    found = _read(tmp_path, columns, mapped, lacks=("capsule_rate.y",))
    np.testing.assert_allclose(found["capsule_rate"].values, np.broadcast_to(turn, (TIME.size, 3)), rtol=5e-3)
    assert "from the attitude" in found.attrs["repairs"]


def test_clocks(tmp_path):
    height = 1000.0 - TIME
    stamps = (pd.Timestamp("2024-08-31T23:59:55Z") + pd.to_timedelta(TIME, unit="s")).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    of_week = (604795.0 + TIME) % 604800.0
    week = 2329 + (604795.0 + TIME >= 604800.0)
    path = _write(tmp_path / "r.csv", {"utc": stamps, "tow": of_week, "week": week, "h": height})
    altitude = {"altitude": ("h", "m")}
    found = bc.read_record(path, {"time": ("utc", "iso"), **altitude})
    np.testing.assert_allclose(found["time"].values, TIME, atol=1e-6)
    found = bc.read_record(path, {"time": ("tow", "s"), "time.week": ("week", ""), **altitude})
    np.testing.assert_allclose(found["time"].values, 604795.0 + TIME, atol=1e-6)
    found = bc.read_record(path, {"time": ("tow", "s"), **altitude}, clock_wraps=604800.0)
    np.testing.assert_allclose(found["time"].values, 604795.0 + TIME, atol=1e-6)
    with pytest.raises(InputError, match="running backward"):
        bc.read_record(path, {"time": ("tow", "s"), **altitude})


def test_rows_repeated_and_out_of_order(tmp_path):
    time = np.repeat(TIME, 2)
    columns = {"t": time, "h": np.tile([1.0, 3.0], TIME.size), "p": np.tile([np.nan, 9e4], TIME.size)}
    path = _write(tmp_path / "r.csv", columns)
    mapped = {"time": ("t", "s"), "altitude": ("h", "m"), "pressure": ("p", "Pa")}
    with pytest.raises(InputError, match="repeated time"):
        bc.read_record(path, mapped)
    for which, height in (("first", 1.0), ("last", 3.0), ("mean", 2.0)):
        found = bc.read_record(path, mapped, repeated_times=which)
        assert found.sizes["time"] == TIME.size and (found["altitude"].values == height).all()
    assert (bc.read_record(path, mapped, repeated_times="mean")["pressure"].values == 9e4).all()
    shuffled = pd.DataFrame({"t": TIME, "h": TIME}).sample(frac=1.0, random_state=1)
    shuffled.to_csv(path, index=False)
    found = bc.read_record(path, {"time": ("t", "s"), "altitude": ("h", "m")}, sort_times=True)
    np.testing.assert_array_equal(found["altitude"].values, found["time"].values)


@pytest.mark.parametrize(
    "mapped, conventions, told",
    [
        ({"wind.speed": ("a", "m/s"), "wind.direction": ("b", "deg")}, {}, "wind_is"),
        ({"wind.speed": ("a", "m/s")}, {"wind_is": "from"}, "no wind.direction"),
        ({"capsule_position.up": ("a", "m"), "capsule_position.down": ("b", "m")}, {}, "one column that tells"),
        ({"capsule_attitude.yaw": ("a", "deg")}, {}, "no capsule_attitude.pitch"),
        ({"altitude": ("a", "m")}, {"axes": "NEE"}, "axes"),
        ({"altitude": ("a", "m")}, {"body_axes": "x y -z"}, "right-handed"),
        ({"altitude": ("a", "m")}, {"euler": "zz"}, "euler"),
        ({"altitude": ("a", "m")}, {"wind_is": "of"}, "wind_is"),
        ({"altitude": ("a", "m")}, {"lacks": ("altitude",)}, "lacks"),
        ({"altitude": ("a", "m")}, {"axis": "ENU"}, "'axis'"),
        ({"altitude": ("a", "m"), "capsule_rate.x": ("b", "deg/s")}, {}, "no capsule_rate.y"),
    ],
)
def test_what_can_not_be_read_is_told(tmp_path, mapped, conventions, told):
    with pytest.raises(InputError, match=told):
        _read(tmp_path, {"a": TIME, "b": TIME}, mapped, **conventions)


def test_the_schema_s_own_attitude_is_left_alone():
    assert replace(USUAL, axes="NED") == USUAL
    np.testing.assert_allclose(in_schema(ATTITUDE, USUAL), ATTITUDE, atol=1e-12)
