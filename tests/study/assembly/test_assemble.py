"""From the words of a study to the objects of the rooms below."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from bayeschute.likelihood.disturbances import KINDS, Latent
from bayeschute.study.assembly import assemble
from bayeschute.study.load import Study, load_study
from bayeschute.study.plausible import nominal
from bayeschute.study.schema.belief_schema import ForceNoise, WindNoise

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def study() -> Study:
    """The default study, with all that a noise table may hold."""
    plain = load_study(ROOT / "models/studies/cdt-3-11.toml")
    force = ForceNoise(sd=0.003, time_constant="1 s")
    return replace(plain, noise=plain.noise.model_copy(update={"canopy_force": force}))


def test_places_turn_from_the_structural_frame_into_the_body_s(study: Study):
    # Structural x runs aft and z is reversed: the attach point ahead of the centre of mass lies at positive body x.
    assert study.vehicle is not None
    model, _ = assemble.cluster(study.vehicle)
    assert model.capsule.attach_b.x == pytest.approx(1.90)
    assert (model.capsule.attach_b.y, model.capsule.attach_b.z) == (0.0, 0.0)
    assert assemble.geometry(study.vehicle).attach_b == pytest.approx((1.90, 0.0, 0.0))


def test_places_in_body_axes_are_taken_as_they_are(study: Study):
    assert study.vehicle is not None
    capsule = study.vehicle.capsule
    turned = {
        name: tuple(s * x for s, x in zip((-1.0, 1.0, -1.0), getattr(capsule, name), strict=True))
        for name in ("centre_of_mass", "attach_point", "reference_centre")
    }
    body = study.vehicle.model_copy(update={"capsule": capsule.model_copy(update={"points_in": "body"} | turned)})
    one, other = assemble.cluster(study.vehicle)[0].capsule, assemble.cluster(body)[0].capsule
    assert one.attach_b == other.attach_b and one.reference_centre_b == other.reference_centre_b
    assert assemble.geometry(body).attach_b == assemble.geometry(study.vehicle).attach_b
    assert nominal(body).attach_b == pytest.approx(nominal(study.vehicle).attach_b)


def test_the_cluster_flies_with_the_vehicle_s_aerodynamics(study: Study):
    vehicle = study.vehicle
    assert vehicle is not None
    model, structure = assemble.cluster(vehicle)
    assert dict(zip(structure.axial, model.axial, strict=True)) == vehicle.aero.axial
    assert dict(zip(structure.transverse, model.transverse, strict=True)) == vehicle.aero.transverse
    assert (structure.canopies, structure.rate) == (2, "riser")
    assert model.risers.length == pytest.approx(234 * 0.3048)


def test_a_flight_s_own_mass_replaces_the_vehicle_s(study: Study):
    assert study.vehicle is not None
    assert assemble.cluster(study.vehicle)[0].capsule.mass == study.vehicle.capsule.mass
    assert assemble.cluster(study.vehicle, 9000.0)[0].capsule.mass == 9000.0
    assert assemble.geometry(study.vehicle, 9000.0).capsule_mass == 9000.0


def test_a_quick_drop_is_a_third_of_the_drop(study: Study):
    virtual = study.flights[0].virtual
    assert virtual is not None
    whole, quick = assemble.drop(virtual), assemble.drop(virtual, quick=True)
    assert whole.duration == pytest.approx(90.0) and whole.dt == pytest.approx(0.1)
    assert replace(quick, duration=whole.duration) == whole
    assert quick.duration == pytest.approx(30.0)


def test_a_drop_without_disturbances_has_none(study: Study):
    virtual = study.flights[0].virtual
    assert virtual is not None
    still = assemble.drop(virtual.model_copy(update={"turbulence": None, "breathing": None}))
    assert still.turbulence.horizontal == still.turbulence.vertical == still.breathing.amplitude == 0.0


def test_every_flight_has_a_seed_of_its_own(study: Study):
    seeds = [assemble.flight_seed(study, flight) for flight in study.flights]
    assert len(set(seeds)) == 2
    assert seeds == [assemble.flight_seed(study, flight) for flight in study.flights]
    other = replace(study, seed=study.seed + 1)
    assert assemble.flight_seed(other, study.flights[0]) not in seeds
    for flights in (study.flights[:1], study.flights[::-1]):
        assert assemble.flight_seed(replace(study, flights=flights), study.flights[0]) == seeds[0]


def test_medians_of_the_noise_follow_channels_and_groups(study: Study, descents):
    found = assemble.hyper(study)
    names = list(study.noise.channels())
    assert np.size(found.noise.white) == len(names)
    assert found.noise.white[names.index("canopy_position")] == pytest.approx(0.15)
    assert found.noise.correlated[names.index("capsule_attitude")] == pytest.approx(np.deg2rad(0.2))
    wanted = [[0.6096, 5.0], [0.3048, 5.0], [0.3048, 20.0], [0.3048, 20.0], [0.003, 1.0]]
    wanted += [[0.005, 3.0], [0.01, 3.0], [0.02, 0.25, 0.1]]
    for law, numbers in zip(found.disturbance_parameters, wanted, strict=True):
        assert list(law) == pytest.approx(numbers)
    winds = ("wind, horizontal", "wind, vertical", "slow wind, horizontal", "slow wind, vertical")
    assert assemble.noise_parameter_names(study) == (
        *winds,
        "canopy force",
        "transverse force",
        "capsule roll",
        "breathing",
    )
    descent = load_study(descents.study)
    assert [list(law) for law in assemble.hyper(descent).disturbance_parameters] == [[0.5, 30.0]]
    assert assemble.noise_parameter_names(descent) == ("wind, vertical",)


WIND = ((0, 0), (1, 0), (2, 1))


def across(group):
    """Processes of two canopies' transverse force."""
    return tuple((row, group) for row in (5, 6, 7, 8))


