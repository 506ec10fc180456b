"""Files of landings for people and for other programs, and the data dictionary of their columns."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from bayeschute.api.landing.landings import Landings, in_words, requirement_table
from bayeschute.api.landing.other_programs_files import write_other_programs
from bayeschute.api.posterior import Posterior
from bayeschute.core.files import write_whole
from bayeschute.landing import aero_table
from bayeschute.landing.campaign_plan import CampaignPlan
from bayeschute.landing.measures import IDS, MEASURES
from bayeschute.landing.other_programs import rocketpy_parachutes
from bayeschute.prediction.risk_files import write_risk
from bayeschute.report.figures.canvas import save

_OF_LANDINGS = {name: ("1", f"number of the {name} that the landing has; equal numbers are equal") for name in IDS} | {
    "profile": ("1", "number of its wind profile, from 0"),
    "outcome": ("-", "ok, diverged, or not down in time"),
    "label": ("-", "what the cluster did in the last seconds"),
}
_PROBABILITY = {
    "probability_met": ("1", "mean over draws of the parameters and landings"),
    "posterior_low": ("1", "lower end of the 90 % interval over the posterior, Monte Carlo error included"),
    "posterior_high": ("1", "upper end of it"),
}
_OF_REQUIREMENTS = {
    "requirement": ("-", "its name"),
    "wanted_probability": ("1", "least probability that a landing keeps all limits"),
    "wanted_confidence": ("1", "posterior probability with which that must be reached"),
    **_PROBABILITY,
    "epistemic_sd": ("1", "standard deviation of P(met | parameters) over the posterior"),
    "aleatory_sd": ("1", "scatter of met or not met from landing to landing: root of the mean of p (1 - p)"),
    "monte_carlo_sd": ("1", "standard error of probability_met for the number of draws and landings"),
    "posterior_probability_reached": ("1", "posterior probability that P(met) is the wanted one or more"),
    "verdict": ("-", "met, not met, or can't tell yet"),
    "more_draws_factor": ("1", "times the landings that may tell; empty where no number of them would"),
    "more_drops": ("1", "drops as telling as those fitted that may tell"),
    "landings": ("1", "number of landings"),
    "draws": ("1", "number of draws of the parameters among them"),
    "failed": ("1", "landings whose simulation failed; they count as not met"),
}
_OF_EXCEEDANCE = {
    "threshold": ("unit of the quantity in the file's name", "threshold"),
    "probability": ("1", "P(quantity > threshold)"),
    "posterior_low": _PROBABILITY["posterior_low"],
    "posterior_high": _PROBABILITY["posterior_high"],
    "clopper_pearson_low": ("1", "lower 90 % limit of the mean for the number of landings, draws shared"),
    "clopper_pearson_high": ("1", "upper limit of it"),
    "failed": ("1", "landings whose simulation failed; they exceed"),
}


def write_landings(made: Landings, folder: Path) -> list[str]:
    """Landings, requirements, exceedance and figures; returns what they say, line by line."""
    judged = made.judgements()
    made.save(folder / "landings.nc")
    frame = made.table.to_dataframe()
    write_whole(folder / "landings.parquet", lambda path: frame.to_parquet(path, index=False, write_page_checksum=True))
    write_csv(requirement_table(judged), folder / "requirements.csv")
    for quantity in _limited(made):
        write_csv(made.exceedance(quantity), folder / f"exceedance-{quantity}.csv")
        save(made.plot(quantity), folder, f"landings-{quantity}")
    write_csv(dictionary(made), folder / "data_dictionary.csv")
    return in_words(made, judged)


def write_for_others(
    known: Posterior, plan: CampaignPlan, folder: Path, name: str = "canopies", jsbsim_draws: int = 0
) -> list[str]:
    """A row per parameter as a model memo has it, correlations, joint draws, and canopies of the campaign's draws.

    The first three are of the whole posterior, in ``parameters/``; ``aero_tables.csv``, ``jsbsim_canopies.xml`` and
    ``rocketpy_parachutes.json`` are of the draws that landed.

    Args:
        known: The posterior.
        plan: With the draws.
        folder: Where to.
        name: Of the campaign.
        jsbsim_draws: Number of draws that get a file of JSBSim each, in ``jsbsim/``.

    Returns:
        Why a file was not written, line by line.
    """
    draws = {name: np.asarray(known[name].values) for name in known.names}
    units = {name: str(known[name].attrs.get("units", "1")) for name in known.names}
    write_risk(folder / "parameters", draws, units=units)
    tables, first = [], 0
    for one in plan.models:
        tables.append(aero_table.aero_table(one, first))
        first += len(one.theta)
    write_csv(pd.concat(tables, ignore_index=True), folder / "aero_tables.csv")
    return write_other_programs(plan, name, folder, jsbsim_draws)


def write_csv(table: pd.DataFrame, path: Path) -> None:
    """Write a frame as CSV with every digit."""
    write_whole(path, lambda part: table.to_csv(part, index=False))


def _limited(made: Landings) -> list[str]:
    """Quantities that a requirement limits; the vertical speed where there is none."""
    names = [limit.quantity for one in made.requirements for limit in one.limits]
    return list(dict.fromkeys(names or ["vertical_speed"]))


def dictionary(made: Landings) -> pd.DataFrame:
    """File, column, unit and meaning of everything that `write_landings` and the files for other programs hold."""
    files = {"landings.parquet": _OF_LANDINGS | MEASURES, "requirements.csv": _OF_REQUIREMENTS}
    files |= {f"exceedance-{quantity}.csv": _OF_EXCEEDANCE for quantity in _limited(made)}
    files["aero_tables.csv"] = aero_table.COLUMNS
    files[rocketpy_parachutes.DATA] = rocketpy_parachutes.ENTRIES
    rows = [(file, name, *said) for file, columns in files.items() for name, said in columns.items()]
    return pd.DataFrame(rows, columns=["file", "column", "unit", "meaning"])
