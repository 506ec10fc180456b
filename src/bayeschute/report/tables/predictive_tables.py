"""Table and sentence of the posterior predictive checks of the fitted records."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bayeschute.report.run_results import Results, mappings
from bayeschute.report.tables.summary_tables import Cell, Table, cells, table_of
from bayeschute.report.wording import at_precision, is_number, number

SHOWN = 10


def predictive_checks(results: Results) -> list[Mapping[str, Any]]:
    """The checks of the summary, the smallest p-value first."""
    known = [one for one in mappings(results.part("predictive").get("checks")) if is_number(one.get("p"))]
    return sorted(known, key=lambda one: float(one["p"]))


def predictive_bound(results: Results) -> float:
    """Probability of a false alarm over all checks together."""
    bound = results.part("predictive").get("bound")
    return float(bound) if is_number(bound) else 0.01


def predictive_table(results: Results) -> Table | None:
    """The statistics with the smallest p-values."""
    checks = predictive_checks(results)
    limit, rows = predictive_bound(results) / max(len(checks), 1), []
    for one in checks[:SHOWN]:
        kind = "bad" if float(one["p"]) < limit and one.get("matters", True) else ""
        value = f"{number(one['value'], 3)} {one.get('unit', '')}".rstrip()
        texts = (str(one["flight"]), str(one["what"]), str(one["statistic"]), value)
        rows.append(cells(*texts, number(one["expected"], 3), Cell(f"{float(one['p']):.1g}", kind)))
    caption = (
        f"Smallest of {len(checks)} p-values. With a p-value below {limit:.1g} "
        "(Bonferroni) the record contradicts the model, or its prior where the statistic is a distance from one. "
        "Innovations: standardised one-step prediction errors. Disturbances: draws of the standardised process noise, "
        "given the record."
    )
    columns = "Flight:text|Of:text|Statistic:text|Value:num|Expected:num|p-value:num"
    return table_of(columns, rows, caption, style="dense")


def error_table(results: Results) -> Table | None:
    """Errors of record and vehicle that the fit was tested for, the smallest p-value of each flight first."""
    known = [one for one in mappings(results.part("predictive").get("errors")) if is_number(one.get("p"))]
    limit, rows = predictive_bound(results) / max(len(predictive_checks(results)), 1), []
    for one in known:
        missed = float(one["p"]) < limit
        size = f"{at_precision(one['estimate'], one['se'])} ± {at_precision(one['se'], one['se'])} {one['unit']}"
        texts = (str(one["flight"]), str(one["what"]), size)
        p = Cell(f"{float(one['p']):.1g}", "bad" if missed and one["matters"] else "")
        rows.append(cells(*texts, p, number(one["moves"], 2), str(one["do"]) if missed else ""))
    caption = (
        "What record or vehicle may be wrong in, each by itself: its size if it were, by one Newton step from the fit "
        f"(score test), with its standard error. A p-value below {limit:.1g} says that it is there, or something that "
        "acts like it. It counts where accounting for it would move some parameter by half a posterior standard "
        "deviation or more."
    )
    columns = "Flight:text|Error of:text|Size:num|p-value:num|Moves a parameter by [sd]:num|What to do:text"
    return table_of(columns, rows, caption, style="dense")
