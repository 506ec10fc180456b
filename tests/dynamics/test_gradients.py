"""Gradients of a flight, forward and reverse, against finite differences of sixth order.

Two places could spoil them: alpha_T = 0, where the report's axes flip, and the moment a slack riser comes taut. Were its
tension to jump there, derivatives of steps would miss that parameters move that moment, however short the steps.
"""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.compiler import compiled_model as kernel
from bayeschute.compiler.integrate import along_path, trajectory_compiled
from bayeschute.compiler.runge_kutta import Stepping, advanced
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster import Air, geometry, state_rate
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.state import unpack

ONE = Structure(("1", "alpha^2"), ("angle", "angle*alpha^2", "rate"), 1, "riser")
MODEL = small.cluster((0.0,) * 2, (0.0,) * 3)
# C_A, C_Aalpha^2, angle, angle*alpha^2, rate; factors on k and c; l0 [m]; lean, its rate; north and down velocity;
# engagement [m].
HORIZON, STEPS = 1.5, 400
LENGTH = small.RISERS.length
ATTACHED = np.array([0.05, 0.1, -1.9])  # attach_b of an upright capsule, north east down


@jax.jit
def states(z, horizon):
    """Last state of flights of one canopy from parameters and starts (13, ...)."""
    k = MODEL.risers
    risers = replace(k, stiffness=k.stiffness * z[5], damping=k.damping * z[6], length=z[7], engagement=z[12])
    model = replace(MODEL, axial=tuple(z[:2]), transverse=tuple(z[2:5]), risers=risers)
    lean, swing, zero = z[8], z[9], 0.0 * z[0]
    sin, cos, length = jnp.sin(lean), jnp.cos(lean), LENGTH + 0.3
    place = [ATTACHED[0] + length * sin, ATTACHED[1], ATTACHED[2] - length * cos]
    moving = [z[10] + LENGTH * swing * cos, 0.0, z[11] + LENGTH * swing * sin]
    rows = [0.0, 0.0, 0.0, z[10], 0.0, z[11], *small.UPRIGHT, 0.0, 0.0, 0.0, *place, *moving]
    still = Vec3(zero, zero, zero)

    def rate(s, _):
        return state_rate(s, model, ONE, Air(still, still, 1.1, 1.0, still))

    return advanced(Stepping(STEPS), rate, jnp.stack([row + zero for row in rows]), horizon)


# Straight under the canopy with airflow along the riser; the same, swinging through; slack by 0.02 m.
TAUT = np.array([1.8, -1.2, 0.2, 2.0, 0.3, 1.0, 1.0, LENGTH, 0.0, 0.0, 0.0, 10.0, 0.05])
CROSSING = TAUT + np.array([0, 0, 0, 0, 0, 0, 0, 0, -0.05, 0.1, -7.1, 0, 0])
SLACK = TAUT + np.array([0, 0, 0, 0, 0, 0, 0, 0.32, 0.02, 0.05, 0, 20.0, 0])
STARTS = {
    "at alpha = 0": (TAUT, HORIZON),
    "through alpha = 0": (CROSSING, HORIZON),
    "through slack to taut": (SLACK, 0.025),
}
STEP = 1e-3


def alpha_and_stretch(z, horizon):
    """Signed angle of attack in the plane [rad] and stretch of the riser [m] at a time."""
    x = np.asarray(states(z, horizon))
    stretch = float(geometry(unpack(x, 1), MODEL.capsule).length[0]) - z[7]
    line, velocity = x[13:16] - x[0:3], x[16:19]
    return np.arctan2(line[2] * velocity[0] - line[0] * velocity[2], -line @ velocity), stretch


def test_the_flights_go_where_they_should():
    early, late = (alpha_and_stretch(CROSSING, t)[0] for t in (1e-9, HORIZON))
    assert early * late < 0.0
    early, late = (alpha_and_stretch(SLACK, t)[1] for t in (1e-9, 0.025))
    assert early < -0.01 and late > 0.01


forward = jax.jit(jax.jacfwd(states))


