"""Every body in the wind of its own altitude: what a canopy and a capsule feel, against the air told by hand."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.atmosphere.wind_field import wind_field
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster import Air, state_rate
from bayeschute.dynamics.state import unpack

MODEL = small.cluster()
START = small.start([[0.2, -0.1], [0.1, 0.15], [-1.0, -1.0]])
STEADY = (1.0, -2.0, 0.5)
H, W = np.array([-300.0, 0.0, 30.0, 120.0]), np.random.default_rng(0).normal(size=(4, 3)) * 4.0


def begun(field=None):
    flight = replace(small.flight(MODEL, START, wind=STEADY), wind_field=field)
    x = flight.initial(flight.numbers(jnp.zeros(0)), jnp.zeros(17))
    now = ClusterAt(flight)
    return flight, x, now


class ClusterAt:
    """Inputs at the first sample."""

    def __init__(self, flight):
        self.wind, self.density = jnp.asarray(flight.record.wind[0]), flight.record.density[0]
        self.axial_factor, self.attitude = jnp.asarray(flight.record.axial_factor[0]), flight.record.attitude[0]


def rate(flight, x, now):
    zero = jnp.zeros(3)
    return np.asarray(flight.rate(x, flight.numbers(jnp.zeros(0)), now, now, zero, zero, 0.0))


def test_capsule_and_canopies_each_meet_the_wind_of_their_altitude():
    flight, x, now = begun(wind_field(H, W))
    state = unpack(x, 2)
    assert (np.asarray(state.position.z - state.canopy_position.z) > 60.0).all()

    def by_hand(altitude):
        altitude = np.asarray(altitude)
        extra = [np.interp(altitude, H, w) for w in W.T]
        place = np.clip(np.searchsorted(H, altitude) - 1, 0, 2)
        shear = [(np.diff(w) / np.diff(H))[place] for w in W.T]
        wind = [jnp.asarray(s + e) for s, e in zip(STEADY, extra, strict=True)]
        still = 0.0 * wind[0]
        return Air(
            Vec3(*wind), Vec3(still, still, still), now.density, now.axial_factor, Vec3(*map(jnp.asarray, shear))
        )

    air = replace(by_hand(-state.position.z), aloft=by_hand(-state.canopy_position.z))
    want = np.asarray(state_rate(x, flight.numbers(jnp.zeros(0)), flight.structure, air))
    np.testing.assert_allclose(rate(flight, x, now), want, rtol=1e-12, atol=1e-12)


def test_a_field_without_shear_is_a_wind_like_any_other():
    field = wind_field(H, np.tile([3.0, 1.0, -0.5], (4, 1)))
    flight, x, now = begun(field)
    other = small.flight(MODEL, START, wind=tuple(np.add(STEADY, (3.0, 1.0, -0.5))))
    np.testing.assert_allclose(x, other.initial(other.numbers(jnp.zeros(0)), jnp.zeros(17)), atol=1e-12)
    np.testing.assert_allclose(rate(flight, x, now), rate(other, x, ClusterAt(other)), atol=1e-11)


def test_wind_that_only_the_canopies_meet_pushes_them_and_not_the_capsule_s_air():
    flight, x, now = begun()
    aloft = replace(flight, wind_field=wind_field([0.0, 40.0, 41.0], [[0.0] * 3, [0.0] * 3, [5.0, 0.0, 0.0]]))
    assert float(x[2]) == 0.0
    change = rate(aloft, x, now) - rate(flight, x, now)
    np.testing.assert_allclose(change[:13], 0.0, atol=1e-12)  # risers don't know yet
    accelerations = np.array(unpack(jnp.asarray(change), 2).canopy_velocity.x)
    assert (accelerations > 0.05).all()


@pytest.mark.parametrize("batch", [3])
def test_a_batch_is_its_members(batch):
    flight, x, now = begun(wind_field(H, W))
    many = jnp.asarray(np.asarray(x)[:, None] + 0.1 * np.random.default_rng(1).normal(size=(x.size, batch)))
    widened = ClusterAt(flight)
    widened.wind, widened.axial_factor = widened.wind[:, None], widened.axial_factor[:, None]
    zero = jnp.zeros((3, batch))
    got = flight.rate(many, flight.numbers(jnp.zeros(0)), widened, widened, zero, zero, 0.0)
    for i in range(batch):
        np.testing.assert_allclose(got[:, i], rate(flight, many[:, i], now), rtol=1e-12, atol=1e-11)
