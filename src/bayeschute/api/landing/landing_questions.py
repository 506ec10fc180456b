"""Further analyses of a campaign: sensitivity, rare failures, a wind placard, ranking of candidate drops."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayeschute.api.landing.landings import Landings
from bayeschute.api.workspace import Files, workspace
from bayeschute.calibration.workers import client_of, finished
from bayeschute.core.errors import Fault, InputError
from bayeschute.landing.campaign_plan import CampaignPlan
from bayeschute.landing.decisions.drop_value import probit_slope, ranking
from bayeschute.landing.decisions.onset import Cell, PlacardPlan, placard
from bayeschute.landing.decisions.rare import Rare
from bayeschute.landing.decisions.rare_landings import failure
from bayeschute.landing.decisions.requirements import Requirement
from bayeschute.landing.decisions.shares import by_groups, design, shapley
from bayeschute.landing.fly_landings import BATCH, fly, nested
from bayeschute.study.job import Progress
from bayeschute.study.landing_campaign.campaign_file import Campaign
from bayeschute.study.landing_campaign.candidate_drops import candidates, covariances
from bayeschute.study.study import Study

Rows = NDArray[np.void]


@dataclass(frozen=True)
class FlownCampaign:
    """A campaign that was flown, and how further landings of it are flown.

    Attributes:
        campaign: The campaign.
        plan: What its landings are drawn from.
        landings: Landings that were flown.
        workers: Local processes.
        address: Of a Dask scheduler.
        progress: Called with a name, the share done and words.
    """

    campaign: Campaign
    plan: CampaignPlan
    landings: Landings
    workers: int = 1
    address: str | None = None
    progress: Progress | None = None

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

    @property
    def wanted(self) -> tuple[Requirement, ...]:
        """Requirements; a question that needs one refuses where there is none."""
        if not self.landings.requirements:
            do = "Add a [[requirement]]."
            raise InputError(Fault(str(self.campaign.path), "no requirement", "one that is asked about", do))
        return self.landings.requirements


def check_questions(campaign: Campaign, questions: Sequence[str], spec: Study, data: Path | str | None = None) -> None:
    """Refuse questions that a campaign has no tables for, before anything is flown.

    Raises:
        InputError: With every fault, those of a file of candidates included.
    """
    where, tables, faults = str(campaign.path), campaign.tables, []
    if questions and not tables.requirement and tuple(questions) != ("placard",):
        faults.append(Fault(where, "no requirement", "one that is asked about", "Add a [[requirement]]."))
    if "placard" in questions and tables.placard is None:
        faults.append(Fault(where, "no placard", "a table [placard]", "Add it."))
    if "design" in questions and tables.design is None:
        faults.append(Fault(where, "no design", "a table [design] with candidates", "Add it."))
    if "design" in questions and tables.design is not None:
        try:
            candidates(campaign.path.parent / tables.design.candidates, spec, data)
        except InputError as error:
            faults += error.faults
    if faults:
        raise InputError(faults)


def _fly(part: tuple[int, NDArray[np.int64]], plan: CampaignPlan) -> Rows:
    return fly(plan, part[1])


def sensitivity(done: FlownCampaign, samples: int = 512) -> pd.DataFrame:
    """Shares of every limited quantity's variance, and of met or not met, by groups and by parameters.

    Args:
        done: The campaign.
        samples: Of each base sample of the design; seven times as many landings are flown.

    Returns:
        Columns quantity, kind (``first``, ``total``: Sobol's shares of groups; ``shapley``: of parameters), source,
        share, standard_error (NaN where it is not known).
    """
    done.say("shares")(0.0, f"{7 * samples} landings")
    rows = done.fly(done.plan, design(done.plan.draws, samples))
    names = dict.fromkeys(limit.quantity for one in done.wanted for limit in one.limits)
    values = {name: rows[name] for name in names}
    values |= {f"fails: {one.name}": 1.0 - one.met(rows) for one in done.wanted}
    own = done.landings.rows
    seen = {name: own[name] for name in names} | {f"fails: {one.name}": 1.0 - one.met(own) for one in done.wanted}
    known = done.landings.parameters
    inputs = np.stack(list(known.values()), axis=1) if known else np.zeros((1, 0))
    made = []
    for name, x in values.items():
        found = by_groups(x)
        for kind, shares, errors in (
            ("first", found.first, found.first_error),
            ("total", found.total, found.total_error),
        ):
            made += [(name, kind, *row) for row in zip(found.names, shares, errors, strict=True)]
        fine = np.isfinite(seen[name])
        if known:
            by = shapley(inputs[own["draw"][fine]], seen[name][fine], list(known))
            made += [(name, "shapley", source, share, np.nan) for source, share in by.items()]
    done.say("shares")(1.0, f"{len(rows)} landings")
    return pd.DataFrame(made, columns=["quantity", "kind", "source", "share", "standard_error"])


def rare_failures(done: FlownCampaign, samples: int = 1000) -> dict[str, Rare]:
    """P(a requirement is not met) by subset simulation, by name of the requirement."""
    made = {}
    for i, one in enumerate(done.wanted):
        done.say("rare")(i / len(done.wanted), one.name)
        made[one.name] = failure(done.plan, one, samples)
    done.say("rare")(1.0, f"{len(made)} requirements")
    return made


def wind_placard(done: FlownCampaign) -> list[Cell]:
    """The cells of the campaign's ``[placard]``.

    Raises:
        InputError: If the campaign has no such table.
    """
    table = done.campaign.tables.placard
    if table is None:
        raise InputError(Fault(str(done.campaign.path), "no placard", "a table [placard]", "Add it."))
    masses = table.capsule_mass or (float(np.mean(done.plan.models[0].base.capsule.mass)),)
    cells = PlacardPlan(table.shear, masses, table.middle, table.thickness, table.landings, table.amplitude)

    def fly_draws(plan: CampaignPlan, count: int) -> Rows:
        return done.fly(plan, nested(plan.draws, count))

    made = placard(done.plan, cells, done.landings.requirements, fly_draws, done.say("placard"))
    done.say("placard")(1.0, f"{len(made)} cells")
    return made


def drop_ranking(done: FlownCampaign, spec: Study, files: Files, data: Path | str | None = None) -> pd.DataFrame:
    """Candidate drops of the campaign's ``[design]``, the most informative about the first requirement first.

    Where the table says ``interval``, those come first that leave least of that parameter's interval.

    Args:
        done: The campaign.
        spec: Study of the posterior.
        files: Of the posterior.
        data: What ``${DATA}`` stands for.

    Raises:
        InputError: If the campaign names no candidates, their file has faults, or no parameter has that name.
    """
    table = done.campaign.tables.design
    if table is None:
        raise InputError(Fault(str(done.campaign.path), "no design", "a table [design] with candidates", "Add it."))
    if len(done.plan.models) > 1:
        raise InputError(Fault("design", "a posterior that mixes models", "one model", "Fit the heaviest alone."))
    study, wanted = candidates(done.campaign.path.parent / table.candidates, spec, data), done.wanted[0]
    known = [name for name in done.plan.models[0].names if name]
    if table.interval is not None and table.interval not in known:
        raise InputError(Fault("[design] interval", repr(table.interval), f"one of {', '.join(known)}"))
    with workspace(study, files) as job:
        now, after, lost = covariances(replace(job, study=study), done.say("design"))
    if not after:
        raise InputError(
            [Fault(f"candidate {name}", why, "a drop that can be linearised") for name, why in lost.items()]
        )
    one, rows = done.plan.models[0], done.landings.rows
    slope = probit_slope(one.theta, rows["draw"], wanted.met(rows))
    done.say("design")(1.0, f"{len(after)} candidates" + (f", {len(lost)} can't be judged" if lost else ""))
    return ranking(slope, now, after, [name or f"parameter {i}" for i, name in enumerate(one.names)], table.interval)
