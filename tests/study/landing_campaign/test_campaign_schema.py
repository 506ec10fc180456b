"""Tables of a campaign file: usual values, and the values just inside and just outside of what may be."""

from __future__ import annotations

import pytest

from bayeschute.core.errors import InputError
from bayeschute.landing.decisions.onset import PlacardPlan
from bayeschute.landing.start_plan import StartPlan
from bayeschute.study.landing_campaign.campaign_file import load_campaign
from bayeschute.study.landing_campaign.campaign_schema import (
    CampaignFile,
    LimitTable,
    PlacardTable,
    RequirementTable,
    StartTable,
)
from bayeschute.study.landing_campaign.landing_plan import start_plan
from bayeschute.study.schema.schema_faults import validated

LEAST = 'title = "t"\nseed = 1\n[start]\naltitude = "1000 m"\n'
SAID = {"title": "t", "seed": 1, "start": {"altitude": "1000 m"}}
SOFT = {"quantity": "vertical_speed", "at_most": "36 km/h"}


def written(tmp_path, text):
    path = tmp_path / "campaign.toml"
    path.write_text(text)
    return path


def refused(model, said):
    with pytest.raises(InputError) as told:
        validated(model, "c", said)
    return str(told.value)


def test_a_start_at_the_ground_is_refused(tmp_path):
    with pytest.raises(InputError, match="50 m over the ground"):
        load_campaign(written(tmp_path, LEAST + '[ground]\naltitude = "990 m"\n'))


def test_starts_are_six_standard_deviations_and_fifty_metres_over_the_ground():
    start = {"altitude": {"mean": "1000 m", "sd": "10 m"}}
    validated(CampaignFile, "c", SAID | {"start": start, "ground": {"altitude": "889.9 m"}})
    assert "lower starts" in refused(CampaignFile, SAID | {"start": start, "ground": {"altitude": "890 m"}})


def test_usual_starts_are_those_of_the_plan():
    assert start_plan(StartTable(altitude="1000 m")) == StartPlan((1000.0, 0.0))


def test_usual_values_of_a_placard_are_within_their_limits():
    made = validated(PlacardTable, "p", {"shear": ["1 m/s"]})
    assert made.shear == (1.0,) and made.capsule_mass == () and made.amplitude == pytest.approx(0.17)
    assert PlacardPlan is not None and (made.middle, made.thickness, made.landings) == (300.0, 100.0, 512)


def test_limits_are_in_si_of_their_quantity_and_one_sided():
    made = validated(LimitTable, "l", SOFT)
    assert made.at_most == pytest.approx(10.0) and made.at_least is None
    made = validated(LimitTable, "l", {"quantity": "hang_angle", "at_least": "180 deg"})
    assert made.at_least == pytest.approx(3.141592653589793) and made.at_most is None
    assert "exactly one" in refused(LimitTable, SOFT | {"at_least": "1 m/s"})
    assert "rad" in refused(LimitTable, {"quantity": "hang_angle", "at_most": "3 m"})


def test_a_requirement_has_limits_and_probabilities_inside_of_zero_and_one():
    usual = validated(RequirementTable, "r", {"name": "soft", "limits": [SOFT]})
    assert (usual.probability, usual.confidence) == (0.95, 0.9)
    for name in ("probability", "confidence"):
        some = {"name": "soft", "limits": [SOFT]}
        assert getattr(validated(RequirementTable, "r", some | {name: 0.999999}), name) == 0.999999
        for value in (0.0, 1.0):
            assert name in refused(RequirementTable, some | {name: value})
    assert "at least one limit" in refused(RequirementTable, {"name": "soft", "limits": []})


@pytest.mark.parametrize(
    ("name", "good", "bad"),
    [
        ("landings", (64, 10_000_000), (63, 10_000_001)),
        ("draws", (2, 100_000), (1, 100_001)),
        ("seed", (0, 2**32 - 1), (-1, 2**32)),
        ("canopy_sd", (0.0, 0.5), (-0.01, 0.51)),
    ],
)
def test_numbers_are_held_to_their_range(name, good, bad):
    for value in good:
        assert getattr(validated(CampaignFile, "c", SAID | {name: value}), name) == value
    for value in bad:
        assert name in refused(CampaignFile, SAID | {name: value})


@pytest.mark.parametrize(("changes", "word"), [({"landings": 63}, "landings"), ({"amplitude": "-1 deg"}, "amplitude")])
def test_placards_that_cannot_be(changes, word):
    assert word in refused(PlacardTable, {"shear": ["1 m/s"]} | changes)
    assert validated(PlacardTable, "p", {"shear": ["1 m/s"], "landings": 64}).landings == 64


def test_usual_values_of_a_campaign():
    made = validated(CampaignFile, "c", SAID)
    assert (made.draws, made.landings, made.canopy_sd, made.name) == (200, 20_000, 0.0, "landings")
    assert made.requirement == () and made.placard is made.design is made.vehicle is made.capsule_mass is None
