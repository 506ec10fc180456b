"""From a posterior to landings: what `Posterior.land` and `bayeschute land` share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.api.landing.landings import Landings, stopping
from bayeschute.api.workspace import Files, workspace
from bayeschute.dynamics.cluster_flight import LOGARITHMIC
from bayeschute.landing.campaign_plan import CampaignPlan, Parameters
from bayeschute.study.job import Progress
from bayeschute.study.landing_campaign.campaign_file import Campaign
from bayeschute.study.landing_campaign.campaign_schema import CampaignFile
from bayeschute.study.landing_campaign.landing_plan import identity_of, plan_of, requirements_of
from bayeschute.study.landing_campaign.landing_rows import fly_campaign
from bayeschute.study.schema.schema_faults import validated
from bayeschute.study.schema.vehicle_schema import Vehicle
from bayeschute.study.schema.wind_schema import ProfileTable
from bayeschute.study.study import Study

Winds = Mapping[str, Any] | ProfileTable | Sequence[ProfileTable] | None
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
    elif winds is not None and not isinstance(winds, Mapping):
        winds = {"profile": list(winds)}
    said = {"title": "landings", "seed": seed, "landings": draws, "start": {**USUAL_START, **(start or {})}, **tables}
    said |= {"wind": dict(winds)} if winds is not None else {}
    return Campaign(Path("landings"), validated(CampaignFile, "land", said, {"folder": "."}), vehicle)


def drawn_from(campaign: Campaign, spec: Study, files: Files) -> CampaignPlan:
    """What the landings of a campaign are drawn from, by a posterior."""
    with workspace(spec, files) as job:
        return plan_of(campaign, job)


def land(
    campaign: Campaign,
    plan: CampaignPlan,
    folder: Path | None = None,
    workers: int = 1,
    address: str | None = None,
    progress: Progress | None = None,
    failed_checks: tuple[str, ...] = (),
) -> Landings:
    """Fly the landings of a campaign until its requirements are decided, or all of them.

    Args:
        campaign: The campaign.
        plan: From `drawn_from`.
        folder: Where batches are kept as they come.
        workers: Local processes.
        address: Of a Dask scheduler.
        progress: Called with a name, the share done and words.
        failed_checks: Of the posterior.
    """
    wanted = requirements_of(campaign)
    rows = fly_campaign(
        plan, campaign.tables.landings, folder, identity_of(campaign, plan.models), workers, address, progress,
        stopping(wanted) if wanted else None,
    )  # fmt: skip
    return Landings(campaign.tables.name, rows, wanted, drawn_values(plan.models), failed_checks)


def drawn_values(models: Sequence[Parameters]) -> dict[str, NDArray[np.float64]]:
    """Draws of the parameters by name in their own units; those that not all models have are left out."""
    shared = [name for name in models[0].names if name and all(name in one.names for one in models)]
    made = {}
    for name in shared:
        values = np.concatenate([one.theta[:, one.names.index(name)] for one in models])
        made[name] = np.exp(values) if name in LOGARITHMIC else values
    return made
