"""From a campaign and a posterior to the plan of its landings, and the identity of that."""

from __future__ import annotations

import hashlib

import jax
import numpy as np

from bayeschute.core.version import __version__
from bayeschute.landing.campaign_plan import CampaignPlan, Parameters
from bayeschute.landing.decisions.requirements import Limit, Requirement
from bayeschute.landing.start_plan import StartPlan
from bayeschute.study.job import Job
from bayeschute.study.landing_campaign.campaign_file import Campaign, surface_plan, wind_plan
from bayeschute.study.landing_campaign.campaign_schema import StartTable
from bayeschute.study.landing_campaign.posterior_parameters import parameters_of


def plan_of(campaign: Campaign, job: Job) -> CampaignPlan:
    """What the landings of a campaign are drawn from, by the posterior of a finished fit."""
    tables = campaign.tables
    return CampaignPlan(
        parameters_of(job, campaign.vehicle, tables.capsule_mass, tables.draws),
        start_plan(tables.start), wind_plan(tables.wind), tables.ground.altitude, tables.ground.contact_height,
        tables.canopy_sd, tables.seed, surface_plan(tables.ground),
    )  # fmt: skip


def start_plan(table: StartTable) -> StartPlan:
    """What a start table says, as numbers."""
    return StartPlan(**{name: getattr(table, name) for name in StartTable.model_fields})


def requirements_of(campaign: Campaign) -> tuple[Requirement, ...]:
    """Requirements of a campaign."""
    return tuple(
        Requirement(
            one.name, tuple(Limit(k.quantity, k.at_most, k.at_least) for k in one.limits), one.probability,
            one.confidence,
        )
        for one in campaign.tables.requirement
    )  # fmt: skip


def identity_of(campaign: Campaign, models: tuple[Parameters, ...]) -> str:
    """Hash of all that landings depend on: the campaign, the draws of the posterior, the program."""
    made = hashlib.sha256(f"{campaign.identity} {__version__}".encode())
    for one in models:
        for part in (one.theta, *one.laws, *jax.tree.leaves(one.base)):
            made.update(np.ascontiguousarray(part, float).tobytes())
        made.update(repr((one.names, one.structure.axial, one.structure.transverse)).encode())
    return made.hexdigest()
