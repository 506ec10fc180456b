"""Any subset of a cluster's channels is fitted: data, gaps, refusals, and a mass that riser tensions tell."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.compiler.integrate import outputs
from bayeschute.compiler.runge_kutta import CLASSICAL, EXTENDED
from bayeschute.core.errors import InputError
from bayeschute.dynamics.cluster_flight import CHANNELS, channel_sizes
from bayeschute.dynamics.parameters import Structure
from bayeschute.likelihood.channels import cluster_data, fitted_channels
from bayeschute.likelihood.disturbances import Latent
from bayeschute.likelihood.joint import LatentPath, NoiseParameters, states
from bayeschute.likelihood.noise import Noise
from bayeschute.likelihood.priors import Prior
from bayeschute.posterior import joint_mode as optimum
from bayeschute.records.derive import derive
from bayeschute.records.record import Repair, with_repairs
from bayeschute.records.sensors import SensorNoise
from bayeschute.virtual.drop import Turbulence, VirtualDrop, fly

FEW = Structure(("1", "alpha^2"), ("e", "rate"), 2, "riser")
MODEL = small.cluster((0.95, -0.8), (-0.1, 0.3))
WHITE = dict(zip(CHANNELS, (0.1, 0.05, 0.002, 500.0, 0.003, 0.05, 0.05), strict=True))  # m, m/s, rad, N, rad, m/s, m/s
DROP = VirtualDrop(
    duration=8.0, dt=0.1, altitude=1500.0, swing=0.2, swing_azimuth=0.5, flyout=0.15, turbulence=Turbulence(0.3, 0.2, 2.0),
    sensors={name: SensorNoise(white) for name, white in WHITE.items()},
)  # fmt: skip
GUSTS = Latent(("drift", "drift"), ((0, 0), (1, 0), (2, 1)))
TENSE = ("canopy_position", "capsule_velocity", "riser_tension")
PRIORS = [
    Prior("axial[1]", 0.9, 0.1, False, "1", ""),
    Prior("transverse[e]", 0.0, 0.2, False, "1", ""),
    Prior("transverse[rate]", 0.2, 0.2, False, "1", ""),
    Prior("riser_length", 71.0, 0.5, False, "m", ""),
    Prior("capsule_mass", 9100.0, 400.0, False, "kg", ""),
]


def data(record, channels, **options):
    return cluster_data(record, MODEL, FEW, PRIORS, channels, GUSTS, **options)


@pytest.fixture(scope="module")
def flown():
    return fly(DROP, MODEL, FEW, 0, small.SUBSTEPS)


def test_data_are_the_record_s_columns(flown):
    record, _ = flown
    order = ("descent_rate", "riser_tension", "swing_angle", "capsule_velocity")
    made = data(record, order)
    assert made.model.channels == order and made.channel == (0, 1, 1, 2, 3, 3, 3)
    want = np.column_stack([record[name].values for name in order])
    assert made.present[:, [0, 3, 4, 5, 6]].all() and made.present[22:, 1:3].all()
    np.testing.assert_array_equal(made.observed, np.where(made.present, want, 0.0))


def test_steps_are_stable_for_the_stiffest_risers_of_the_priors_in_either_method(flown):
    """At 10 Hz five classical steps, or two extended ones; a fit along the record has the shorter."""
    log = [
        Prior(f"riser_{name}", np.log(value), 0.15, True, "", "")
        for name, value in (("stiffness", 2.19e5), ("damping", 1.46e5))
    ]
    made = cluster_data(flown[0], MODEL, FEW, [*PRIORS, *log], TENSE, GUSTS)
    calm = cluster_data(
        flown[0], MODEL, FEW, [replace(p, scale=0.0) if p in log else p for p in [*PRIORS, *log]], TENSE, GUSTS
    )
    assert made.model.stepping[:2] == (2, EXTENDED)
    assert made.model.stepping.classical > calm.model.stepping.classical >= 3
    small_steps = made.in_small_steps()
    assert small_steps.model.stepping[:2] == (made.model.stepping.classical, CLASSICAL)
    (leaves, form), (again, form_again) = (jax.tree.flatten(one) for one in (small_steps, small_steps.in_small_steps()))
    assert form == form_again and all(a is b for a, b in zip(leaves, again, strict=True))
    np.testing.assert_array_equal(small_steps.observed, made.observed)
    theta = np.array([p.centre for p in [*PRIORS, *log]])
    still = LatentPath(np.zeros(17), np.zeros((81, 3)))
    np.testing.assert_allclose(states(made, theta, still), states(small_steps, theta, still), atol=2e-3)


def test_tensions_count_when_the_start_is_forgotten(flown):
    """The model's risers begin as at rest in the recorded wind, those of the flight in its gusts."""
    record, truth = flown
    made = data(record, ("riser_tension",))
    assert not made.present[:20].any() and made.present[21:].all()  # c/k is 2/3 s, three times that 2 s
    # Both starts side by side: at rest and then in the gusts, and in the gusts from the first.
    gusts, theta = truth["turbulence"].values, np.array([0.95, -0.1, 0.3, 71.3, 9463.0])
    rest = data(record, TENSE)
    gusty = replace(
        rest, model=replace(rest.model, record=replace(rest.model.record, wind=record["wind"].values + gusts))
    )
    see = jax.jit(outputs)
    both = [
        see(d.model, states(d, theta, LatentPath(np.zeros(17), error)), theta) for d, error in ((rest, gusts), (gusty, 0.0 * gusts))
    ]  # fmt: skip
    off = np.abs(np.asarray(both[0] - both[1]))[:, 9:].max(axis=1)
    assert off[0] > 100.0 and off[20:].max() < 5e-3 * off[0]


