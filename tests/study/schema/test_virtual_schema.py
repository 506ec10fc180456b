"""Tables of virtual drops: how many samples they have, and which errors go together."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from bayeschute.study.schema.virtual_schema import SensorsTable, VirtualFlight

DROP = {
    "duration": "90 s", "rate": "10 Hz", "altitude": "2000 m", "swing": "10 deg", "swing_azimuth": "0 deg",
    "swing_rate": "0 deg/s", "flyout": "9 deg", "flyout_azimuth": "0 deg",
    "wind": {"altitude": ["0 m", "3000 m"], "north": ["1 m/s", "2 m/s"], "east": ["0 m/s", "0 m/s"]},
}  # fmt: skip


def _told(table, raw) -> str:
    with pytest.raises(ValidationError) as error:
        table.model_validate(raw)
    return str([one["ctx"] for one in error.value.errors()])


def test_a_drop_in_si_with_what_is_not_said_left_out():
    made = VirtualFlight.model_validate(DROP)
    assert made.swing == pytest.approx(0.174533, rel=1e-5) and made.shape == () and made.turbulence is None
    assert made.breathing is None and made.canopy_sd is None and made.sensors == SensorsTable()
    rough = SensorsTable.model_validate({"wind": {"correlated": "1 m/s", "time_constant": "20 s"}}).wind
    assert (rough.white, rough.correlated, rough.time_constant) == (0.0, 1.0, 20.0)


@pytest.mark.parametrize(("duration", "rate"), [("5 s", "10 Hz"), ("50 s", "1 Hz"), ("10000 s", "100 Hz")])
def test_fifty_to_a_million_samples(duration, rate):
    made = VirtualFlight.model_validate(DROP | {"duration": duration, "rate": rate})
    assert 50.0 <= made.duration * made.rate <= 1e6


@pytest.mark.parametrize(
    ("duration", "rate", "told"), [("4.9 s", "10 Hz", "49 samples"), ("10001 s", "100 Hz", "1e+06 samples")]
)
def test_fewer_or_more_are_refused(duration, rate, told):
    assert told in _told(VirtualFlight, DROP | {"duration": duration, "rate": rate})


def test_a_correlated_error_has_a_time_constant_and_a_white_one_needs_none():
    white = SensorsTable.model_validate({"wind": {"white": "1 m/s"}, "riser_tension": {"white": "9 N"}})
    assert white.wind.white == 1.0 and white.wind.correlated == 0.0 and white.riser_tension.white == 9.0
    both = {"wind": {"correlated": "1 m/s", "time_constant": "3 s"}}
    assert SensorsTable.model_validate(both).wind.time_constant == 3.0
    assert "no time_constant" in _told(SensorsTable, {"wind": {"correlated": "1 m/s"}})
    assert SensorsTable.model_validate({"wind": {"correlated": "0 m/s"}}).wind.time_constant is None


def test_what_follows_from_other_channels_is_recorded_only_where_it_is_named():
    none = {name for name, field in SensorsTable.model_fields.items() if field.default is None}
    assert none == {"riser_tension", "swing_angle", "descent_rate", "canopy_velocity", "dropouts"}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"breathing": {"frequency": "0.2 Hz", "amplitude": 0.1, "damping_ratio": 1.1}}, "<= 1"),
        ({"canopy_sd": {"1": -0.1}}, ">= 0"),
        ({"turbulence": {"horizontal": "1 m/s", "vertical": "-1 m/s", "time_constant": "3 s"}}, ">= 0 m/s"),
        ({"swing": "90 deg"}, "rad"),
    ],
)
def test_numbers_out_of_range_are_refused(changes, words):
    assert words in _told(VirtualFlight, DROP | changes)
