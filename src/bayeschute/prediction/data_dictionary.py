"""Data dictionary of the risk folder: meaning and unit of every column, from the written tables themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from bayeschute.core.errors import Fault, InputError
from bayeschute.prediction.flight_statistics import MEANINGS, STATISTICS
from bayeschute.prediction.marginal_fits import NO_EVIDENCE

OWN_UNIT = "see column unit"
_STATISTIC = "statistic of the quantity along a flight; " + "; ".join(f"{k}: {v}" for k, v in STATISTICS.items())
_SIMULATION = "Monte Carlo error of the finite number of independent draws only"

_COMMON: dict[str, tuple[str, str]] = {  # column: its unit and meaning, the same in every file
    "run": ("-", "flight"),
    "chain": ("1", "chain of the sampler, from 0"),
    "draw": ("1", "number of the draw, from 0"),
    "parameter": ("-", "name of the parameter, as in summary.json"),
    "quantity": ("-", "; ".join(f"{k}: {v}" for k, v in MEANINGS.items())),
    "statistic": ("-", _STATISTIC),
    "unit": ("-", "unit of the values in this row"),
    "draws": ("1", "number of draws, including those whose simulation failed"),
    "failed": (
        "1",
        "draws whose simulation failed; they count as above every threshold and as not meeting a requirement",
    ),
    "independent_draws": ("1", "effective number of independent draws"),
    "confidence": ("1", "confidence level of the limits"),
    "credible_low": ("1", f"lower credible limit of the probability (Jeffreys' prior), {_SIMULATION}"),
    "credible_high": ("1", f"upper credible limit of the probability (Jeffreys' prior), {_SIMULATION}"),
    "widened_by": (
        "1",
        "factor by which draws were widened about their median ([predict] recalibrate); 1: not widened",
    ),
}

COLUMNS: dict[str, dict[str, tuple[str, str]]] = {
    "draws_units": {"column": ("-", "column of draws.csv"), "unit": ("-", "its unit")},
    "marginals": {
        "family": ("-", "standard family, the first of normal, lognormal, truncated normal and Student-t whose Akaike "
                   f"criterion lies within {NO_EVIDENCE:g} of the smallest"),
        "location": (OWN_UNIT, "mean of the parent normal or centre of the Student-t; lognormal: mean of the log [1]"),
        "scale": (OWN_UNIT, "standard deviation of the parent normal or scale of the Student-t; lognormal: of the log "
                  "[1]"),
        "truncation_low": (OWN_UNIT, "lower truncation; -inf where there is none"),
        "truncation_high": (OWN_UNIT, "upper truncation; inf where there is none"),
        "degrees_of_freedom": ("1", "degrees of freedom of the Student-t; inf for the others"),
        "aic": ("1", "Akaike's criterion of the family, per independent draw"),
        "runner_up": ("-", f"best of the other families; its criterion may be up to {NO_EVIDENCE:g} smaller"),
        "runner_up_aic": ("1", "Akaike's criterion of that family"),
        "ks_distance": ("1", "Kolmogorov-Smirnov distance between the draws and the family"),
        "mean": (OWN_UNIT, "mean of the draws"),
        "sd": (OWN_UNIT, "standard deviation of the draws"),
        "q00135": (OWN_UNIT, "0.135 % quantile of the draws"),
        "q05": (OWN_UNIT, "5 % quantile of the draws"),
        "q50": (OWN_UNIT, "median of the draws"),
        "q95": (OWN_UNIT, "95 % quantile of the draws"),
        "q99865": (OWN_UNIT, "99.865 % quantile of the draws"),
        "fit_q00135": (OWN_UNIT, "0.135 % quantile of the family"),
        "fit_q99865": (OWN_UNIT, "99.865 % quantile of the family"),
    },
    "end_of_record": {},
    "exceedance": {
        "threshold": (OWN_UNIT, "value to be exceeded"),
        "exceeded": ("1", "draws that exceed it, including failed ones"),
        "probability": ("1", "share of the draws that exceed it"),
        "clopper_pearson_low": ("1", f"lower Clopper-Pearson limit of the probability, {_SIMULATION}"),
        "clopper_pearson_high": ("1", f"upper Clopper-Pearson limit of the probability, {_SIMULATION}"),
    },
    "tolerance": {
        "share": ("1", "share of flights that lies below the limit"),
        "confidence": ("1", "one-sided confidence that it does"),
        "failures": ("1", "draws allowed above the limit"),
        "needed": ("1", "independent draws needed"),
        "enough": ("-", "whether there are as many independent draws as needed"),
        "limit": (OWN_UNIT, "upper tolerance limit (Wilks); empty where draws are too few, inf where a draw failed"),
    },
    "requirements": {
        "name": ("-", "name of the requirement in the study"),
        "at_most": (OWN_UNIT, "upper limit, or null"),
        "at_least": (OWN_UNIT, "lower limit, or null"),
        "probability_met": ("1", "share of the draws that meet the requirement"),
        "simulation_low": ("1", f"lower Clopper-Pearson limit of the probability, {_SIMULATION}"),
        "simulation_high": ("1", f"upper Clopper-Pearson limit of the probability, {_SIMULATION}"),
        "posterior_sd": ("1", "standard deviation of P(met | parameters) over the posterior; null with one simulation "
                         "per draw"),
        "posterior_q05": ("1", "5 % quantile of P(met | parameters); null with one simulation per draw"),
        "posterior_q95": ("1", "95 % quantile of P(met | parameters); null with one simulation per draw"),
        "draws": ("1", "draws of the parameters"),
        "simulations": ("1", "simulated flights, including failed ones"),
        "independent_simulations": ("1", "effective number of independent simulations"),
        "met": ("1", "simulations that meet the requirement"),
        "q05": (OWN_UNIT, "5 % quantile of the statistic"),
        "median": (OWN_UNIT, "median of the statistic"),
        "q95": (OWN_UNIT, "95 % quantile of the statistic"),
        "margin": (OWN_UNIT, "distance of the median from the limit, positive where the limit is met"),
    },
}  # fmt: skip
"""Columns (fields, of requirements.json) by file beyond those that mean the same everywhere: unit and meaning."""


def _parameter_columns(stem: str, name: str, units: Mapping[str, str]) -> tuple[str, str]:
    """Unit and meaning of a column that bears the name of a parameter."""
    if stem == "correlation":
        return "1", f"correlation with {name}"
    return units.get(name, "1"), "draws of this parameter, which summary.json (`parameters`) and the report describe"


def data_dictionary(files: Mapping[str, Sequence[str]], units: Mapping[str, str]) -> pd.DataFrame:
    """Every column of every file with its unit and meaning.

    Args:
        files: File name to its columns (fields).
        units: Unit of every parameter and quantity.

    Returns:
        Columns file, column, unit, meaning.

    Raises:
        InputError: If a column has no description.
    """
    rows = []
    for file, columns in files.items():
        stem = file.split(".")[0]
        for name in columns:
            known = COLUMNS.get(stem, {}).get(name) or _COMMON.get(name)
            if known is None and stem == "end_of_record" and name in MEANINGS:
                known = (units.get(name, "1"), f"{MEANINGS[name]}, {STATISTICS['final']}")
            if known is None and stem in ("draws", "correlation"):
                known = _parameter_columns(stem, name, units)
            if known is None:
                raise InputError(Fault(f"data_dictionary {file}", name, "a column whose meaning is stated in COLUMNS"))
            rows.append({"file": file, "column": name, "unit": known[0], "meaning": known[1]})
    return pd.DataFrame(rows)