def test_a_virtual_record_has_the_noise_asked_for(flown):
    record, truth = flown
    for name in ("riser_tension", "swing_angle", "descent_rate", "canopy_velocity"):
        assert record[name].dims == truth[name].dims and record[name].attrs["units"] == truth[name].attrs["units"]
        off = (record[name] - truth[name]).values
        assert off.std() == pytest.approx(WHITE[name], rel=0.3) and abs(off.mean()) < 0.5 * WHITE[name]
    pull = truth["riser_tension"].values
    # Before swing and sink have changed much, the risers carry the capsule.
    assert pull.shape == (81, 2) and pull.mean() == pytest.approx(9463.0 * 9.80665 / 2.0, rel=0.1)


def test_interpolated_positions_are_no_data(flown):
    """Those of a canopy alone; those of the capsule for every canopy; and tensions of one riser."""
    time = flown[0]["time"].values
    bridged = [
        Repair("interpolated", "canopy_position.2", time[10], time[14], 3),
        Repair("interpolated", "capsule_position", time[20], time[22], 1),
        Repair("interpolated", "riser_tension.1", time[40], time[43], 2),
    ]
    absent = ~data(with_repairs(flown[0], bridged), TENSE).present
    wanted = ~data(flown[0], TENSE).present
    wanted[11:14, 3:6], wanted[21, :6], wanted[41:43, 9] = True, True, True
    np.testing.assert_array_equal(absent, wanted)


def test_velocities_of_canopies_are_measured_where_their_own_instrument_was(flown):
    """Not where the capsule's position is, to which only positions are related; and one canopy may carry none."""
    time, record = flown[0]["time"].values, flown[0].copy(deep=True)
    record["canopy_velocity"][:, 1] = np.nan
    bridged = [
        Repair("interpolated", "canopy_velocity.1", time[10], time[14], 3),
        Repair("interpolated", "capsule_position", time[20], time[22], 1),
    ]
    made = data(with_repairs(record, bridged), ("capsule_velocity", "canopy_velocity"))
    absent = np.zeros((81, 9), bool)
    absent[11:14, 3:6], absent[:, 6:] = True, True
    np.testing.assert_array_equal(~made.present, absent)
    np.testing.assert_array_equal(made.observed[15:, 3:6], record["canopy_velocity"].values[15:, 0])


def test_gaps_and_what_is_held_out_are_absent(flown):
    record = flown[0].copy(deep=True)
    record["riser_tension"][25:29, 1] = np.nan
    record["swing_angle"][40] = np.nan
    made = data(record, ("riser_tension", "swing_angle"), until=6.0)
    held_out = record["time"].values > 6.0
    assert made.observed.shape == (81, 3) and np.isfinite(made.observed).all()
    assert not made.present[25:29, 1].any() and made.present[25:29, 0].all() and not made.present[40, 2]
    here = made.present[22:]
    assert here.sum() == 3 * (~held_out[22:]).sum() - 5 and not made.present[held_out].any()


