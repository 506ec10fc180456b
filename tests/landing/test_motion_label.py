"""Labels of many windows against those of one (`reduced.mode_labels`), cones, phases."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.landing.measures import LABELS
from bayeschute.landing.motion_label import motion
from bayeschute.reduced.mode_labels import label_windows

DT, T = 0.2, 75
TIME = DT * np.arange(T)


def directions(swing=(0.0, 0.0), flyout=0.15, flap=0.0, turn=0.0, phase=0.0):
    """Two risers: mean direction (T, 2) by amplitudes north and east, flyout that flaps, turn [rad/s]."""
    at = 2.0 * np.pi * TIME / 12.0 + phase
    mean = np.stack([swing[0] * np.cos(at), swing[1] * np.sin(at)], axis=1)
    size = flyout + flap * np.sin(2.0 * np.pi * TIME / 5.0)
    around = np.stack([np.cos(turn * TIME), np.sin(turn * TIME)], axis=1)
    both = np.stack([mean + s * size[:, None] * around for s in (1.0, -1.0)], axis=1)
    return both


CASES = {
    "steady": directions(),
    "pendulum": directions((0.2, 0.0)),
    "cone": directions((0.2, 0.18)),
    "flyout": directions(flap=0.08),
    "maypole": directions(turn=0.3),
}


@pytest.mark.parametrize("name", CASES)
def test_labels_are_those_of_single_windows(name):
    across = CASES[name]
    whole = np.concatenate([across, -np.sqrt(1.0 - (across**2).sum(axis=2, keepdims=True))], axis=2)
    path = np.array([0.5, 0.2, 9.0])
    found = motion(np.moveaxis(across, 2, 1)[..., None], path[:, None], DT)
    assert LABELS[found.label[0]] == name
    want = label_windows(TIME, whole, np.broadcast_to(path, (T, 2, 3)), length=T * DT)[0]
    assert want.label == ("pendulum" if name == "cone" else name)
    assert found.amplitude[0] == pytest.approx(want.swing_amplitude, abs=1e-12)
    assert found.turning[0] == pytest.approx(want.turning, abs=1e-12)
    assert found.glide_angle[0] == pytest.approx(want.glide_angle, abs=1e-12)


def test_a_glide():
    across = np.moveaxis(CASES["steady"], 2, 1)[..., None]
    assert LABELS[motion(across, np.array([[3.0], [0.0], [9.0]]), DT).label[0]] == "glide"


@pytest.mark.parametrize("phase", [0.3, 1.2, -0.9])
def test_the_phase_at_touchdown(phase):
    """The last sample lies at `phase` of the swing: positive on the way back to the middle."""
    end = phase - 2.0 * np.pi * TIME[-1] / 12.0
    across = np.moveaxis(directions((0.2, 0.0), phase=end), 2, 1)[..., None]
    assert motion(across, np.array([[0.0], [0.0], [9.0]]), DT).phase[0] == pytest.approx(phase, abs=0.2)