@pytest.mark.parametrize(
    ("left_out", "kinds", "processes", "rows"),
    [
        ((), ("drift", "drift", "drift", "oscillator"), ((3, 2), (4, 2), *across(3), (9, 4), (3, 5), (4, 5)), 10),
        (("roll",), ("drift", "drift", "oscillator"), ((3, 2), (4, 2), *across(3), (3, 4), (4, 4)), 9),
        (("roll", "canopy_force"), ("drift", "oscillator"), (*across(2), (3, 3), (4, 3)), 9),
        (("roll", "breathing"), ("drift", "drift"), ((3, 2), (4, 2), *across(3)), 9),
        (("roll", "canopy_force", "breathing"), ("drift",), across(2), 9),
        (("roll", "transverse_force"), ("drift", "oscillator"), ((3, 2), (4, 2), (3, 3), (4, 3)), 5),
        (("roll", "transverse_force", "canopy_force"), ("oscillator",), ((3, 2), (4, 2)), 5),
        (("roll", "transverse_force", "breathing"), ("drift",), ((3, 2), (4, 2)), 5),
        (("roll", "transverse_force", "canopy_force", "breathing"), (), (), 3),
        (("transverse_force", "breathing"), ("drift", "drift"), ((3, 2), (4, 2), (9, 3)), 10),
        (("transverse_force", "canopy_force", "breathing"), ("drift",), ((9, 2),), 10),
    ],
)
def test_latent_processes_belong_to_axes_and_canopies(study: Study, left_out, kinds, processes, rows):
    """Wind north and east share a law; what the force of a canopy does along its axis adds up in that canopy's row.

    Across it has rows of its own: north of all canopies, then east, under one law. The capsule's roll is the last.
    """
    changed = replace(study, noise=study.noise.model_copy(update=dict.fromkeys((*left_out, "slow_wind"))))
    made, laws = assemble.latent(changed, 2), assemble.hyper(changed).disturbance_parameters
    assert made.kinds == ("drift", "drift", *kinds) and made.processes == WIND + processes
    assert made.rows == rows
    assert [KINDS[kind] for kind in made.kinds] == [law.size for law in laws]
    assert len(assemble.noise_parameter_names(changed)) == len(laws)


