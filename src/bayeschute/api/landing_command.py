"""Landings of a campaign file by a stored posterior: what `bayeschute land` does."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from bayeschute.api.landing_verb import drawn_from, land
from bayeschute.api.landings import Landings, in_words, requirement_table
from bayeschute.api.results import Posterior
from bayeschute.core.files import write_whole
from bayeschute.report.figures.canvas import save
from bayeschute.study.job import Progress
from bayeschute.study.landing_campaign.campaign_file import load_campaign


class Asked(NamedTuple):
    """What a call of the command wants beside landings.

    Attributes:
        landings: At most so many; None: as the campaign says.
        workers: Local processes.
        address: Of a Dask scheduler.
    """

    landings: int | None = None
    workers: int = 1
    address: str | None = None


def land_file(
    posterior: Path | str,
    campaign: Path | str,
    folder: Path | str,
    wanted: Asked | None = None,
    data: Path | str | None = None,
    progress: Progress | None = None,
) -> list[str]:
    """Land: ``landings.nc``, ``landings.parquet``, ``requirements.csv``, ``exceedance.csv`` and figures.

    Args:
        posterior: From `Posterior.save`.
        campaign: TOML, see `campaign_schema.CampaignFile`.
        folder: Where to; batches that it holds already are kept.
        wanted: How.
        data: What ``${DATA}`` stands for.
        progress: Called with stage, share done and words.

    Returns:
        What was found, line by line.

    Raises:
        InputError: With every fault of the campaign, before anything is flown.
    """
    read, folder, wanted = load_campaign(campaign, data), Path(folder), wanted or Asked()
    if wanted.landings is not None:
        read = read.with_landings(wanted.landings)
    known = Posterior.load(posterior)
    plan = drawn_from(read, known.spec, known.files)
    made = land(read, plan, folder, wanted.workers, wanted.address, progress)
    return write_landings(made, folder)


def write_landings(made: Landings, folder: Path) -> list[str]:
    """Files of landings; returns what they say, line by line."""
    judged = made.judgements()
    made.save(folder / "landings.nc")
    frame = made.table.to_dataframe()
    write_whole(folder / "landings.parquet", lambda path: frame.to_parquet(path, index=False))
    if judged:
        write_whole(folder / "requirements.csv", partial(_csv, requirement_table(judged)))
    quantities = [limit.quantity for one in made.requirements for limit in one.limits] or ["vertical_speed"]
    for quantity in dict.fromkeys(quantities):
        table = made.exceedance(quantity)
        write_whole(folder / f"exceedance-{quantity}.csv", partial(_csv, table))
        save(made.plot(quantity), folder, f"landings-{quantity}")
    return in_words(made, judged)


def _csv(table: pd.DataFrame, path: Path) -> None:
    table.to_csv(path, index=False)
