"""The state vector by name: every number in its place, with and without the canopies' shape, alone and in batches."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.dynamics.state import CAPSULE_SIZE, pack, size, unpack


def three(v):
    return np.stack([np.asarray(v.x), np.asarray(v.y), np.asarray(v.z)])


@pytest.mark.parametrize(("n", "breathing", "want"), [(1, False, 19), (2, False, 25), (3, True, 37)])
def test_its_length(n, breathing, want):
    assert size(n, breathing) == want and CAPSULE_SIZE == 13


@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
@pytest.mark.parametrize("breathing", [False, True])
def test_every_number_has_its_place(batch, breathing):
    n = 3
    x = np.arange(float(size(n, breathing) * int(np.prod(batch)))).reshape(-1, *batch)
    state = unpack(x, n)
    np.testing.assert_array_equal(three(state.position), x[0:3])
    np.testing.assert_array_equal(three(state.velocity), x[3:6])
    q = state.attitude
    np.testing.assert_array_equal(np.stack([q.w, q.x, q.y, q.z]), x[6:10])
    np.testing.assert_array_equal(three(state.rate), x[10:13])
    for axis in range(3):  # north of all canopies, then east, then down
        np.testing.assert_array_equal(three(state.canopy_position)[axis], x[13 + 3 * axis : 16 + 3 * axis])
        np.testing.assert_array_equal(three(state.canopy_velocity)[axis], x[22 + 3 * axis : 25 + 3 * axis])
    if breathing:
        np.testing.assert_array_equal(state.shape, x[31:34])
        np.testing.assert_array_equal(state.shape_rate, x[34:37])
    else:
        assert state.shape is None and state.shape_rate is None
    np.testing.assert_array_equal(np.asarray(pack(state)), x)


def test_numbers_that_are_the_same_for_all_of_a_batch_are_repeated():
    """As of a rate whose position part is one number for all."""
    x = np.arange(25.0 * 4).reshape(25, 4)
    state = unpack(x, 2)
    one = unpack(x[:, :1], 2)
    mixed = type(state)(
        one.position, state.velocity, one.attitude, state.rate, state.canopy_position, one.canopy_velocity
    )
    made = np.asarray(pack(mixed))
    want = x.copy()
    want[[0, 1, 2, 6, 7, 8, 9, *range(19, 25)]] = x[[0, 1, 2, 6, 7, 8, 9, *range(19, 25)], :1]
    np.testing.assert_array_equal(made, want)


def test_a_capsule_of_one_flight_is_repeated_for_the_batch_of_its_canopies():
    x = np.arange(25.0 * 4).reshape(25, 4)
    state, capsule = unpack(x, 2), unpack(x[:, 0], 2)
    mixed = type(state)(
        capsule.position, capsule.velocity, capsule.attitude, capsule.rate, state.canopy_position, state.canopy_velocity
    )
    want = np.concatenate([np.repeat(x[:CAPSULE_SIZE, :1], 4, axis=1), x[CAPSULE_SIZE:]])
    np.testing.assert_array_equal(np.asarray(pack(mixed)), want)
