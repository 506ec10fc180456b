"""How the landings of a campaign are flown, and further ones that its questions need."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from bayeschute.api.landing.landing_answers import Answer
from bayeschute.api.workspace import Files
from bayeschute.calibration.workers import client_of, finished
from bayeschute.core.errors import Fault, InputError
from bayeschute.landing.campaign_plan import CampaignPlan
from bayeschute.landing.fly_landings import BATCH, fly
from bayeschute.study.job import Progress
from bayeschute.study.landing_campaign.campaign_file import Campaign
from bayeschute.study.study import Study

Rows = NDArray[np.void]
A = TypeVar("A", bound=Answer)


@dataclass(frozen=True, eq=False)
class LandingSource:
    """A campaign by a posterior.

    Attributes:
        campaign: The campaign.
        plan: What its landings are drawn from.
        spec: Study of the posterior.
        files: Of the posterior.
        failed_checks: Of the posterior.
        workers: Local processes.
        address: Of a Dask scheduler.
        progress: Called with a name, the share done and words.
        level: Of trust, of the posterior, as `Run.level` has it; empty: not asked.
    """

    campaign: Campaign
    plan: CampaignPlan
    spec: Study
    files: Files
    failed_checks: tuple[str, ...] = ()
    workers: int = 1
    address: str | None = None
    progress: Progress | None = None
    level: str = ""

    def told(self, answer: A) -> A:
        """An answer with what the posterior lacks."""
        return replace(answer, failed_checks=self.failed_checks, level=self.level)

    def say(self, name: str) -> Callable[[float, str], None]:
        """A progress function of one question."""
        return lambda share, words: self.progress(name, share, words) if self.progress is not None else None

    def fly(self, plan: CampaignPlan, ids: NDArray[np.int64]) -> Rows:
        """Rows of landings, by the workers."""
        parts = [ids[at : at + BATCH] for at in range(0, len(ids), BATCH)]
        made: dict[int, Rows] = {}
        with client_of(self.workers if len(parts) > 1 else 1, self.address) as client:
            for (i, _), rows in finished(partial(_fly, plan=plan), list(enumerate(parts)), client, 3):
                if not isinstance(rows, np.ndarray):
                    raise InputError(Fault("land", f"worker lost: {rows.why}"[:300], "landings flown to their end"))
                made[i] = rows
        return np.concatenate([made[i] for i in range(len(parts))])


def _fly(part: tuple[int, NDArray[np.int64]], plan: CampaignPlan) -> Rows:
    return fly(plan, part[1])
