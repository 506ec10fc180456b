"""Tables of priors and noise: which keys go together, and what a table is made of."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from bayeschute.study.schema.belief_schema import (
    FORCES,
    NOISE_UNITS,
    ChannelNoise,
    GivenTable,
    NoiseTable,
    Prior,
    PriorsTable,
)

PRIOR, CHANNEL = Prior[float], ChannelNoise[float]


def _told(table, raw) -> str:
    with pytest.raises(ValidationError) as error:
        table.model_validate(raw)
    return str([one["ctx"] for one in error.value.errors()])


def test_a_prior_is_normal_or_log_normal():
    assert not PRIOR(mean=0.0, sd=1.0).log_normal and PRIOR(median=2.0, log_sd=0.1).log_normal
    assert not PRIOR(mean=-3.0, sd=1e-9).log_normal  # a mean may be negative


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        ({}, "an empty table"),
        ({"mean": 1.0}, "'got': 'mean'"),
        ({"mean": 1.0, "log_sd": 0.1}, "log_sd and mean"),
        ({"median": 1.0, "sd": 0.1}, "median and sd"),
        ({"mean": 1.0, "sd": 1.0, "log_sd": 0.1}, "log_sd and mean and sd"),
        ({"mean": 1.0, "sd": 0.0}, "a positive sd"),
        ({"mean": 1.0, "sd": -1.0}, "a positive sd"),
        ({"median": 0.0, "log_sd": 0.1}, "a positive median"),
    ],
)
def test_other_laws_are_none(raw, words):
    assert words in _told(PRIOR, raw)


def test_masses_are_weighed_to_a_fifth():
    for name in ("capsule_mass", "canopy_mass"):
        assert getattr(GivenTable.model_validate({name: {"mean": "100 kg", "sd": "20 kg"}}), name).sd == 20.0
        assert getattr(GivenTable.model_validate({name: {"median": "100 kg", "log_sd": 0.2}}), name).log_sd == 0.2
        for raw in ({"mean": "100 kg", "sd": "21 kg"}, {"median": "100 kg", "log_sd": 0.21}):
            assert "21%" in _told(GivenTable, {name: raw}) and "Weigh it." in _told(GivenTable, {name: raw})
    assert GivenTable.model_validate({"riser_length": {"mean": "10 m", "sd": "9 m"}}).riser_length.sd == 9.0


@pytest.mark.parametrize(
    ("kind", "keys"),
    [("ar1+white", "white correlated time_constant"), ("ar1", "correlated time_constant"), ("white", "white")],
)
def test_each_kind_of_noise_has_its_own_keys_and_no_other(kind, keys):
    every = {"white": 1.0, "correlated": 2.0, "time_constant": "3 s"}
    wanted = {key: every[key] for key in keys.split()}
    made = CHANNEL.model_validate(wanted | {"kind": kind})
    assert made.kind == kind and (made.time_constant == 3.0) == ("time_constant" in wanted)
    for key in every:
        raw = {k: v for k, v in wanted.items() if k != key} if key in wanted else wanted | {key: every[key]}
        assert f"nothing else for the kind '{kind}'" in _told(CHANNEL, raw | {"kind": kind})
    assert CHANNEL.model_validate(every).kind == "ar1+white"


SPEED = {"white": "1 m/s", "kind": "white"}
OU = {"horizontal": "1 m/s", "vertical": "0.5 m/s", "time_constant": "40 s"}
FORCE = {"sd": 0.1, "time_constant": "2 s"}
BREATHING = {"sd": 0.05, "frequency": "0.25 Hz", "damping_ratio": 0.1}


@pytest.mark.parametrize("name", ["wind", "slow_wind", *FORCES])
def test_disturbances_are_no_channels(name):
    raw = OU if "wind" in name else BREATHING if name == "breathing" else FORCE
    made = NoiseTable.model_validate({"capsule_velocity": SPEED, name: raw})
    assert [*made.channels()] == ["capsule_velocity"] and made.has_latent() and made.model == "latent"
    assert not NoiseTable.model_validate({"capsule_velocity": SPEED}).has_latent()


def test_every_channel_has_a_unit_and_a_table_tells_itself():
    channels = {*NoiseTable.model_fields} - {"model", *FORCES}
    assert channels == {*NOISE_UNITS}
    raw = {"capsule_attitude": {"white": "1 deg", "kind": "white"}, "wind": OU, "breathing": BREATHING}
    raw["slow_wind"] = OU | {"vertical_time_constant_at_most": "60 s"}
    head, *lines = repr(NoiseTable.model_validate(raw)).splitlines()
    assert head == "NoiseTable of model 'latent', SI"
    assert [line.split() for line in lines] == [
        ["capsule_attitude", "white", "0.01745", "rad"],
        ["wind", "horizontal", "1", "m/s,", "vertical", "0.5", "m/s,", "time_constant", "40", "s"],
        ["slow_wind", *lines[1].split()[1:-1], "s,", "vertical_time_constant_at_most", "60", "s"],
        ["breathing", "sd", "0.05", "1,", "frequency", "0.25", "Hz,", "damping_ratio", "0.1", "1"],
    ]


def test_a_limit_of_vertical_air_is_no_shorter_than_expected():
    limited = OU | {"vertical_time_constant_at_most": "40 s"}
    assert NoiseTable.model_validate({"slow_wind": limited}).slow_wind.vertical_time_constant_at_most == 40.0
    told = _told(NoiseTable, {"slow_wind": OU | {"vertical_time_constant_at_most": "39 s"}})
    assert "no shorter than time_constant, 40 s" in told and "39 s" in told


def test_populations_are_of_drops_or_of_canopies():
    assert not PriorsTable().hierarchical and PriorsTable(vary=("1",)).hierarchical
    assert PriorsTable(vary_canopies=("1",)).hierarchical
    assert "more than once" in _told(PriorsTable, {"vary": ["1", "1"]})
    assert (PriorsTable().inflation, PriorsTable().floor) == (3.0, 0.02)


@pytest.mark.parametrize(
    ("table", "raw"),
    [
        ({"wind": OU | {"vertical": "0 m/s"}}, "m/s"),
        ({"roll": FORCE | {"sd": 0.51}}, "<= 0.5"),
        ({"breathing": BREATHING | {"damping_ratio": 0.91}}, "<= 0.9"),
        ({"capsule_attitude": {"white": "0 deg", "kind": "white"}}, "rad"),
    ],
)
def test_levels_out_of_range_are_refused(table, raw):
    assert raw in _told(NoiseTable, table)
