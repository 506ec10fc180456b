"""Steps per sample: enough keep Runge-Kutta stable, one fewer diverges where the pole says so."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.compiler.runge_kutta import CLASSICAL, EXTENDED, Stepping
from bayeschute.core.vectors import Vec3
from bayeschute.dynamics import step_size
from bayeschute.dynamics.cluster import state_rate
from bayeschute.dynamics.cluster_flight import air_between
from bayeschute.dynamics.parameters import Structure
from bayeschute.dynamics.step_size import enough, poles, steps

ONE = Structure(("1",), ("e",), 1, "riser")
# One step per sample, so that the sample interval is the step.
FLIGHT = small.flight(
    small.cluster((1.8,), (0.2,), capsule=replace(small.CAPSULE, attach_b=Vec3(0.0, 0.0, 0.0))),
    small.start([[0.02], [0.0], [-1.0]]),
    ONE,
    samples=401,
    dt=0.02,
    substeps=1,
)


@pytest.fixture(scope="module")
def pole():
    """The fastest."""
    return np.abs(poles(FLIGHT, [np.zeros(0)], 13)).max()


def test_the_fastest_pole_is_the_axial_one_of_a_damped_riser(pole):
    """The faster root of s^2 + c u s + k u = 0, u = 1/m_capsule + 1/m_canopy, and drag's share (PHYSICS 2)."""
    m = 149.1 + 1.1 * 3969.0
    u = 1 / 9463.0 + 1 / m
    drag = 1.1 * 981.8 * 1.8 * 10.0 / m
    assert pole == pytest.approx(-np.roots([1.0, 1.46e5 * u, 2.19e5 * u]).min() + drag / (m * u), rel=0.01)


def test_flights_of_one_kind_share_their_expressions_not_their_numbers(monkeypatch):
    theta = [np.array([np.log(1e5)])]
    one = replace(FLIGHT, names=("riser_damping",))
    heavy = replace(one.base, capsule=replace(one.base.capsule, mass=2.0 * one.base.capsule.mass))
    other = replace(one, base=heavy)
    poles(one, theta, 13)
    with monkeypatch.context() as patched:
        patched.setattr(step_size, "trace", lambda *_: pytest.fail("traced again"))
        shared = poles(other, theta, 13)
    monkeypatch.setattr(step_size, "_known", {})
    np.testing.assert_array_equal(shared, poles(other, theta, 13))
    assert not np.array_equal(shared, poles(one, theta, 13))


def test_poles_of_several_parameters_stand_together():
    flight = replace(FLIGHT, names=("riser_damping",))
    one, other = (poles(flight, [np.array([np.log(c)])], 13) for c in (1e5, 2e5))
    np.testing.assert_array_equal(poles(flight, [np.array([np.log(1e5)]), np.array([np.log(2e5)])], 13), [*one, *other])
    assert np.abs(other).max() > 1.5 * np.abs(one).max()


TWO = small.flight(small.cluster(), small.start([[0.2, -0.15], [0.03, 0.0], [-1.0, -1.0]]), wind=(2.0, -1.0, 0.0))


@pytest.mark.parametrize("flight", [FLIGHT, TWO], ids=["one canopy", "two"])
def test_poles_are_the_eigenvalues_of_the_rate_as_jax_differentiates_it(flight):
    flight, theta = replace(flight, names=("riser_damping",)), np.array([np.log(2e5)])
    numbers, still = flight.numbers(theta), np.zeros(9 + 4 * flight.structure.canopies)
    now, zero = jax.tree.map(lambda a: a[0], flight.record), jnp.zeros(3)
    air = air_between(now, now, zero, zero, 0.0, flight.dt)
    slope = jax.jacfwd(lambda x: state_rate(x, numbers, flight.structure, air))(flight.initial(numbers, still))
    want, got = np.linalg.eigvals(np.asarray(slope)), poles(flight, [theta], len(still))
    np.testing.assert_allclose(np.sort(np.abs(got)), np.sort(np.abs(want)), rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("method", [CLASSICAL, EXTENDED], ids=["classical", "extended"])
@pytest.mark.parametrize("sample", [0.1, 0.2])
def test_enough_steps_are_stable_and_one_fewer_diverges(pole, sample, method):
    limit = 2.785 if method is CLASSICAL else 8.70
    needed = int(np.ceil(pole * sample / limit))
    assert enough(method, np.array([-pole + 0.0j]), sample) >= needed
    jump = []
    for length in (sample / needed, 1.3 * limit / pole):
        x = small.fly(replace(FLIGHT, dt=length, stepping=Stepping(1, method)))
        line = np.linalg.norm(x[:, 13:16] - x[:, 0:3], axis=1)
        jump.append(np.abs(np.diff(line[:60], 2)).max())
    # Past the limit the transient grows: it hits the clamp of the tension, or is soon not finite.
    assert jump[0] < 1e-3
    assert not jump[1] < 1e-2


def test_steps_keep_a_margin_and_a_least():
    assert enough(CLASSICAL, np.array([-1.0 + 0.0j]), 0.1) == 1
    assert enough(CLASSICAL, np.array([-1.0 + 0.0j]), 0.1, least=5) == 5
    for pole in (10.0, 61.0, 610.0, 980.0):
        for method, limit in ((CLASSICAL, 2.785), (EXTENDED, 8.70)):
            made = enough(method, np.array([-pole + 0.0j]), 0.1)
            assert pole * 0.1 / made <= 0.85 * limit
            assert made == 1 or pole * 0.1 / (made - 1) > 0.84 * limit


def test_the_method_of_fewest_stages_is_taken():
    """Stiff dampers want extended steps; where lines spring more than they damp, the classical ones do."""
    calm, stiff, springy = np.array([-5.0 + 0.0j]), np.array([-110.0 + 0.0j]), np.array([-18.0 + 46.0j, -18.0 - 46.0j])
    assert steps(calm, 0.1) == (3, CLASSICAL, 3)
    assert steps(stiff, 0.1) == (2, EXTENDED, 5)  # 12 stages for 20
    assert steps(springy, 0.1) == (3, CLASSICAL, 3)
    assert steps(stiff, 0.2) == (10, CLASSICAL, 10)  # longer samples: what is stable is not right there


def test_a_mode_is_stable_at_every_share_of_its_pole():
    """Of a pole beyond the disc, what lies on its way counts, too."""
    pole = np.array([-30.0 + 30.0j])
    made = enough(EXTENDED, pole, 0.1)
    way = np.linspace(0.0, 1.0, 1001) * pole * 0.1 / made
    assert (np.abs(np.polyval(EXTENDED.growth[::-1], way)) <= 1.0 + 1e-9).all()
    assert (np.abs(np.polyval(EXTENDED.growth[::-1], way * made / (made - 1) / 0.85)) > 1.0).any()


def test_modes_that_grow_ask_for_no_steps_and_those_that_are_not_finite_for_none():
    assert enough(CLASSICAL, np.array([30.0 + 0.0j, -1.0 + 0.0j]), 0.1) == 1
    with pytest.raises(ValueError, match="not finite"):
        steps(np.array([np.nan + 0.0j]), 0.1)


def test_both_methods_err_alike_at_their_least_steps():
    """Of a flight of 8 s whose riser both keep stable, against tight steps."""
    damped = replace(FLIGHT, dt=0.1, record=FLIGHT.record)
    tight = small.fly(replace(damped, stepping=Stepping(60)))
    off = [
        np.abs(small.fly(replace(damped, stepping=Stepping(n, method))) - tight)[1:, :6].max()
        for n, method in ((4, CLASSICAL), (2, EXTENDED))
    ]
    assert max(off) < 2e-3
