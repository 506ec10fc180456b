"""Further questions to landings: what drives them, rare failures, a wind placard, the value of further drops."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayeschute.api.landing.landing_answers import DropRanking, Placard, RareFailures, Sensitivity
from bayeschute.api.landing.landing_source import LandingSource
from bayeschute.api.workspace import workspace
from bayeschute.core.errors import Fault, InputError
from bayeschute.landing.campaign_plan import CampaignPlan
from bayeschute.landing.decisions.drop_value import probit_slope, ranking
from bayeschute.landing.decisions.onset import PlacardPlan, placard
from bayeschute.landing.decisions.rare_landings import failure
from bayeschute.landing.decisions.requirements import Requirement
from bayeschute.landing.decisions.shares import by_groups, design, shapley
from bayeschute.landing.fly_landings import nested
from bayeschute.landing.measures import IDS
from bayeschute.study.landing_campaign.campaign_file import Campaign
from bayeschute.study.landing_campaign.campaign_schema import DesignTable, PlacardTable
from bayeschute.study.landing_campaign.candidate_drops import Candidates, candidates, covariances
from bayeschute.study.landing_campaign.landing_plan import requirements_of
from bayeschute.study.landing_campaign.posterior_parameters import drawn_values
from bayeschute.study.study import Study

Rows = NDArray[np.void]


def check_questions(campaign: Campaign, questions: Sequence[str], spec: Study, data: Path | str | None = None) -> None:
    """Refuse questions that a campaign has no tables for, before anything is flown.

    Raises:
        InputError: With every fault, those of a file of candidates included.
    """
    where, tables, faults = str(campaign.path), campaign.tables, []
    if questions and not tables.requirement and tuple(questions) != ("placard",):
        faults.append(Fault(where, "no requirement", "one that is asked about", "Add a [[requirement]]."))
    if "placard" in questions and tables.placard is None:
        faults.append(_missing(campaign, "placard"))
    if "design" in questions and tables.design is None:
        faults.append(_missing(campaign, "design"))
    if "design" in questions and tables.design is not None:
        try:
            _candidates(campaign, tables.design, spec, data)
        except InputError as error:
            faults += error.faults
    if faults:
        raise InputError(faults)


def _missing(campaign: Campaign, table: str) -> Fault:
    wanted = {"placard": "a table [placard]", "design": "a table [design] with candidates"}[table]
    return Fault(str(campaign.path), f"no {table}", wanted, "Add it.")


def _wanted(source: LandingSource) -> tuple[Requirement, ...]:
    wanted = requirements_of(source.campaign)
    if not wanted:
        do = "Add a [[requirement]]; in Python, `requirement=[...]` to `Posterior.land`."
        raise InputError(Fault(str(source.campaign.path), "no requirement", "one that is asked about", do))
    return wanted


def sensitivity(source: LandingSource, flown: Rows, samples: int = 512) -> Sensitivity:
    """Shares of every limited quantity's variance, and of met or not met, by groups and by parameters.

    Args:
        source: Of the landings.
        flown: Landings.
        samples: Of each base sample of the design; seven times as many landings are flown, eight where the surface is
            drawn.
    """
    wanted = _wanted(source)
    varied = IDS if source.plan.surface.size else IDS[:-1]
    source.say("shares")(0.0, f"{(len(varied) + 2) * samples} landings")
    rows = source.fly(source.plan, design(source.plan.draws, samples, varied))
    names = dict.fromkeys(limit.quantity for one in wanted for limit in one.limits)
    values = {name: rows[name] for name in names}
    values |= {f"fails: {one.name}": 1.0 - one.met(rows) for one in wanted}
    seen = {name: flown[name] for name in names} | {f"fails: {one.name}": 1.0 - one.met(flown) for one in wanted}
    known = drawn_values(source.plan.models)
    inputs = np.stack(list(known.values()), axis=1) if known else np.zeros((1, 0))
    made = []
    for name, x in values.items():
        found = by_groups(x, varied)
        for kind, shares, errors in (
            ("first", found.first, found.first_error),
            ("total", found.total, found.total_error),
        ):
            made += [(name, kind, *row) for row in zip(found.names, shares, errors, strict=True)]
        fine = np.isfinite(seen[name])
        if known:
            by = shapley(inputs[flown["draw"][fine]], seen[name][fine], list(known))
            made += [(name, "shapley", part, share, np.nan) for part, share in by.items()]
    source.say("shares")(1.0, f"{len(rows)} landings")
    table = pd.DataFrame(made, columns=["quantity", "kind", "source", "share", "standard_error"])
    return source.told(Sensitivity(table))


def rare_failures(source: LandingSource, samples: int = 1000) -> RareFailures:
    """P(a requirement is not met) by subset simulation.

    Args:
        source: Of the landings.
        samples: Of each level.
    """
    wanted, found = _wanted(source), {}
    for i, one in enumerate(wanted):
        source.say("rare")(i / len(wanted), one.name)
        found[one.name] = failure(source.plan, one, samples)
    source.say("rare")(1.0, f"{len(found)} requirements")
    return source.told(RareFailures.of(found))


def wind_placard(source: LandingSource, table: PlacardTable | None = None) -> Placard:
    """P(pendulum) and a verdict by shear and payload.

    Args:
        source: Of the landings.
        table: Shears and payloads; None: the campaign's ``[placard]``.

    Raises:
        InputError: If there is no such table.
    """
    table = table or source.campaign.tables.placard
    if table is None:
        raise InputError(_missing(source.campaign, "placard"))
    masses = table.capsule_mass or (float(np.mean(source.plan.models[0].base.capsule.mass)),)
    cells = PlacardPlan(table.shear, masses, table.middle, table.thickness, table.landings, table.amplitude)

    def fly_draws(plan: CampaignPlan, count: int) -> Rows:
        return source.fly(plan, nested(plan.draws, count))

    made = placard(source.plan, cells, requirements_of(source.campaign), fly_draws, source.say("placard"))
    source.say("placard")(1.0, f"{len(made)} cells")
    return source.told(Placard.of(made))


def drop_ranking(
    source: LandingSource, flown: Rows, table: DesignTable | None = None, data: Path | str | None = None
) -> DropRanking:
    """Candidate drops, the most informative about the first requirement first.

    Where the table says ``interval``, those come first that leave least of that parameter's interval.

    Args:
        source: Of the landings.
        flown: Landings.
        table: Candidates; None: the campaign's ``[design]``.
        data: What ``${DATA}`` stands for.

    Raises:
        InputError: If there are no candidates, their file has faults, or no parameter has that name.
    """
    table = table or source.campaign.tables.design
    if table is None:
        raise InputError(_missing(source.campaign, "design"))
    if len(source.plan.models) > 1:
        raise InputError(Fault("design", "a posterior that mixes models", "one model", "Fit the heaviest alone."))
    drops = _candidates(source.campaign, table, source.spec, data)
    wanted, one = _wanted(source)[0], source.plan.models[0]
    known = [name for name in one.names if name]
    if table.interval is not None and table.interval not in known:
        raise InputError(Fault("[design] interval", repr(table.interval), f"one of {', '.join(known)}"))
    with workspace(drops.study, source.files) as job:
        now, after, lost = covariances(job, drops.noise, source.say("design"))
    if not after:
        raise InputError(
            [Fault(f"candidate {name}", why, "a drop that can be linearised") for name, why in lost.items()]
        )
    slope = probit_slope(one.theta, flown["draw"], wanted.met(flown))
    source.say("design")(1.0, f"{len(after)} candidates" + (f", {len(lost)} can't be judged" if lost else ""))
    names = [name or f"parameter {i}" for i, name in enumerate(one.names)]
    ranked = ranking(slope, now, after, names, table.interval)
    return source.told(DropRanking(ranked, table.interval, lost))


def _candidates(campaign: Campaign, table: DesignTable, spec: Study, data: Path | str | None) -> Candidates:
    return candidates(campaign.path.parent / table.candidates, spec, data)