def test_a_descent_has_one_latent_process(descents):
    descent = load_study(descents.study)
    assert assemble.latent(descent, 0) == assemble.latent(descent, 1) == Latent(("drift",), ((0, 0),))


def test_slow_wind_adds_to_wind(study: Study, descents):
    slow = WindNoise(horizontal="1 m/s", vertical="0.5 m/s", time_constant="60 s")
    made = replace(study, noise=study.noise.model_copy(update={"slow_wind": slow}))
    winds = ("wind, horizontal", "wind, vertical", "slow wind, horizontal", "slow wind, vertical")
    assert assemble.noise_parameter_names(made) == (
        *winds,
        "canopy force",
        "transverse force",
        "capsule roll",
        "breathing",
    )
    assert assemble.latent(made, 1).processes == (*WIND, (0, 2), (1, 2), (2, 3), (3, 4), (4, 5), (5, 5), (6, 6), (3, 7))
    assert [list(law) for law in assemble.hyper(made).disturbance_parameters[2:4]] == [[1.0, 60.0], [0.5, 60.0]]
    descent = load_study(descents.study)
    up = WindNoise(vertical="0.5 m/s", time_constant="600 s")
    both = replace(descent, noise=descent.noise.model_copy(update={"slow_wind": up}))
    assert assemble.latent(both, 1) == Latent(("drift", "drift"), ((0, 0), (0, 1)))
    assert [list(law) for law in assemble.hyper(both).disturbance_parameters] == [[0.5, 30.0], [0.5, 600.0]]
    assert assemble.noise_parameter_names(both) == ("wind, vertical", "slow wind, vertical")


def test_vertical_air_lasts_as_long_as_the_study_allows(study: Study, descents):
    assert assemble.noise_prior(study).longest == ()
    for made, place in ((study, 3), (load_study(descents.study), 1)):
        horizontal = "1 m/s" if place == 3 else None
        slow = WindNoise(
            horizontal=horizontal, vertical="0.5 m/s", time_constant="60 s", vertical_time_constant_at_most="80 s"
        )
        limited = replace(made, noise=made.noise.model_copy(update={"slow_wind": slow}))
        prior = assemble.noise_prior(limited)
        assert prior.longest == ((place, 80.0),) and list(prior.median.disturbance_parameters[place]) == [0.5, 60.0]
        assert assemble.noise_parameter_names(limited)[place] == "slow wind, vertical"


def test_quick_is_smaller_and_leaves_the_rest(study: Study):
    quick = assemble.smaller(study)
    assert quick.sampler.draws < study.sampler.draws and quick.predict.draws < study.predict.draws
    assert replace(quick, sampler=study.sampler, predict=study.predict) == study


def test_plain_values_are_what_json_holds():
    given = {
        1: np.float64(0.5), "nan": np.nan, "array": np.array([1.0, np.inf]), "jax": jnp.array([1.5, 2.5])[0],
        "count": np.int64(3), "flag": np.bool_(True), "path": Path("x"), "none": None,
        "xarray": xr.DataArray([1.0]), "deep": ({"a": (1, 2)},),
    }  # fmt: skip
    wanted = {
        "1": 0.5, "nan": None, "array": [1.0, None], "jax": 1.5, "count": 3, "flag": True, "path": "x", "none": None,
        "xarray": [1.0], "deep": [{"a": [1, 2]}],
    }  # fmt: skip
    plain = assemble.as_plain(given)
    assert plain == wanted
    assert json.loads(json.dumps(plain, allow_nan=False)) == wanted
    assert plain["flag"] is True and type(plain["count"]) is int
