"""Ground that slopes and water with waves in a campaign file."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.landing.surface import SurfacePlan, Waves
from bayeschute.study.landing_campaign.campaign_file import load_campaign, surface_plan
from bayeschute.study.landing_campaign.landing_plan import requirements_of

LEAST = 'title = "t"\nseed = 1\n[start]\naltitude = "1000 m"\n'


def load(folder, text):
    (folder / "c.toml").write_text(LEAST + text)
    return load_campaign(folder / "c.toml")


def surface(folder, text):
    return surface_plan(load(folder, text).tables.ground)


def test_the_ground_is_level_unless_said(tmp_path):
    assert surface(tmp_path, "") == surface(tmp_path, '[ground]\naltitude = "3 m"\n') == SurfacePlan()
    assert SurfacePlan().level


def test_slopes(tmp_path):
    five = np.deg2rad(5.0)
    made = surface(tmp_path, '[ground]\nslope = "5 deg"\nslope_direction = "90 deg"\n')
    assert made.slope == pytest.approx((five, 0.0)) and made.direction == pytest.approx(np.pi / 2.0)
    made = surface(tmp_path, '[ground]\nslope = { mean = "5 deg", sd = "1 deg" }\n')
    assert made.slope == pytest.approx((five, five / 5.0)) and made.direction is None and made.size == 3


def test_waves_and_limits_against_them(tmp_path):
    text = '[ground.waves]\nsignificant_height = "6 ft"\nmean_period = "6 s"\ndirection = "0 deg"\n' + (
        '[[requirement]]\nname = "impact"\nlimits = [{ quantity = "normal_speed", at_most = "33 ft/s" },\n'
        '{ quantity = "tangential_speed", at_most = "40 ft/s" }, { quantity = "surface_angle", at_most = "30 deg" }]\n'
    )
    campaign = load(tmp_path, text)
    assert surface_plan(campaign.tables.ground).waves == Waves(pytest.approx(1.8288), 6.0, 0.0)
    assert [limit.quantity for limit in requirements_of(campaign)[0].limits][2] == "surface_angle"
    other = load(tmp_path, text.replace("mean_period", "peak_period").replace('direction = "0 deg"\n', ""))
    assert surface_plan(other.tables.ground).waves == Waves(pytest.approx(1.8288), 6.0)
    assert other.identity != campaign.identity


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[ground]\nslope = "61 deg"\n', ["slope", "<= 1.0472 rad"]),
        ('[ground]\nslope = "-1 deg"\n', [">= 0 rad"]),
        ('[ground]\nslope = { mean = "1 deg", sd = "-1 deg" }\n', [">= 0 rad"]),
        ('[ground]\nslope_direction = "1 deg"\n', ["slope_direction without slope"]),
        ('[ground]\nslope = "1 deg"\n[ground.waves]\nsignificant_height = "1 m"\npeak_period = "8 s"\n', ["both"]),
        ('[ground.waves]\nsignificant_height = "1 m"\n', ["exactly one of peak_period and mean_period", "neither"]),
        ('[ground.waves]\nsignificant_height = "1 m"\npeak_period = "8 s"\nmean_period = "8 s"\n', ["got both"]),
        ('[ground.waves]\nsignificant_height = "6 m"\npeak_period = "5 s"\n', ["0.15 wave lengths", "period right"]),
        ('[ground.waves]\nsignificant_height = "0 m"\npeak_period = "5 s"\n', ["> 0 m"]),
        ('[ground.waves]\npeak_period = "0 s"\n', ["> 0 s", "significant_height", "required"]),
        (
            '[ground]\nslope = "1 deg"\nslope_direction = 3\n[ground.waves]\nheight = "1 m"\n',
            ["bare number", "unknown key 'height'", "significant_height"],
        ),
    ],
)
def test_ground_that_cannot_be(tmp_path, text, words):
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    for word in words:
        assert word in str(caught.value), str(caught.value)
