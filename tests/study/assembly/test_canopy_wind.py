"""A profile in a fit: a virtual drop through a shear, flown with every body in its own wind, is understood with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.core.units import to_si
from bayeschute.likelihood.channels import cluster_data
from bayeschute.records.reconstruct import reconstruct
from bayeschute.records.record import repairs
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.canopy_wind import by_altitude, canopy_wind, with_wind
from bayeschute.study.load import load_study
from bayeschute.study.schema.wind_schema import ProfileTable
from bayeschute.virtual.drop import fly

FOOT = to_si("1 ft", "m")
# The drop passes 6300 ft on its way; the wind turns within 150 ft about it.
TABLE = ProfileTable(
    altitude=("0 ft", "6225 ft", "6375 ft", "9000 ft"),
    north=("0 m/s", "1 m/s", "9 m/s", "10 m/s"),
    east=("2 m/s", "2 m/s", "-3 m/s", "-3 m/s"),
)


@pytest.fixture(scope="module")
def study():
    return load_study(Path(__file__).parents[3] / "models/studies/cdt-3-11.toml")


@pytest.fixture(scope="module")
def flown(study):
    """Record and truth of a drop without noise or turbulence, each body in the wind of its own altitude."""
    virtual = study.flights[0].virtual
    still = virtual.model_copy(update={"turbulence": None, "breathing": None})
    drop = replace(assemble.drop(still), duration=20.0, wind=assemble.wind_profile(TABLE), every_body=True)
    quiet = {name: replace(sensor, white=0.0, correlated=0.0) for name, sensor in drop.sensors.items()}
    model, structure = assemble.cluster(study.vehicle)
    return fly(replace(drop, sensors=quiet, dropouts=type(drop.dropouts)()), model, structure, seed=1, substeps=8)


def profile(altitude):
    altitude = np.asarray(altitude)
    h = np.array([0.0, 6225.0, 6375.0, 9000.0]) * FOOT
    rows = [np.interp(altitude, h, w) for w in ([0.0, 1.0, 9.0, 10.0], [2.0, 2.0, -3.0, -3.0], [0.0] * 4)]
    return np.stack(rows, axis=-1)


def test_canopies_meet_the_profile_of_their_altitude(flown):
    record, truth = flown
    apart = canopy_wind(record, TABLE)
    high = -truth["canopy_position"].sel(axis="down").values
    want = profile(high) - profile(-truth["capsule_position"].sel(axis="down").values)[:, None]
    np.testing.assert_allclose(apart, want, atol=1e-6)
    assert np.abs(apart[..., 0]).max() > 7.0


def test_the_airflow_reconstructed_is_that_flown(study, flown):
    record, truth = flown
    geometry = assemble.geometry(study.vehicle)
    high = -truth["canopy_position"].sel(axis="down").values
    want = record["canopy_position"].differentiate("time").transpose("time", "canopy", "axis").values - profile(high)
    inner = slice(20, -20)
    errors = []
    for aloft in (canopy_wind(record, TABLE), None):
        seen = reconstruct(record, geometry, canopy_wind=aloft)["air_velocity"].values
        errors.append(np.abs(seen - want)[inner].max())
    assert errors[0] < 0.2 and errors[1] > 5.0


def test_the_fit_s_model_meets_the_air_flown(study, flown):
    record, truth = flown
    base, structure = assemble.cluster(study.vehicle)
    channels = tuple(study.noise.channels())
    data = cluster_data(record, base, structure, (), channels, assemble.latent(study, structure.canopies))
    model = by_altitude(data, record, TABLE).model
    place, canopies = (
        truth[name].transpose("time", ..., "axis").values for name in ("capsule_position", "canopy_position")
    )
    for t in (0, 40, 90, 150):
        x = jnp.concatenate([jnp.asarray(place[t]), jnp.zeros(10), jnp.asarray(canopies[t].T.ravel()), jnp.zeros(6)])
        now = type(model.record)(*(np.asarray(v)[t] for v in vars(model.record).values()))
        air = model.air(x, model.base, now, now, jnp.zeros(3), jnp.zeros(3), 0.0)
        np.testing.assert_allclose(air.wind.stack(), profile(-place[t, 2]), atol=1e-6)
        np.testing.assert_allclose(air.aloft.wind.stack().T, profile(-canopies[t, :, 2]), atol=1e-6)
    np.testing.assert_array_equal(np.asarray(data.model.record.density), np.asarray(model.record.density))


def test_altitudes_of_the_profile_are_those_recorded(flown):
    """An origin of positions above the sea moves nothing."""
    record, _ = flown
    lifted = record.copy(deep=True)
    altitude = -record["capsule_position"].sel(axis="down", drop=True)
    lifted["altitude"] = ("time", altitude.values)
    for name in ("capsule_position", "canopy_position"):
        lifted[name].loc[{"axis": "down"}] += 500.0
    np.testing.assert_allclose(canopy_wind(lifted, TABLE), canopy_wind(record, TABLE), atol=1e-9)


def test_a_record_without_wind_takes_the_profile_s(flown):
    record, truth = flown
    made = with_wind(record.drop_vars("wind"), TABLE)
    # The drop's repetitions leave altitudes within a centimetre, and the shear is 0.2 1/s.
    np.testing.assert_allclose(made["wind"].values, truth["wind"].values, atol=0.01 * 0.2)
    assert any(repair.variable == "wind" and repair.kind == "derived" for repair in repairs(made))
    assert with_wind(record, TABLE) is record
