"""Winds of a landing number by number: what each of its standard normal numbers moves, and by how much."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtri

from bayeschute.landing.climatology import NODES, Scatter
from bayeschute.landing.turbulence import Turbulence, field, field_size
from bayeschute.landing.wind_plan import STEP, Event, Profile, WindPlan, shear_of

ALTITUDE = np.arange(100.0, 900.0, STEP)
PROFILE = Profile(np.array([200.0, 400.0, 600.0]), np.array([[2.0, 1.0, 0.5], [4.0, -1.0, 0.0], [8.0, 3.0, -0.5]]))


def _one(plan: WindPlan, **numbers: float) -> np.ndarray:
    """Wind (K, 3) where all numbers are zero but those at some places."""
    u = np.zeros((plan.size, 1))
    for place, value in numbers.items():
        u[int(place[1:])] = value
    return plan.by_altitude(u, ALTITUDE)[:, :, 0]


def test_a_profile_is_linear_between_and_held_beyond_its_altitudes():
    made = _one(WindPlan((PROFILE,)))
    np.testing.assert_allclose(made[ALTITUDE == 300.0], [[3.0, 0.0, 0.25]])
    np.testing.assert_allclose(made[ALTITUDE == 500.0], [[6.0, 1.0, -0.25]])
    np.testing.assert_allclose(made[ALTITUDE <= 200.0], np.tile(PROFILE.wind[0], (51, 1)))
    np.testing.assert_allclose(made[-1], PROFILE.wind[-1])
    assert not _one(WindPlan()).any()


def test_members_are_met_in_proportion_to_their_weights():
    plan = WindPlan((PROFILE,) * 3, weights=(1.0, 1.0, 2.0))
    u = np.zeros((plan.size, 5))
    u[0] = ndtri([0.01, 0.24, 0.26, 0.51, 0.999999])
    assert plan.member(u).tolist() == [0, 0, 1, 2, 2]
    equal = WindPlan((PROFILE,) * 4)
    assert equal.member(u).tolist() == [0, 0, 1, 2, 3]
    u[0] = 40.0  # a share of exactly 1
    assert equal.member(u).tolist() == [3] * 5 and plan.member(u).tolist() == [2] * 5 and not WindPlan().member(u).any()


def test_a_factor_is_on_the_member_and_its_scatter_and_not_on_errors_and_events():
    scatter = Scatter(np.array([0.0, 1000.0]), np.full((2, 2), 1.5), np.array([0.4, 0.4]))
    parts = dict(
        profiles=(PROFILE,),
        scatter=(scatter,),
        error_sd=0.7,
        events=(Event("shear", 500.0, 0.0, 100.0, (3.0, 0.0, 0.0)),),
    )
    rng = np.random.default_rng(0)
    scaled, plain = WindPlan(**parts, scale_sd=0.3), WindPlan(**parts)
    u = rng.standard_normal((plain.size, 4))
    u[1] = 2.0
    moved = scaled.by_altitude(u, ALTITUDE) - plain.by_altitude(u, ALTITUDE)
    of_member = WindPlan(profiles=(PROFILE,), scatter=(scatter,))
    held = u.copy()
    own = of_member.by_altitude(held[: of_member.size], ALTITUDE)
    np.testing.assert_allclose(moved, (np.exp(0.6) - 1.0) * own, atol=1e-12)


def test_scatter_and_error_have_numbers_of_their_own():
    scatter = Scatter(np.array([0.0, 1000.0]), np.full((2, 2), 1.5), np.zeros(2))
    plan = WindPlan(
        error_sd=1.0, profiles=(PROFILE,), scatter=(scatter,), events=(Event("gust", 0.0, 0.0, 1.0, (0.0,) * 3),) * 2
    )
    assert plan.size == 3 + 4 * NODES + 4 and WindPlan(error_sd=1.0).size == 3 + 2 * NODES
    base = _one(plan)
    north, east = _one(plan, n3=1.0) - base, _one(plan, n4=1.0) - base
    assert north[0, 0] == pytest.approx(1.0) and not north[:, 1:].any()
    np.testing.assert_allclose(east[:, 1], north[:, 0], atol=1e-12)
    place = 3 + 2 * NODES
    scattered = _one(plan, **{f"n{place}": 1.0}) - base
    assert scattered[0, 0] == pytest.approx(1.5) and not scattered[:, 1:].any()


@pytest.mark.parametrize("kind", ["shear", "gust"])
def test_the_shape_of_a_layer(kind):
    """A shear is there below its middle, half of it in the middle; a gust is gone half a thickness away."""
    event = Event(kind, 500.0, 40.0, 100.0, (0.0, 4.0, 2.0))
    plan = WindPlan(events=(event,))
    for number in (0.0, 1.5):
        middle = 500.0 + 40.0 * number
        made = _one(plan, **{f"n{3 + 2 * NODES}": number})
        below = np.clip((middle + 50.0 - ALTITUDE) / 100.0, 0.0, 1.0)
        share = (
            below
            if kind == "shear"
            else np.where(np.abs(ALTITUDE - middle) < 50.0, np.cos(np.pi * (ALTITUDE - middle) / 100.0) ** 2, 0.0)
        )
        np.testing.assert_allclose(made, share[:, None] * [0.0, 4.0, 2.0], atol=1e-12)


def test_each_event_has_its_place_and_its_chance_of_two_numbers():
    events = tuple(Event("shear", 500.0, 10.0, 50.0, change, 0.3) for change in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    plan = WindPlan(events=events)
    first = 3 + 2 * NODES
    for chance, there in ((0.29, 1.0), (0.31, 0.0)):
        made = _one(plan, **{f"n{first + 1}": ndtri(chance), f"n{first + 3}": ndtri(0.9)})
        assert made[0].tolist() == [there, 0.0, 0.0]


def test_events_turn_with_their_member_by_the_azimuth():
    plan = WindPlan((PROFILE,), any_direction=True, events=(Event("shear", 500.0, 0.0, 50.0, (3.0, 0.0, 1.0)),))
    still = WindPlan((PROFILE,), events=plan.events)
    made, wanted = _one(plan, n2=ndtri(0.25)), _one(still)
    np.testing.assert_allclose(made, np.stack([-wanted[:, 1], wanted[:, 0], wanted[:, 2]], axis=1), atol=1e-12)


def test_turbulence_is_the_field_s_first_altitudes():
    law = Turbulence("dryden", 1.0, 0.5, 40.0, 60.0)
    plan = WindPlan(turbulence=law)
    shape = plan.gust_shape(790.0)
    assert shape == (3, field_size(law, 790.0, STEP)) and WindPlan().gust_shape(790.0) == (0, 0)
    z = np.random.default_rng(1).standard_normal((*shape, 2))
    np.testing.assert_array_equal(plan.gusts(z, 50), field(law, z, STEP)[:50])
    with pytest.raises(AssertionError):
        WindPlan().gusts(z, 50)


def test_shear_is_over_a_hundred_metres_and_level():
    winds = np.zeros((len(ALTITUDE), 3, 2))
    winds[:, 0, 0], winds[:, 1, 0], winds[:, 2, :] = 0.03 * ALTITUDE, -0.04 * ALTITUDE, 9.0 * ALTITUDE[:, None]
    winds[200:, 1, 1] = 2.0
    np.testing.assert_allclose(shear_of(winds), [5.0, 2.0])
    assert shear_of(winds[:50]).tolist() == [0.0, 0.0]
