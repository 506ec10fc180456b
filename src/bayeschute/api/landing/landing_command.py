"""Landings of a campaign file by a stored posterior: what `bayeschute land` does."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from bayeschute.api.landing.landing_answers import Answer
from bayeschute.api.landing.landing_files import write_csv, write_for_others, write_landings
from bayeschute.api.landing.landing_questions import (
    check_questions,
    drop_ranking,
    rare_failures,
    sensitivity,
    wind_placard,
)
from bayeschute.api.landing.landing_verb import land, source_of
from bayeschute.api.posterior import Posterior
from bayeschute.report.figures.canvas import save
from bayeschute.study.job import Progress
from bayeschute.study.landing_campaign.campaign_file import load_campaign


class LandingOptions(NamedTuple):
    """What a call of the command wants beside landings.

    Attributes:
        landings: At most so many; None: as the campaign says.
        workers: Local processes.
        address: Of a Dask scheduler.
        also: Of ``shares``, ``rare``, ``placard``, ``design``.
        jsbsim_draws: Draws of the parameters that get a file of JSBSim each.
    """

    landings: int | None = None
    workers: int = 1
    address: str | None = None
    also: tuple[str, ...] = ()
    jsbsim_draws: int = 0


def land_file(
    posterior: Path | str,
    campaign: Path | str,
    folder: Path | str,
    wanted: LandingOptions | None = None,
    data: Path | str | None = None,
    progress: Progress | None = None,
) -> list[str]:
    """Land, and write landings, tables, figures and what other programs take, each named in ``data_dictionary.csv``.

    Args:
        posterior: From `Posterior.save`.
        campaign: TOML, see `campaign_schema.CampaignFile`.
        folder: Where to; batches that it holds already are kept.
        wanted: How, and what else is asked.
        data: What ``${DATA}`` stands for.
        progress: Called with stage, share done and words.

    Returns:
        What was found, line by line.

    Raises:
        InputError: With every fault of the campaign, before anything is flown.
    """
    read, folder, wanted = load_campaign(campaign, data), Path(folder), wanted or LandingOptions()
    if wanted.landings is not None:
        read = read.with_landings(wanted.landings)
    known = Posterior.load(posterior)
    check_questions(read, wanted.also, known.spec, data)
    source = source_of(
        read, known.spec, known.files, known.failed_checks, wanted.workers, wanted.address, progress, known.trust.words
    )
    made = land(source, folder)
    lines = write_landings(made, folder)
    lines += write_for_others(known, source.plan, folder, made.name, wanted.jsbsim_draws)
    questions: dict[str, Callable[[], Answer]] = {
        "shares": partial(sensitivity, source, made.rows),
        "rare": partial(rare_failures, source),
        "placard": partial(wind_placard, source),
        "design": partial(drop_ranking, source, made.rows, data=data),
    }
    for name in wanted.also:
        answer = questions[name]()
        write_csv(answer.table, folder / f"{name}.csv")
        figure = answer.figure()
        if figure is not None:
            save(figure, folder, name)
        lines += answer.words
    return lines
