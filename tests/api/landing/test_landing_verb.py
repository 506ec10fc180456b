"""From Python's values to a campaign, from a posterior to the plan of landings, and their flight until it is decided."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.landing.plans import small_plan

import bayeschute as bc
from bayeschute.api.landing import landing_verb as module
from bayeschute.api.landing.landing_source import LandingSource
from bayeschute.api.landing.landing_verb import campaign_of, land, source_of
from bayeschute.landing.measures import ROW
from bayeschute.study.landing_campaign import landing_rows
from bayeschute.study.landing_campaign.landing_plan import identity_of, requirements_of
from bayeschute.study.landing_campaign.posterior_parameters import drawn_values

WIND = bc.wind_profile([0.0, 500.0], [1.0, 2.0], [0.0, 0.5])


def test_what_is_not_said_is_a_steady_descent_in_calm_air():
    made = campaign_of(None, None, 640, None, 7)
    tables, start = made.tables, made.tables.start
    assert (tables.landings, tables.seed, tables.title, made.vehicle, made.path) == (
        640,
        7,
        "landings",
        None,
        Path("landings"),
    )
    assert start.altitude == (1200.0, 0.0) and start.swing == pytest.approx((0.0, np.deg2rad(6.0)))
    assert start.swing_rate == start.cone_rate == pytest.approx((0.0, np.deg2rad(1.5)))
    assert (start.tilt, start.body_rate) == pytest.approx((np.deg2rad(2.0), np.deg2rad(1.0)))
    assert tables.wind.profile == () and tables.requirement == ()


def test_entries_of_the_start_replace_single_ones():
    usual, other = (
        campaign_of(None, None, 64, start, 1).tables.start for start in (None, {"tilt": "5 deg", "speed": 0.9})
    )
    assert other.tilt == pytest.approx(np.deg2rad(5.0)) and other.speed == (0.9, 0.0)
    assert other.model_copy(update={"tilt": usual.tilt, "speed": usual.speed}) == usual
    assert module.USUAL_START["tilt"] == "2 deg"


def test_winds_are_a_profile_several_statistics_or_tables():
    other = bc.wind_profile([0.0, 500.0], [3.0, 2.0], [0.0, 0.5])
    climate = bc.wind_climatology([0.0, 900.0], [1.0, 2.0], [0.0, 0.0], [1.0, 2.0], [1.0, 2.0], length=800.0)

    def wind(given):
        return campaign_of(None, given, 64, None, 1).tables.wind

    assert wind(WIND).profile == (WIND,) and wind([WIND, other]).profile == wind((WIND, other)).profile == (WIND, other)
    assert wind(climate).climatology == climate and wind(climate).profile == ()
    assert wind({"profile": [other]}) == wind(other) and wind({"climatology": climate}) == wind(climate)
    assert wind(iter([WIND])).profile == (WIND,)
    assert wind(None) == wind({}) and wind([]) == wind({})


def test_other_tables_are_those_of_a_file():
    vehicle = bc.Study.example().vehicle
    limits = [{"quantity": "vertical_speed", "at_most": "36 ft/s"}]
    made = campaign_of(
        vehicle, WIND, 64, None, 1, name="n", capsule_mass="9 t", requirement=[{"name": "soft", "limits": limits}]
    )
    assert made.vehicle is vehicle and made.tables.name == "n" and made.tables.capsule_mass == 9000.0
    (one,) = requirements_of(made)
    assert one.name == "soft" and one.limits[0].at_most == pytest.approx(36 * 0.3048)
    with pytest.raises(bc.InputError) as caught:
        campaign_of(None, None, 1, {"altitude": 3.0}, 1, speed="3 m/s", canopy_sd=-1.0)
    told = "\n".join(str(fault) for fault in caught.value.faults)
    assert all(word in told for word in ("altitude", "landings", "speed", "canopy_sd")) and told.startswith("land ")


def test_a_source_has_the_plan_of_the_posterior(monkeypatch, sondes):
    opened = []

    @contextmanager
    def workspace(*given):
        opened.append(given)
        yield "job"

    monkeypatch.setattr(module, "workspace", workspace)
    monkeypatch.setattr(module, "plan_of", lambda campaign, job: (campaign, job))
    campaign = campaign_of(None, None, 64, None, 1)
    made = source_of(campaign, sondes.spec, {"a": b""}, ("rhat",), 3, "tcp://x", print, "not checked")
    assert opened == [(sondes.spec, {"a": b""})] and made.plan == (campaign, "job")
    assert (made.campaign, made.spec, made.files) == (campaign, sondes.spec, {"a": b""})
    assert (made.failed_checks, made.workers, made.address, made.progress) == (("rhat",), 3, "tcp://x", print)
    assert made.level == "not checked"
    usual = source_of(campaign, sondes.spec, {})
    assert (usual.failed_checks, usual.workers, usual.address, usual.progress) == ((), 1, None, None)


@pytest.fixture(scope="module")
def plan():
    return small_plan()


REQUIREMENT = [{"name": "soft", "limits": [{"quantity": "vertical_speed", "at_most": "12 m/s"}], "probability": 0.5}]


def test_landings_are_flown_as_the_source_says(plan, monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(module, "fly_campaign", lambda *given: asked.append(given) or "rows")
    monkeypatch.setattr(module, "stopping", lambda wanted: ("stopping", wanted))
    campaign = campaign_of(None, None, 640, None, 1, name="n", requirement=REQUIREMENT)
    source = LandingSource(campaign, plan, "spec", {}, ("rhat",), 3, "tcp://x", print, "held")
    made, wanted = land(source, tmp_path), requirements_of(campaign)
    identity = identity_of(campaign, plan.models)
    assert asked == [(plan, 640, tmp_path, identity, 3, "tcp://x", print, ("stopping", wanted))]
    assert (made.name, made.rows, made.requirements, made.failed_checks) == ("n", "rows", wanted, ("rhat",))
    assert made.source is source and made.level == "held"
    drawn = drawn_values(plan.models)
    assert list(made.parameters) == list(drawn)
    for name, values in drawn.items():
        np.testing.assert_array_equal(made.parameters[name], values)
    land(replace(source, campaign=campaign_of(None, None, 64, None, 1)))
    assert asked[1][1:3] == (64, None) and asked[1][7] is None  # nothing to decide


def test_they_end_when_the_requirement_is_decided(plan, monkeypatch):
    """After the first of eight batches, where every landing keeps to it by far."""
    flown = []

    def part(one, plan):
        flown.append(one)
        rows = np.zeros(one.size, ROW)
        rows["draw"], rows["vertical_speed"] = np.arange(one.size) % 12, 9.0
        return rows

    monkeypatch.setattr(landing_rows, "fly_part", part)
    campaign = campaign_of(None, None, 8 * 1024, None, 1, requirement=REQUIREMENT)
    made = land(LandingSource(campaign, plan, "spec", {}))
    assert len(flown) == 1 and len(made.rows) == flown[0].size and made.judgements()[0].verdict.verdict == "met"
    land(LandingSource(campaign_of(None, None, 2 * 1024, None, 1), plan, "spec", {}))
    assert len(flown) == 3


def test_a_posterior_of_a_point_mass_has_no_landings(sondes):
    with pytest.raises(bc.InputError, match="model 'cluster'"):
        source_of(campaign_of(None, None, 64, None, 1), sondes.spec, {})