@pytest.mark.parametrize("name", STARTS)
def test_forward_gradients_equal_finite_differences(name):
    z, horizon = STARTS[name]
    columns = np.concatenate([z[:, None] + k * STEP * np.eye(z.size) for k in (3, 2, 1, -1, -2, -3)], axis=1)
    y = np.asarray(states(columns, horizon)).reshape(19, 6, z.size)
    y = y[:, :3] - y[:, :2:-1]
    want = (y[:, 0] - 9.0 * y[:, 1] + 45.0 * y[:, 2]) / (60.0 * STEP)
    got, scale = np.asarray(forward(z, horizon)), np.abs(want).max(axis=0)
    felt = scale > 1e-4  # at alpha = 0 the terms across the riser have no first effect, taut the engagement has none
    assert felt[[0, 5, 6, 7, 8, 9, 10, 11]].all() and felt[12] == (name == "through slack to taut")
    np.testing.assert_array_less(np.abs(got - want)[:, felt] / scale[felt], 1e-6)
    np.testing.assert_allclose(got[:, ~felt], want[:, ~felt], atol=1e-9)


def test_differences_through_slack_move_the_moment_of_coming_taut_over_several_steps():
    z, horizon = STARTS["through slack to taut"]
    times = np.linspace(0.010, 0.018, 17)
    moments = []
    for longer in (-3.0 * STEP, 3.0 * STEP):
        moved = z + longer * (np.arange(13) == 7)
        moments.append(np.interp(0.0, [alpha_and_stretch(moved, t)[1] for t in times], times))
    assert moments[1] - moments[0] > 5.0 * horizon / STEPS


def secant_and_mean_derivative(engagement):
    """Of the capsule's speed by the riser's length, over lengths that move the moment of coming taut by many steps."""
    z = TAUT + np.array([0, 0, 0, 0, 0, 0, 0, 0.5, 0.02, 0.05, 0, 0, engagement - 0.05])
    lengths = z[:, None] + np.linspace(0.0, 0.1, 21) * (np.arange(13) == 7)[:, None]
    speed = np.asarray(states(lengths, HORIZON))[5]
    along = np.array([np.asarray(forward(column, HORIZON))[5, 7] for column in lengths.T])
    return (speed[-1] - speed[0]) / 0.1, 0.5 * (along[1:] + along[:-1]).mean()


def test_derivatives_of_coarse_steps_are_right_on_average_because_the_riser_engages():
    """With steps of 4 ms; a riser that is there at once shows what would go wrong."""
    secant, mean = secant_and_mean_derivative(0.05)
    assert mean == pytest.approx(secant, rel=0.05)
    secant, mean = secant_and_mean_derivative(1e-9)
    assert mean > 1.5 * secant


SAMPLES, DT, SUBSTEPS = 41, 0.05, 5
PARAMETERS = {f"axial[{name}]": value for name, value in zip(ONE.axial, (1.8, -1.2), strict=True)}
PARAMETERS |= {f"transverse[{name}]": value for name, value in zip(ONE.transverse, (0.2, 2.0, 0.3), strict=True)}
PARAMETERS |= {"riser_stiffness": np.log(2.19e5), "riser_damping": np.log(1.46e5), "riser_length": LENGTH}
PARAMETERS |= {"riser_engagement": 0.05, "capsule_mass": 9463.0}
THETA = np.array(list(PARAMETERS.values()))
FLIGHTS = {  # lean north [rad], wind that turns from south to north and wind downward in two samples [m/s]
    "at alpha = 0": (0.0, 0.0, 0.0),
    "through alpha = 0": (0.0, 1.0, 0.0),
    "through slack to taut": (0.05, 0.0, 25.0),
}


def whole_flight(lean, turning, gust):
    """A flight of one canopy, its capsule hung above the centre of mass, with what drives it (theta, start, error)."""
    hung = replace(small.CAPSULE, attach_b=Vec3(1.9, 0.0, 0.0))
    start = small.start(np.array([[np.sin(lean)], [0.0], [-np.cos(lean)]]))
    base = small.cluster((0.0,) * 2, (0.0,) * 3, capsule=hung)
    options = {"names": tuple(PARAMETERS), "channels": ("canopy_position", "capsule_velocity", "riser_tension")}
    one = small.flight(base, start, ONE, samples=SAMPLES, dt=DT, substeps=SUBSTEPS, **options)
    error = np.zeros((SAMPLES, 3))
    error[:, 0] = np.linspace(-turning, turning, SAMPLES)
    error[9:11, 2] = gust
    return one, THETA, np.zeros(13), error


