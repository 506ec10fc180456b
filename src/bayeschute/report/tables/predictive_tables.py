"""Table and sentence of the posterior predictive checks of the fitted records."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bayeschute.report.run_results import Results, mappings
from bayeschute.report.tables.summary_tables import Cell, Table, cells, table_of
from bayeschute.report.wording import is_number, number

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
        kind = "bad" if float(one["p"]) < limit else ""
        texts = (str(one["flight"]), str(one["what"]), str(one["statistic"]), number(one["value"], 3))
        rows.append(cells(*texts, number(one["expected"], 3), Cell(f"{float(one['p']):.1g}", kind)))
    caption = (
        f"Smallest of {len(checks)} p-values. With a p-value below {limit:.1g} "
        "(Bonferroni) the record is not one that the model makes. Innovations: standardised one-step prediction "
        "errors. Disturbances: draws of the standardised process noise, given the record."
    )
    columns = "Flight:text|Of:text|Statistic:text|Value:num|Expected:num|p-value:num"
    return table_of(columns, rows, caption, style="dense")
