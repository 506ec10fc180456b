"""Errors that a fit is tested for: each takes back what it says is wrong, and none is asked for that is fitted."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from importlib.resources import files
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.aero.capsule_table import capsule_table
from bayeschute.aero.term_names import is_pairwise
from bayeschute.compiler.integrate import outputs
from bayeschute.dynamics.cluster_flight import output_names
from bayeschute.dynamics.parameters import Structure
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import FlightData
from bayeschute.study.evidence.possible_errors import LIBRARY, possible_errors

CHANNELS = ("canopy_position", "capsule_velocity", "capsule_attitude", "riser_tension")
NAMES = output_names(CHANNELS, 2)
THETA = np.array([0.95])


def case(names=("axial[1]",), channels=CHANNELS, directions=((0.2, -0.1), (0.1, -0.2), (-1.0, -1.0))):
    """A flight that moves on along the path of its simulation, and its data without any error."""
    structure = Structure(("1",), ("e",), len(directions[0]), "riser")
    start = small.start(directions, velocity=(1.0, -2.0, 10.0))
    model = small.flight(small.cluster((0.95,), (0.1,)), start, structure, names=names, channels=channels)
    path = small.fly(replace(model, names=()))
    seen = np.asarray(outputs(model, jnp.asarray(path), jnp.asarray(THETA)))
    data = FlightData(
        model, seen, np.ones_like(seen, bool), small.DT, np.ones(17), tuple(range(seen.shape[1])), Latent((), (), 3)
    )
    return data, SimpleNamespace(at=SimpleNamespace(path=path), theta=jnp.asarray(THETA))


@pytest.fixture(scope="module")
def flown():
    return case()


def asked_for(data, along):
    return [error.alternative for error in possible_errors(data, along)]


def named(flown, what):
    (one,) = [one for one in asked_for(*flown) if one.what == what]
    return one


def rows(begin, end=""):
    return np.array([name.startswith(begin) and name.endswith(end) for name in NAMES])


@pytest.mark.parametrize(
    ("what", "size", "added"),
    [
        ("the recorded distance to the canopies east", -0.4, lambda: -0.4 * rows("canopy_position", "east")),
        ("the recorded attitude about body axis z", 0.5, lambda: np.deg2rad(0.5) * rows("capsule_attitude", "z")),
    ],
)
def test_a_constant_error_is_taken_off_its_outputs(flown, what, size, added):
    data, along = flown
    wrong = replace(data, observed=data.observed + added())
    one = named((wrong, along), what)
    np.testing.assert_allclose(one.changed(size).observed, data.observed, atol=1e-12)
    assert one.of_data


def test_the_gain_of_load_cells_is_taken_off_in_per_cent(flown):
    data, along = flown
    wrong = replace(data, observed=data.observed * np.where(rows("riser_tension"), 1.03, 1.0))
    np.testing.assert_allclose(
        named((wrong, along), "the gain of the load cells").changed(3.0).observed, data.observed, rtol=1e-9
    )


@pytest.mark.parametrize(
    ("what", "channel"),
    [
        ("the clock of the canopy positions", "canopy_position"),
        ("the clock of the capsule's velocity", "capsule_velocity"),
    ],
)
def test_a_clock_that_is_late_is_put_right_to_first_order(flown, what, channel):
    """By half a sample; the second order that is left is a tenth of what was wrong or less."""
    data, along = flown
    time, own = small.DT * np.arange(len(data.observed)), rows(channel)
    late = np.stack([np.interp(time - 0.5 * small.DT, time, column) for column in data.observed.T], axis=1)
    wrong = replace(data, observed=np.where(own, late, data.observed))
    after = named((wrong, along), what).changed(0.5 * small.DT).observed - data.observed
    inner = slice(20, -20)
    before = (wrong.observed - data.observed)[inner][:, own]
    assert np.abs(after[inner]).max() < 0.1 * np.abs(before).max()
    np.testing.assert_array_equal(after[:, ~own], 0.0)


def test_a_late_attitude_shows_the_turn_since_then(flown):
    """It is told relative to the recorded one: the true one is ahead of that by the rate times the time."""
    data, along = flown
    shown = named(flown, "the clock of the attitude").changed(0.2).observed - data.observed
    rate = along.at.path[:, 10:13]
    np.testing.assert_allclose(shown[:, rows("capsule_attitude")], 0.2 * rate, atol=1e-12)
    assert np.abs(rate).max() > 1e-3


def test_what_is_simulated_is_changed_by_its_size(flown):
    data, _ = flown
    mass = named(flown, "the mass of the capsule").changed(5.0).model.base
    assert float(mass.capsule.mass) == pytest.approx(1.05 * float(data.model.base.capsule.mass))
    moments = named(flown, "the moment of inertia of the capsule about body axis z").changed(-2.0).model.base.capsule
    before = data.model.base.capsule.inertia
    assert (moments.inertia.x, moments.inertia.y, moments.inertia.z) == (
        before.x,
        before.y,
        pytest.approx(0.98 * before.z),
    )
    wind = named(flown, "the recorded wind east").changed(2.0).model.record.wind
    np.testing.assert_allclose(data.model.record.wind - wind, np.tile([0.0, 2.0, 0.0], (small.SAMPLES, 1)))
    factor = named(flown, "the axial force of canopy 1 relative to the others").changed(10.0).model.record.axial_factor
    np.testing.assert_allclose(factor, np.tile([1.1, 1.0], (small.SAMPLES, 1)))
    assert not any(one.of_data for one in asked_for(*flown) if one.what.startswith(("the mass", "the axial")))


def test_the_capsule_s_slopes_are_changed_where_they_are_numbers_and_not_fitted(flown):
    data, along = flown
    base = data.model.base
    changed = named(flown, "the pitch damping of the capsule").changed(-0.5).model.base.capsule
    assert float(changed.pitch_damping) == pytest.approx(float(base.capsule.pitch_damping) - 0.5)
    assert changed.moment_slope == base.capsule.moment_slope
    angle = np.linspace(0.0, np.pi, 5)
    table = capsule_table(angle, np.zeros(1), {name: np.sin(angle)[:, None] for name in ("C_A", "C_N", "C_m")})
    tabled = replace(base, capsule=replace(base.capsule, table=table))
    of_table = replace(data, model=replace(data.model, base=tabled))
    fitted = replace(data, model=replace(data.model, names=("capsule_pitch_damping",)))
    slopes = [
        [one.what for one in asked_for(some, along) if "slope" in one.what or "damping" in one.what]
        for some in (data, of_table, fitted)
    ]
    assert [len(some) for some in slopes] == [3, 0, 2] and "the pitch damping of the capsule" not in slopes[2]


def test_one_canopy_is_not_asked_for_terms_of_two_and_none_for_what_it_has():
    single = asked_for(*case(directions=((0.2,), (0.1,), (-1.0,))))
    terms = [one.what.split("[")[1].split("]")[0] for one in single if one.what.startswith("the coefficient")]
    assert terms and "e" not in terms and not [term for term in terms if is_pairwise(term)]


def test_terms_asked_for_are_those_of_a_new_study():
    told = tomllib.loads((files("bayeschute") / "templates" / "cluster.toml").read_text(encoding="utf-8"))["structure"]
    assert {kind: ("1", *terms) if kind == "axial" else terms for kind, terms in LIBRARY.items()} == {
        kind: tuple(told[kind]) for kind in LIBRARY
    }


def test_what_is_fitted_or_was_not_recorded_is_not_asked_for():
    fitted = (
        "capsule_mass",
        "capsule_inertia_factor_y",
        "wind_bias.north",
        "wind_bias.east",
        *(f"capsule_attitude_bias.{a}" for a in "yz"),
    )
    data, along = case(names=fitted, channels=("canopy_position", "capsule_attitude"))
    asked = [one.what for one in asked_for(replace(data, model=replace(data.model, names=fitted)), along)]
    assert not [what for what in asked if "mass" in what or "wind" in what or "recorded attitude" in what]
    assert [what[-1] for what in asked if "inertia" in what] == ["z"]
    assert "the clock of the capsule's velocity" not in asked and "the gain of the load cells" not in asked
    assert [what for what in asked if "distance" in what] == [
        f"the recorded distance to the canopies {axis}" for axis in ("north", "east", "down")
    ]


def test_one_canopy_differs_from_none_and_each_of_three_from_the_others():
    single = case(directions=((0.2,), (0.1,), (-1.0,)))
    three = case(directions=((0.2, -0.1, 0.0), (0.1, -0.2, 0.1), (-1.0, -1.0, -1.0)))
    counts = [sum(one.what.startswith("the axial force") for one in asked_for(*some)) for some in (single, three)]
    assert counts == [0, 3]


def test_every_error_has_a_remedy_of_its_kind(flown):
    remedies = {error.alternative.what: error.do for error in possible_errors(*flown)}
    assert len(remedies) == len(possible_errors(*flown)) and all(remedies.values())
    assert "`capsule_pitch_damping`" in remedies["the pitch damping of the capsule"]
    assert "`wind_bias`" in remedies["the recorded wind east"]


def test_a_flight_that_is_no_cluster_s_is_not_asked_for_any(flown):
    data, along = flown
    assert possible_errors(replace(data, model=SimpleNamespace()), along) == []
