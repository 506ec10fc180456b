"""What is read off a motion: cycles, endings, the pivot point; and batches that equal single flights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayeschute.reduced.dumbbell import steady_descent
from bayeschute.reduced.motion import Motion, amplitude, cycle, dumbbell, ending, fly
from bayeschute.reduced.planar import PlanarAero
from bayeschute.verification.sets import T71

AERO = PlanarAero(0.927, -0.329, 0.189, 0.1901, -0.988)
MODEL, RHO = dumbbell(T71), T71.density
TIME = np.arange(0.0, 120.0, 0.1)


def made(swing, alpha=0.0, descent=10.0):
    zero = np.zeros_like(TIME)
    return Motion(TIME, swing, zero, zero + alpha, zero, zero + descent, zero)


def test_cycle_of_a_known_oscillation():
    phase = 2 * np.pi * 0.0698 * TIME
    found = cycle(made(0.1 + 0.38 * np.sin(phase), descent=10.0 + np.cos(2 * phase)))
    assert found.amplitude == pytest.approx(0.38, abs=1e-3)
    assert found.frequency == pytest.approx(0.0698, abs=1e-5)
    assert found.descent_rate == pytest.approx(10.0, abs=1e-3)  # whole cycles only
    assert cycle(made(0.01 * np.sin(phase))) is None


def test_endings():
    swing = 0.3 * np.sin(0.44 * TIME)
    assert ending(made(swing), 0.189) == "limit cycle"
    assert ending(made(swing * np.exp(-TIME / 20)), 0.189) == "vertical descent"
    assert ending(made(swing * np.exp(-TIME / 20), alpha=-0.189), 0.189) == "glide"
    assert ending(made(0 * swing, alpha=0.01), 0.0) == "vertical descent"


def test_between():
    motion = made(np.stack([TIME, 2 * TIME], axis=1))
    assert motion.between(50.0, 60.0).time[[0, -1]] == pytest.approx([50.0, 60.0])
    assert amplitude(motion.between(50.0, 60.0)) == pytest.approx([5.0, 10.0])


def test_batches_are_their_members():
    damping, shear = np.array([-0.988, 0.3]), np.linspace(0, 5, 201)[:, None] * [1.0, -1.0]
    start = np.asarray(steady_descent(MODEL, AERO, RHO))
    start = np.stack([start, start + [0, 0, 0, 0, 0.2, 0.1]], axis=1)
    together, states = fly(MODEL, AERO, RHO, start, 20.0, {"C_Nalphadot": damping}, shear)
    assert states.shape == (201, 6, 2)
    for b in range(2):
        alone, _ = fly(MODEL, replace(AERO, C_Nalphadot=damping[b]), RHO, start[:, b], 20.0, wind=shear[:, b])
        for got, want in zip(together[1:], alone[1:], strict=True):
            np.testing.assert_allclose(got[:, b], want, atol=1e-9)


def test_rate_of_the_angle_of_attack_is_its_derivative():
    start = np.asarray(steady_descent(MODEL, AERO, RHO)) + [0, 0, 0, 0, 0.3, 0]
    motion, _ = fly(MODEL, AERO, RHO, start, 20.0)
    central = (motion.alpha[2:] - motion.alpha[:-2]) / 0.2
    np.testing.assert_allclose(motion.alpha_rate[1:-1][20:], central[20:], atol=1e-3)