@pytest.fixture(scope="module", params=FLIGHTS)
def flight(request):
    return request.param, whole_flight(*FLIGHTS[request.param])


def along(one, x, error):
    """Signed angle of attack [rad] and stretch [m] at all samples."""
    state = unpack(jnp.asarray(x.T), 1)
    geo = geometry(state, one.base.capsule)
    north, down = state.canopy_velocity.x[0] - error[:, 0], state.canopy_velocity.z[0] - error[:, 2]
    n_north, n_down = geo.direction.x[0], geo.direction.z[0]
    turn = jnp.arctan2(n_north * down - n_down * north, -n_north * north - n_down * down)
    return np.asarray(turn), np.asarray(geo.length[0]) - LENGTH


def test_whole_flights_go_where_they_should(flight):
    name, (one, *given) = flight
    turn, stretch = along(one, np.asarray(trajectory_compiled(one, *given)), given[2])
    if name == "at alpha = 0":
        assert turn[0] == 0.0 and np.abs(turn).max() < 1e-4
    if name == "through alpha = 0":
        assert turn.min() < -0.01 < 0.01 < turn.max()
    slack = stretch < 0.0
    assert slack.any() == (name == "through slack to taut") and not slack[0] and not slack[-1]


def chained_to_the_end(steps, count):
    """Derivatives of the last state by parameters and start (X, P + D)."""
    by_theta, by_start = np.asarray(steps.first_theta), np.asarray(steps.first_start)
    for a, b in zip(np.asarray(steps.by_state), np.asarray(steps.by_theta), strict=True):
        by_theta, by_start = a @ by_theta + b, a @ by_start
    assert by_theta.shape[1] == count
    return np.concatenate([by_theta, by_start], axis=1)


@pytest.mark.parametrize("how", ["jax", "machine code"])
def test_derivatives_of_whole_flights_equal_finite_differences(flight, how):
    name, (one, theta, start, error) = flight
    if how == "jax":
        fly, differentiate = trajectory_compiled, jax.jit(along_path)
    else:
        pytest.importorskip("llvmlite")
        fly, differentiate = kernel.states, kernel.along_path
    step = 1e-5 if name == "through slack to taut" else 1e-3  # a riser's second derivatives jump as it comes taut
    size = np.concatenate([np.where(theta > 100.0, 1e3, 1.0), np.ones(9), np.full(4, 0.1)])
    moves = np.eye(size.size) * size * step
    both = np.concatenate([theta, start])[:, None] + np.concatenate([k * moves for k in (3, 2, 1, -1, -2, -3)], axis=1)
    count = both.shape[1]
    driven = both[: theta.size], both[theta.size :], np.repeat(error[:, :, None], count, axis=2)
    y = np.asarray(fly(one, *driven))[-1].reshape(19, 6, size.size)
    y = y[:, :3] - y[:, :2:-1]
    want = (y[:, 0] - 9.0 * y[:, 1] + 45.0 * y[:, 2]) / 60.0
    path = trajectory_compiled(one, theta, start, error)
    got = chained_to_the_end(differentiate(one, theta, start, error, path)[2], theta.size) * size * step
    scale = np.abs(want).max(axis=0)
    felt = scale > 1e-4 * step
    np.testing.assert_array_less(np.abs(got - want)[:, felt] / scale[felt], 1e-6)
    np.testing.assert_allclose(got[:, ~felt], want[:, ~felt], atol=1e-12)


@pytest.mark.slow  # most of a minute to compile
def test_reverse_gradients_equal_forward_ones():
    weights = np.linspace(0.5, 1.5, 19)
    backward = jax.jit(jax.grad(lambda z: weights @ states(z, HORIZON)))
    for z, _ in STARTS.values():
        got, want = np.asarray(backward(z)), weights @ np.asarray(forward(z, HORIZON))  # one horizon, one compilation
        np.testing.assert_allclose(got, want, rtol=1e-9, atol=1e-9 * np.abs(want).max())
