"""Initial states: taut risers without a line transient, and deviations that mean what they say."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.core.vectors import Vec3, dot
from bayeschute.dynamics.cluster import Air, geometry, state_rate, tension
from bayeschute.dynamics.initial_state import deviation_names, initial_state, tangent_basis
from bayeschute.dynamics.state import unpack

D = np.array([[0.2, 0.1, -1.0], [-0.15, 0.05, -1.0]]).T
START = small.start(D, velocity=(1.0, -2.0, 9.0))
START = replace(START, rate=np.array([0.02, -0.05, 0.03]))
MODEL = small.cluster()
AIR = Air(Vec3(2.0, 1.0, 0.0), Vec3(0.0, 0.0, 0.0), 1.1, np.ones(2), Vec3(0.0, 0.0, 0.0))
NAMES = deviation_names(2)


@jax.jit
def begin(deviation, model):
    x = initial_state(START, tangent_basis(START.direction), deviation, model, small.TWO, AIR)
    return x, state_rate(x, model, small.TWO, AIR)


def stretch_acceleration(x, dx):
    """Second rate of every riser's length: derivative of the stretch rate along the motion."""
    turn = jax.jvp(lambda s: geometry(unpack(s, 2), small.CAPSULE).stretch_rate, (x,), (dx,))
    return np.asarray(turn[0]), np.asarray(turn[1])


@pytest.mark.parametrize("stiffer", [1.0, 100.0])
def test_a_taut_start_has_no_rate_and_no_second_rate_of_riser_length(stiffer):
    """Exact for rigid risers; the stretch itself moves the canopies a little, which falls as 1/k."""
    risers = replace(small.RISERS, stiffness=2.19e5 * stiffer, engagement=0.05 / stiffer)
    deviation = np.random.default_rng(0).normal(size=17) * 0.02
    x, dx = begin(deviation, small.cluster(risers=risers))
    rate, second = stretch_acceleration(np.asarray(x), np.asarray(dx))
    np.testing.assert_allclose(rate, 0.0, atol=1e-12)
    np.testing.assert_allclose(second, 0.0, atol=0.02 / stiffer)
    assert (np.asarray(tension(geometry(unpack(x, 2), small.CAPSULE), risers)) > 0).all()


def test_names_count_the_deviations():
    assert len(NAMES) == 9 + 4 * 2 == len(set(NAMES))


def test_no_deviation_gives_the_start():
    s = unpack(np.asarray(begin(np.zeros(17), MODEL)[0]), 2)
    geo = geometry(s, small.CAPSULE)
    np.testing.assert_allclose(geo.direction.stack(), D / np.linalg.norm(D, axis=0), atol=1e-12)
    np.testing.assert_allclose(s.velocity.stack(), START.velocity)
    np.testing.assert_allclose(s.attitude.stack(), START.attitude)
    np.testing.assert_allclose(s.rate.stack(), START.rate)


def test_deviations_are_what_their_names_say():
    first, second = (tangent_basis(START.direction)[i] for i in (0, 1))
    base = unpack(np.asarray(begin(np.zeros(17), MODEL)[0]), 2)
    line = np.asarray(geometry(base, small.CAPSULE).direction.stack())

    def moved(name, h=1e-4):
        return unpack(np.asarray(begin(h * np.eye(17)[NAMES.index(name)], MODEL)[0]), 2)

    np.testing.assert_allclose(
        moved("velocity.east").velocity.stack() - np.asarray(base.velocity.stack()), [0, 1e-4, 0]
    )
    np.testing.assert_allclose(moved("rate.y").rate.stack() - np.asarray(base.rate.stack()), [0, 1e-4, 0], atol=1e-15)
    turn = base.attitude.conjugate().times(moved("attitude.z").attitude)
    np.testing.assert_allclose(2 * np.asarray(turn.stack())[1:], [0, 0, 1e-4], atol=1e-10)
    lean = np.asarray(geometry(moved("direction.second.2"), small.CAPSULE).direction.stack()) - line
    np.testing.assert_allclose(lean[:, 1] / 1e-4, second[:, 1], atol=1e-4)
    np.testing.assert_allclose(lean[:, 0], 0.0, atol=1e-15)
    swung, still = geometry(moved("turning.first.1"), small.CAPSULE), geometry(base, small.CAPSULE)
    across = np.asarray((swung.across - still.across).stack()) / np.asarray(swung.length)
    np.testing.assert_allclose(across[:, 0] / 1e-4, first[:, 0], atol=1e-6)


def test_tangents_are_orthonormal():
    first, second = tangent_basis(START.direction)
    n = START.direction
    for a, b, want in ((first, first, 1), (second, second, 1), (first, second, 0), (first, n, 0), (second, n, 0)):
        np.testing.assert_allclose(dot(Vec3(*a), Vec3(*b)), want, atol=1e-14)
