"""What modes do, of signals whose amplitude and frequency are known, and scored flight by flight."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.calibration.mode_scores import content, score_modes
from bayeschute.calibration.scores import LEVELS

DT = 0.05
TIME = np.arange(0.0, 80.0, DT)


def wave(amplitude, frequency, middle=0.2):
    return middle + amplitude * np.sin(2.0 * np.pi * frequency * TIME)


def test_a_sine_has_its_amplitude_and_frequency():
    made = content(
        {"swing_angle": wave(0.1, 0.1), "flyout_angle": wave(0.03, 0.25), "descent_rate": 9.0 + 0 * TIME}, DT
    )
    assert made["pendulum amplitude"] == pytest.approx(0.1, rel=1e-3)
    assert made["pendulum frequency"] == pytest.approx(0.1, rel=1e-2)
    assert made["scissors amplitude"] == pytest.approx(0.03, rel=1e-3)
    assert made["scissors frequency"] == pytest.approx(0.25, rel=1e-2)
    assert made["mean descent rate"] == pytest.approx(9.0)


def test_draws_are_scored_one_truth_each():
    rng = np.random.default_rng(1)
    sizes = 0.1 + 0.01 * rng.standard_normal(200)
    drawn = np.array([wave(size, 0.1) for size in sizes])
    drawn[7] = np.nan
    kept = np.delete(sizes, 7)
    made = score_modes({"swing_angle": drawn}, {"swing_angle": wave(0.12, 0.1)}, DT)
    amplitude = made["pendulum amplitude"]
    assert set(made) == {"pendulum amplitude", "pendulum frequency"}
    assert amplitude["truth"] == pytest.approx(0.12, rel=1e-3)
    assert amplitude["mean"] == pytest.approx(kept.mean(), rel=1e-3) and amplitude["sd"] == pytest.approx(
        kept.std(), rel=1e-3
    )
    assert amplitude["pit"] == np.mean(kept < 0.12)
    inside = [abs(np.mean(kept < 0.12) - 0.5) < level / 2.0 for level in LEVELS]
    assert list(amplitude["inside"]) == inside


def test_what_is_not_known_or_does_not_move_is_left_out():
    still = {"swing_angle": np.ones((3, TIME.size))}
    assert set(score_modes(still, {"swing_angle": np.ones(TIME.size)}, DT)) == {"pendulum amplitude"}
    gap = wave(0.1, 0.1)
    gap[3] = np.nan
    assert score_modes({"swing_angle": wave(0.1, 0.1)[None]}, {"swing_angle": gap}, DT) == {}


def test_the_truth_of_a_flight_that_no_draw_could_fly_is_outside():
    made = score_modes({"swing_angle": np.full((3, TIME.size), np.nan)}, {"swing_angle": wave(0.1, 0.1)}, DT)
    assert set(made) == {"pendulum amplitude", "pendulum frequency"}
    for entry in made.values():
        assert entry["inside"] == (False,) * len(LEVELS) and entry["mean"] is entry["sd"] is entry["pit"] is None
