"""Landings of a campaign file by a stored posterior: what `bayeschute land` does."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from bayeschute.api.landing.landing_files import write_csv, write_for_others, write_landings
from bayeschute.api.landing.landing_questions import (
    FlownCampaign,
    check_questions,
    drop_ranking,
    rare_failures,
    sensitivity,
    wind_placard,
)
from bayeschute.api.landing.landing_verb import drawn_from, land
from bayeschute.api.posterior import Posterior
from bayeschute.landing.decisions.onset import placard_table
from bayeschute.report.figures.canvas import save
from bayeschute.report.figures.landing_figures import design_figure, drivers_figure, placard_figure
from bayeschute.study.job import Progress
from bayeschute.study.landing_campaign.campaign_file import load_campaign


class LandingOptions(NamedTuple):
    """What a call of the command wants beside landings.

    Attributes:
        landings: At most so many; None: as the campaign says.
        workers: Local processes.
        address: Of a Dask scheduler.
        also: Of ``shares``, ``rare``, ``placard``, ``design``.
    """

    landings: int | None = None
    workers: int = 1
    address: str | None = None
    also: tuple[str, ...] = ()


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
    plan = drawn_from(read, known.spec, known.files)
    made = land(read, plan, folder, wanted.workers, wanted.address, progress, known.failed_checks)
    lines = write_landings(made, folder)
    write_for_others(known, plan, folder)
    done = FlownCampaign(read, plan, made, wanted.workers, wanted.address, progress)
    answers = {
        "shares": partial(_shares, done),
        "rare": partial(_rare, done),
        "placard": partial(_placard, done),
        "design": partial(_design, done, known, data),
    }
    for name in wanted.also:
        lines += answers[name](folder)
    return lines


def _shares(done: FlownCampaign, folder: Path) -> list[str]:
    table = sensitivity(done)
    write_csv(table, folder / "shares.csv")
    save(drivers_figure(table), folder, "shares")
    lines = []
    for name, part in table[table["kind"] == "total"].groupby("quantity", sort=False):
        some = part.sort_values("share", ascending=False)
        rows = zip(some["source"], some["share"], some["standard_error"], strict=True)
        lines.append(f"{name}, total shares: " + ", ".join(f"{s} {x:.2f} +- {e:.2f}" for s, x, e in rows))
    return lines


def _rare(done: FlownCampaign, folder: Path) -> list[str]:
    found = rare_failures(done)
    rows = [(name, one.probability, one.variation, one.evaluations) for name, one in found.items()]
    table = pd.DataFrame(rows, columns=["requirement", "probability_not_met", "variation", "landings"])
    write_csv(table, folder / "rare.csv")
    return [f"{name}: P(not met) {p:.3g}, coefficient of variation {cv:.2f}, {n} landings" for name, p, cv, n in rows]


def _placard(done: FlownCampaign, folder: Path) -> list[str]:
    cells = wind_placard(done)
    write_csv(placard_table(cells), folder / "placard.csv")
    save(placard_figure(cells), folder, "placard")
    return [
        f"shear {c.shear:.3g} m/s, payload {c.capsule_mass:.5g} kg: {c.word}, pendulum {100 * c.pendulum.met:.0f} %"
        for c in cells
    ]


def _design(done: FlownCampaign, known: Posterior, data: Path | str | None, folder: Path) -> list[str]:
    table = drop_ranking(done, known.spec, known.files, data)
    write_csv(table, folder / "design.csv")
    save(design_figure(table), folder, "design")
    design = done.campaign.tables.design
    interval = design.interval if design is not None else None
    lines = []
    for _, row in table.iterrows():
        left = f", {100 * row[f'sd left of {interval}']:.0f} % of the sd of {interval} left" if interval else ""
        spread = f"spread of P(met) {row.spread_now:.3f} now, {row.spread_expected:.3f} expected after it"
        lines.append(f"{row.candidate}: {spread}{left}")
    return lines
