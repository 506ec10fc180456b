"""Labels of windows in which canopies are moved by hand."""

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.reduced.mode_labels import label_windows

t = np.arange(0.0, 60.0, 0.1)
STILL = np.zeros_like(t)


def cluster(swing=(STILL, STILL), flyout=0.15 + STILL, azimuth=STILL, n=2):
    """Riser directions (T, n, 3): up, leaning by the swing, spread by the flyout angle at an azimuth."""
    out = np.empty((t.size, n, 3))
    for i in range(n):
        a = azimuth + 2.0 * np.pi * i / n
        out[:, i, 0] = np.sin(swing[0]) + np.sin(flyout) * np.cos(a)
        out[:, i, 1] = np.sin(swing[1]) + np.sin(flyout) * np.sin(a)
        out[:, i, 2] = -np.sqrt(1.0 - np.sum(out[:, i, :2] ** 2, axis=1))
    return out


def air(horizontal, n=2):
    return np.tile([horizontal, 0.0, 10.0], (t.size, n, 1))


SWING = (np.deg2rad(15.0) * np.sin(2.0 * np.pi * t / 14.5), np.deg2rad(3.0) * np.cos(2.0 * np.pi * t / 14.5))
SCISSORS = 0.18 + np.deg2rad(5.0) * np.sin(2.0 * np.pi * t / 15.0)
TURN = 2.0 * np.pi * t / 35.0


@pytest.mark.parametrize("n", [2, 3])
@pytest.mark.parametrize(
    ("motion", "wind", "label"),
    [
        ({"swing": SWING}, 0.0, "pendulum"),
        ({"flyout": SCISSORS}, 0.0, "flyout"),
        ({"azimuth": TURN, "flyout": 0.21 + STILL}, 0.0, "maypole"),
        ({"azimuth": -TURN}, 0.0, "maypole"),
        ({}, 2.0, "glide"),
        ({}, 0.1, "steady"),
        ({"swing": SWING, "flyout": SCISSORS}, 0.0, "pendulum"),
    ],
)
def test_labels(motion, wind, label, n):
    made = label_windows(t, cluster(n=n, **motion), air(wind, n), length=20.0)
    assert [window.label for window in made] == [label] * 5
    for window in made:
        assert sum(window.shares) == pytest.approx(1.0, abs=1e-6) or label in ("glide", "steady")


def test_numbers():
    (window, *_) = label_windows(t, cluster(swing=SWING), air(0.0), length=29.0)
    wanted = np.hypot(np.deg2rad(15.0), np.deg2rad(3.0))
    assert window.swing_amplitude == pytest.approx(wanted, rel=0.02)
    (window, *_) = label_windows(t, cluster(azimuth=-TURN, flyout=SCISSORS), air(1.0), length=30.0)
    assert window.turning == pytest.approx(-2.0 * np.pi / 35.0, rel=0.02)
    assert window.flyout_amplitude == pytest.approx(np.deg2rad(5.0), rel=0.03)
    assert window.glide_angle == pytest.approx(np.arctan(0.1), rel=1e-3)
    assert set(window.present) == {"flyout", "maypole"}


def test_conical_swing_is_a_pendulum_not_a_maypole():
    cone = (0.2 * np.cos(2.0 * np.pi * t / 15.0), 0.2 * np.sin(2.0 * np.pi * t / 15.0))
    assert {w.label for w in label_windows(t, cluster(swing=cone), None)} == {"pendulum"}


def test_noise_alone_is_no_mode():
    noise = 0.01 * np.random.default_rng(0).standard_normal((t.size, 2, 3))
    made = cluster() + noise
    made /= np.linalg.norm(made, axis=2, keepdims=True)
    assert {w.label for w in label_windows(t, made, air(0.1))} == {"steady"}


def test_windows_change_and_gaps_are_unknown():
    swing = tuple(np.where(t < 30.0, s, 0.0) for s in SWING)
    direction = cluster(swing=swing)
    direction[450:520] = np.nan
    made = label_windows(t, direction, air(2.0), length=15.0, every=15.0)
    assert [w.label for w in made] == ["pendulum", "pendulum", "glide", "unknown"]
    assert [w.start for w in made] == pytest.approx([0.0, 15.0, 30.0, 45.0])


def test_bad_input():
    with pytest.raises(InputError, match=r"\(T, n, 3\)"):
        label_windows(t, np.ones((t.size, 3)))
    with pytest.raises(InputError, match="windows inside the record"):
        label_windows(t, cluster(), length=100.0)
