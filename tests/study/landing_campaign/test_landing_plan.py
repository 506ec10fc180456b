"""From a campaign to the plan of its landings: every table in its place, and an identity of all that matters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.landing.plans import small_plan

from bayeschute.landing.decisions.requirements import Limit, Requirement
from bayeschute.landing.start_plan import StartPlan
from bayeschute.landing.surface import SurfacePlan
from bayeschute.study.landing_campaign import landing_plan as module
from bayeschute.study.landing_campaign.campaign_file import load_campaign
from bayeschute.study.landing_campaign.landing_plan import identity_of, plan_of, requirements_of

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "models/campaigns/cdt-3-11-landing.toml"
CAMPAIGN = """
title = "t"
seed = 7
draws = 12
capsule_mass = "9000 kg"
canopy_sd = 0.02
[start]
altitude = { mean = "1000 m", sd = "20 m" }
swing = { mean = "0.1 rad", sd = "0.2 rad" }
azimuth = "0.3 rad"
swing_rate = "0.01 rad/s"
cone_rate = "0.02 rad/s"
flyout = "0.16 rad"
turn_rate = "0.03 rad/s"
tilt = "0.04 rad"
body_rate = "0.05 rad/s"
speed = { mean = 1.1, sd = 0.1 }
horizontal = "3 m/s"
[ground]
altitude = "120 m"
contact_height = "2.5 m"
slope = "0.1 rad"
[wind]
error_sd = "2 m/s"
[[requirement]]
name = "within"
probability = 0.8
confidence = 0.7
limits = [{ quantity = "vertical_speed", at_most = "12 m/s" }, { quantity = "time", at_least = "9 s" }]
"""


@pytest.fixture
def campaign(tmp_path):
    (tmp_path / "c.toml").write_text(CAMPAIGN)
    return load_campaign(tmp_path / "c.toml")


def test_the_plan_has_every_table_in_its_place(campaign, monkeypatch):
    monkeypatch.setattr(module, "parameters_of", lambda *given: given)
    made = plan_of(campaign, "job")
    assert made.models == ("job", None, 9000.0, 12)
    assert (made.ground, made.contact, made.canopy_sd, made.seed) == (120.0, 2.5, 0.02, 7)
    assert made.winds.error_sd == 2.0 and made.surface == SurfacePlan((0.1, 0.0))
    assert made.start == StartPlan(
        (1000.0, 20.0), (0.1, 0.2), 0.3, (0.01, 0.0), (0.02, 0.0), (0.16, 0.0), (0.03, 0.0), 0.04, 0.05, (1.1, 0.1),
        (3.0, 0.0),
    )  # fmt: skip


def test_requirements_keep_their_sides_and_probabilities(campaign):
    limits = Limit("vertical_speed", 12.0, None), Limit("time", None, 9.0)
    assert requirements_of(campaign) == (Requirement("within", limits, 0.8, 0.7),)


def test_identity_is_of_all_that_landings_depend_on():
    campaign, models = load_campaign(EXAMPLE), small_plan().models
    base = models[0].base
    heavier = replace(models[0], base=replace(base, capsule=replace(base.capsule, mass=9000.0)))
    other = replace(models[0], theta=models[0].theta + 1e-9)
    found = {identity_of(campaign, some) for some in (models, (heavier,), (other,))}
    assert len(found) == 3 and identity_of(campaign.with_landings(9), models) in found


def test_identity_is_of_laws_names_terms_and_the_program_too(campaign, monkeypatch):
    one = small_plan().models[0]
    louder = replace(one, laws=tuple(1.001 * law for law in one.laws))
    renamed = replace(one, names=("", *one.names[1:]))
    term = replace(one, structure=replace(one.structure, axial=("2", *one.structure.axial[1:])))
    across = replace(one, structure=replace(one.structure, transverse=("x", *one.structure.transverse[1:])))
    some = [(one,), (louder,), (renamed,), (term,), (across,), (one, one), ()]
    found = [identity_of(campaign, models) for models in some]
    assert len(set(found)) == len(some) and identity_of(campaign, (replace(one, theta=np.copy(one.theta)),)) == found[0]
    monkeypatch.setattr(module, "__version__", "0.0.0")
    assert identity_of(campaign, (one,)) not in found