def test_channels_that_a_record_lacks_are_left_out(flown):
    record = flown[0].drop_vars("riser_tension")
    record["swing_angle"] = record["swing_angle"] * np.nan
    made = data(record, CHANNELS)
    assert made.model.channels == (
        "canopy_position", "capsule_velocity", "capsule_attitude", "descent_rate", "canopy_velocity"
    )  # fmt: skip
    # Noise parameters keep the numbers of the channels that were wanted.
    assert made.channel == tuple(np.repeat([0, 1, 2, 5, 6], [6, 3, 3, 1, 6]))
    assert list(channel_sizes(CHANNELS, 2).values()) == [6, 3, 3, 2, 1, 1, 6]
    with pytest.raises(InputError, match="one channel at least"):
        data(record, ("riser_tension", "swing_angle"))


def test_a_rate_derived_from_the_velocity_is_not_counted_beside_it(flown):
    record = derive(flown[0].drop_vars("descent_rate"))
    assert fitted_channels(record, ("capsule_velocity", "descent_rate")) == ("capsule_velocity",)
    assert fitted_channels(record, ("swing_angle", "descent_rate")) == ("swing_angle", "descent_rate")
    assert fitted_channels(flown[0], ("capsule_velocity", "descent_rate")) == ("capsule_velocity", "descent_rate")


def test_an_unknown_channel_is_refused_with_advice(flown):
    with pytest.raises(InputError, match="'tension'.*riser_tension"):
        data(flown[0], ("canopy_position", "tension"))


def test_a_flight_s_own_mass_stands(flown):
    theta = np.array([p.centre for p in PRIORS])
    shared, own = (
        data(flown[0], ("riser_tension",)).model,
        data(flown[0], ("riser_tension",), names=[*(p.name for p in PRIORS[:-1]), ""]).model,
    )
    assert float(shared.numbers(theta).capsule.mass) == 9100.0
    assert float(own.numbers(theta).capsule.mass) == small.CAPSULE.mass
    assert float(own.numbers(theta).risers.length) == 71.0


def test_riser_tension_tells_the_mass_of_the_capsule(flown):
    """Positions and velocity tell drag over mass only; what the risers carry tells the mass itself."""
    whole = data(flown[0], TENSE)
    blind = replace(whole, present=whole.present & (np.array(whole.channel) != 2))
    noise = Noise(np.array([WHITE[c] for c in TENSE]), np.full(3, 1e-6), np.ones(3))
    hyper = NoiseParameters(noise, (np.array([0.3, 2.0]), np.array([0.2, 2.0])))
    found = [optimum.fit([d], hyper, PRIORS, np.array([p.centre for p in PRIORS])) for d in (whole, blind)]
    told, untold = (np.sqrt(f.covariance[4, 4]) for f in found)
    assert found[0].converged and found[1].converged
    assert told < 20.0 < 150.0 < untold
    assert abs(found[0].theta[4] - small.CAPSULE.mass) < 2.6 * told  # 99 %
    assert abs(found[1].theta[4] - small.CAPSULE.mass) < 2.6 * untold


def test_canopy_velocities_narrow_the_coefficients(flown):
    """The same record with and without them: no parameter is known less well, the canopies' damping much better."""
    seen = ("canopy_position", "capsule_velocity", "canopy_velocity")
    whole = data(flown[0], seen)
    blind = replace(whole, present=whole.present & (np.array(whole.channel) != 2))
    noise = Noise(np.array([WHITE[c] for c in seen]), np.full(3, 1e-6), np.ones(3))
    hyper = NoiseParameters(noise, (np.array([0.3, 2.0]), np.array([0.2, 2.0])))
    found = [optimum.fit([d], hyper, PRIORS, np.array([p.centre for p in PRIORS])) for d in (whole, blind)]
    told, untold = (np.sqrt(np.diag(f.covariance)) for f in found)
    assert found[0].converged and found[1].converged
    assert (told <= untold * (1.0 + 1e-6)).all() and told[2] < 0.9 * untold[2], told / untold
    truth = np.array([0.95, -0.1, 0.3, small.cluster().risers.length, small.CAPSULE.mass])
    assert (np.abs(found[0].theta - truth)[:3] < 3.3 * told[:3]).all()
