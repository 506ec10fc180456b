"""From a posterior to landings: what `Posterior.land` and `bayeschute land` share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bayeschute.api.landing.landing_source import LandingSource
from bayeschute.api.landing.landings import Landings, stopping
from bayeschute.api.workspace import Files, workspace
from bayeschute.study.job import Progress
from bayeschute.study.landing_campaign.campaign_climatology import ClimatologyTable
from bayeschute.study.landing_campaign.campaign_file import Campaign
from bayeschute.study.landing_campaign.campaign_schema import CampaignFile
from bayeschute.study.landing_campaign.landing_plan import identity_of, plan_of, requirements_of
from bayeschute.study.landing_campaign.landing_rows import fly_campaign
from bayeschute.study.landing_campaign.posterior_parameters import drawn_values
from bayeschute.study.schema.schema_faults import validated
from bayeschute.study.schema.vehicle_schema import Vehicle
from bayeschute.study.schema.wind_schema import ProfileTable
from bayeschute.study.study import Study

Winds = Mapping[str, Any] | ProfileTable | Sequence[ProfileTable] | ClimatologyTable | None
USUAL_START = {
    "altitude": "1200 m",
    "swing": {"mean": "0 deg", "sd": "6 deg"},
    "swing_rate": {"mean": "0 deg/s", "sd": "1.5 deg/s"},
    "cone_rate": {"mean": "0 deg/s", "sd": "1.5 deg/s"},
    "tilt": "2 deg",
    "body_rate": "1 deg/s",
}


def campaign_of(
    vehicle: Vehicle | None, winds: Winds, draws: int, start: Mapping[str, Any] | None, seed: int, **tables: Any
) -> Campaign:
    """A campaign from Python's values in place of a file's.

    Args:
        vehicle: That lands; None: the posterior's.
        winds: As of `Posterior.land`.
        draws: Landings.
        start: Entries of ``[start]``.
        seed: Of all random numbers.
        **tables: Other entries of a campaign file.

    Raises:
        InputError: With every fault.
    """
    if isinstance(winds, ProfileTable):
        winds = {"profile": [winds]}
    elif isinstance(winds, ClimatologyTable):
        winds = {"climatology": winds}
    elif winds is not None and not isinstance(winds, Mapping):
        winds = {"profile": list(winds)}
    said = {"title": "landings", "seed": seed, "landings": draws, "start": {**USUAL_START, **(start or {})}, **tables}
    said |= {"wind": dict(winds)} if winds is not None else {}
    return Campaign(Path("landings"), validated(CampaignFile, "land", said, {"folder": "."}), vehicle)


def source_of(
    campaign: Campaign,
    spec: Study,
    files: Files,
    failed_checks: tuple[str, ...] = (),
    workers: int = 1,
    address: str | None = None,
    progress: Progress | None = None,
    level: str = "",
) -> LandingSource:
    """How the landings of a campaign are flown by a posterior: arguments as of `LandingSource`."""
    with workspace(spec, files) as job:
        plan = plan_of(campaign, job)
    return LandingSource(campaign, plan, spec, files, failed_checks, workers, address, progress, level)


def land(source: LandingSource, folder: Path | None = None) -> Landings:
    """Fly the landings of a campaign until its requirements are decided, or all of them.

    Args:
        source: How they are flown.
        folder: Where batches are kept as they come.
    """
    campaign, plan, wanted = source.campaign, source.plan, requirements_of(source.campaign)
    rows = fly_campaign(
        plan, campaign.tables.landings, folder, identity_of(campaign, plan.models), source.workers, source.address,
        source.progress, stopping(wanted) if wanted else None,
    )  # fmt: skip
    drawn = drawn_values(plan.models)
    return Landings(campaign.tables.name, rows, wanted, drawn, source.failed_checks, source, source.level)
