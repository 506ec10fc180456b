"""Gradients of a flight, forward and reverse, against finite differences of fourth order.

Two places could spoil them: alpha_T = 0, where the report's axes flip, and the moment a slack riser becomes taut. The
tension jumps there by the damper's share, so that a flight in fixed steps is smooth only as long as the riser becomes
taut within the same stage of the same step: differences must be small against a step, and are.
"""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.air.vector import Vec3
from bayeschute.dynamics.cluster import Air, geometry, state_rate
from bayeschute.dynamics.integrate import rk4
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.state import unpack

_spec = importlib.util.spec_from_file_location(
    "small_cluster", Path(__file__).parents[1] / "twins" / "small_cluster.py"
)
small = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(small)

ONE = Structure(("1", "alpha^2"), ("angle", "angle*alpha^2", "rate"), 1, "riser")
MODEL = small.cluster((0.0,) * 2, (0.0,) * 3)
# C_A, C_Aalpha^2, angle, angle*alpha^2, rate; factors on k and c; l0 [m]; lean, its rate; north and down velocity.
HORIZON, STEPS = 1.5, 200
LENGTH = small.RISERS.length
ATTACHED = np.array([0.05, 0.1, -1.9])  # attach_b of an upright capsule, north east down


@jax.jit
def states(z, horizon):
    """Last state of flights of one canopy from parameters and starts (12, ...)."""
    k = MODEL.risers
    risers = replace(k, stiffness=k.stiffness * z[5], damping=k.damping * z[6], length=z[7])
    model = replace(MODEL, axial=tuple(z[:2]), transverse=tuple(z[2:5]), risers=risers)
    lean, swing, zero = z[8], z[9], 0.0 * z[0]
    sin, cos, length = jnp.sin(lean), jnp.cos(lean), LENGTH + 0.3
    place = [ATTACHED[0] + length * sin, ATTACHED[1], ATTACHED[2] - length * cos]
    moving = [z[10] + LENGTH * swing * cos, 0.0, z[11] + LENGTH * swing * sin]
    rows = [0.0, 0.0, 0.0, z[10], 0.0, z[11], *small.UPRIGHT, 0.0, 0.0, 0.0, *place, *moving]
    still = Vec3(zero, zero, zero)

    def rate(s, _):
        return state_rate(s, model, ONE, Air(still, still, 1.1, 1.0, still))

    return rk4(rate, jnp.stack([row + zero for row in rows]), horizon, STEPS)


# Straight under the canopy with airflow along the riser; the same, swinging through; slack by 0.2 m.
TAUT = np.array([1.8, -1.2, 0.2, 2.0, 0.3, 1.0, 1.0, LENGTH, 0.0, 0.0, 0.0, 10.0])
CROSSING = TAUT + np.array([0, 0, 0, 0, 0, 0, 0, 0, -0.05, 0.1, -7.1, 0])
SLACK = TAUT + np.array([0, 0, 0, 0, 0, 0, 0, 0.5, 0.02, 0.05, 0, 0])
SMOOTH_STEP, SLACK_STEP = np.full(12, 1e-3), np.array([1e-5] * 7 + [2e-6] * 5)
STARTS = {
    "at alpha = 0": (TAUT, SMOOTH_STEP),
    "through alpha = 0": (CROSSING, SMOOTH_STEP),
    "through slack to taut": (SLACK, SLACK_STEP),
}


def alpha_and_stretch(z, horizon):
    """Signed angle of attack in the plane [rad] and stretch of the riser [m] at a time."""
    x = np.asarray(states(z, horizon))
    stretch = float(geometry(unpack(x, 1), MODEL.capsule).length[0]) - z[7]
    line, velocity = x[13:16] - x[0:3], x[16:19]
    return np.arctan2(line[2] * velocity[0] - line[0] * velocity[2], -line @ velocity), stretch


def test_the_flights_go_where_they_should():
    early, late = (alpha_and_stretch(CROSSING, t)[0] for t in (1e-9, HORIZON))
    assert early * late < 0.0
    early, late = (alpha_and_stretch(SLACK, t)[1] for t in (1e-9, HORIZON))
    assert early < -0.1 and late > 0.0


forward = jax.jit(jax.jacfwd(states))


@pytest.mark.parametrize("name", STARTS)
def test_forward_gradients_equal_finite_differences(name):
    z, h = STARTS[name]
    columns = np.concatenate([z[:, None] + k * np.diag(h) for k in (2, 1, -1, -2)], axis=1)
    y = np.asarray(states(columns, HORIZON)).reshape(19, 4, z.size)
    want = (-y[:, 0] + 8.0 * y[:, 1] - 8.0 * y[:, 2] + y[:, 3]) / (12.0 * h)
    got, scale = np.asarray(forward(z, HORIZON)), np.abs(want).max(axis=0)
    felt = scale > 1e-4  # at alpha = 0 the terms across the riser have no first effect
    assert felt[[0, 5, 6, 7, 8, 9, 10, 11]].all()
    np.testing.assert_array_less(np.abs(got - want)[:, felt] / scale[felt], 1e-6)
    np.testing.assert_allclose(got[:, ~felt], want[:, ~felt], atol=1e-9)


@pytest.mark.slow  # most of a minute to compile
def test_reverse_gradients_equal_forward_ones():
    weights = np.linspace(0.5, 1.5, 19)
    backward = jax.jit(jax.grad(lambda z: weights @ states(z, HORIZON)))
    for z, _ in STARTS.values():
        got, want = np.asarray(backward(z)), weights @ np.asarray(forward(z, HORIZON))
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-9 * np.abs(want).max())
