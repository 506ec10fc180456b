"""A cluster moved by hand through a swing, a flyout and a maypole: labels and coefficients of each."""

import numpy as np
import pytest

from bayeschute.records.reconstruct import ClusterGeometry, reconstruct
from bayeschute.records.record import make_record
from bayeschute.reduced.cluster_mode_laws import Canopy, flyout_slope, maypole_normal
from bayeschute.reduced.cluster_modes import cluster_modes, stretches_of
from bayeschute.reduced.mode_labels import WindowLabel

DT, LINES, SPEED = 0.1, 71.3, 10.0
t = np.arange(0.0, 180.0, DT)
GEOMETRY = ClusterGeometry(35.4, 981.8, 149.1, 3969.0, 9463.0)
SWING, FLYOUT, TURN = 2.0 * np.pi / 14.5, 2.0 * np.pi / 12.0, 2.0 * np.pi / 35.0
DENSITY = 1.1


@pytest.fixture(scope="module")
def made():
    rng = np.random.default_rng(0)
    pendulum, scissors = t < 60.0, (t >= 60.0) & (t < 120.0)
    lean = np.where(pendulum, 0.25 * np.sin(SWING * t), 0.0)
    spread = np.where(scissors, 0.18 + 0.08 * np.sin(FLYOUT * (t - 60.0)), 0.18)
    turn = np.where(t >= 120.0, TURN * (t - 120.0), 0.0)
    direction = np.empty((t.size, 2, 3))
    for i, sign in enumerate((1.0, -1.0)):
        direction[:, i, 0] = lean + sign * np.sin(spread) * np.cos(turn)
        direction[:, i, 1] = sign * np.sin(spread) * np.sin(turn)
        direction[:, i, 2] = -np.sqrt(1.0 - np.sum(direction[:, i, :2] ** 2, axis=1))
    capsule = np.column_stack([0.0 * t, 0.0 * t, SPEED * t - 3000.0])
    canopy = capsule[:, None] + LINES * direction + 0.1 * rng.standard_normal(direction.shape)
    record = make_record(
        time=t,
        capsule_position=capsule,
        capsule_velocity=np.tile([0.0, 0.0, SPEED], (t.size, 1)),
        canopy_position=canopy,
        density=np.full(t.size, DENSITY),
    )
    flown = reconstruct(record, GEOMETRY)
    return cluster_modes(record, flown, GEOMETRY, length=20.0), flown


def test_labels(made):
    modes, _ = made
    assert [s.label for s in modes.stretches] == ["pendulum", "flyout", "maypole"]
    assert [w.label for w in modes.labels][:5] == ["pendulum"] * 5


def stretch(modes, label):
    (found,) = [s for s in modes.stretches if s.label == label]
    assert found.coefficients is not None, found.reason
    return found, found.coefficients


def test_pendulum(made):
    _, coefficients = stretch(made[0], "pendulum")
    natural = coefficients.intervals["natural_frequency"]
    assert natural.mean == pytest.approx(SWING, rel=0.02)
    # A pendulum of that frequency has its pivot g/omega^2 above the capsule (6.3.1-33).
    assert coefficients.intervals["pivot"].mean == pytest.approx(9.80665 / SWING**2, rel=0.04)


def test_flyout_and_maypole(made):
    modes, flown = made
    canopy = Canopy(149.1 + DENSITY * 3969.0, 149.1 * 9.80665, LINES)
    for label, name in (("flyout", "normal_slope"), ("maypole", "normal")):
        found, coefficients = stretch(modes, label)
        here = (t >= found.start) & (t < found.end)
        load = float(flown["dynamic_pressure"].values[here].mean()) * GEOMETRY.reference_area
        if label == "flyout":
            wanted = flyout_slope(canopy, load, 12.0, np.cos(0.18))
        else:
            wanted = maypole_normal(canopy, load, LINES * np.sin(0.18), TURN)
        got = coefficients.intervals[name]
        # Stretches overlap by half a window, in which the neighbour still moves.
        assert got.mean == pytest.approx(wanted, rel=0.15 if label == "maypole" else 0.05)


def test_stretches():
    def window(start, label):
        return WindowLabel(start, start + 10.0, label, (), 0.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0))

    labels = [window(0.0, "glide"), window(5.0, "glide"), window(10.0, "flyout"), window(15.0, "glide")]
    assert stretches_of(labels) == [("glide", 0.0, 15.0), ("flyout", 10.0, 20.0), ("glide", 15.0, 25.0)]
    assert stretches_of([]) == []
