"""Tables of noise, structure and parameter estimates, as plain values that the template shows."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

from bayeschute.report.run_results import Results, entries, mappings
from bayeschute.report.sentences import plain, truth_inside
from bayeschute.report.structure_text import MOST_RANKED
from bayeschute.report.wording import (
    MISSING,
    at_precision,
    is_number,
    number,
    parameter_meaning,
    scaled,
    short,
    shown_unit,
    us_unit,
)


class Cell(NamedTuple):
    """A cell: its text, a class of the style sheet, and small print under it."""

    text: str
    kind: str = ""
    small: str = ""


def in_both_units(si: str, text: Callable[[float], str], kind: str = "") -> Cell:
    """Values in their unit of the report, and in small print in US units.

    Args:
        si: Their unit.
        text: Writes them, given the factor from that unit.
        kind: Class of the style sheet.
    """
    factor, name = us_unit(si)
    small = text(factor) if name else ""
    return Cell(text(shown_unit(si)[0]), kind, small if any(map(str.isdigit, small)) else "")


def unit_cell(si: str) -> Cell:
    """The unit of a row of such cells, and that of their small print."""
    return Cell(shown_unit(si)[1], "muted", us_unit(si)[1])


def digits_of(facts: Mapping[str, Any], key: str, digits: int = 2) -> Callable[[float], str]:
    """Writes a value to significant digits, given the factor of its unit."""
    return lambda scale: number(scaled(facts, key, scale), digits)


def precision_of(facts: Mapping[str, Any], key: str, sd_key: str) -> Callable[[float], str]:
    """Writes a value to the decimals that its standard deviation justifies, given the factor of its unit."""
    return lambda scale: at_precision(scaled(facts, key, scale), scaled(facts, sd_key, scale))


class Column(NamedTuple):
    """A column: its heading and whether it holds text, code or numbers ("text", "code", "num")."""

    label: str
    kind: str = "text"


class Table(NamedTuple):
    """A table: columns, rows, a caption, spans above the headings, and indices of rows to stand out."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    caption: str = ""
    groups: tuple[tuple[str, int], ...] = ()
    marked: frozenset[int] = frozenset()
    style: str = ""


def columns_of(text: str) -> tuple[Column, ...]:
    """Columns from ``"label:kind|label:kind"``."""
    pairs = (part.rpartition(":") for part in text.split("|"))
    return tuple(Column(label, kind) for label, _, kind in pairs)


def cells(*texts: str | Cell) -> tuple[Cell, ...]:
    """A row of cells."""
    return tuple(t if isinstance(t, Cell) else Cell(t) for t in texts)


def table_of(columns: str, rows: Iterable[tuple[Cell, ...]], caption: str = "", **look: Any) -> Table | None:
    """A table with the columns of `columns_of`; None without rows."""
    made = tuple(rows)
    return Table(columns_of(columns), made, caption, **look) if made else None


def _flat(mapping: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, str]]:
    """Name and text of every value of a nested mapping."""
    for key, value in mapping.items():
        name = f"{prefix}{plain(str(key))}"
        if isinstance(value, Mapping):
            yield from _flat(value, f"{name}, ")
        else:
            yield name, short(value, 5)


def plain_table(mapping: Mapping[str, Any], left: str, right: str) -> Table | None:
    """Any nested mapping as a table of two columns."""
    rows = tuple(cells(name, Cell(text, "wrap")) for name, text in _flat(mapping))
    return Table((Column(left), Column(right)), rows, style="narrow") if rows else None


def noise_table(results: Results) -> Table | None:
    """Measurement noise of the channels and hyperparameters of the latent disturbances, as estimated."""
    known = {name: facts for name, facts in entries(results.part("noise")).items() if facts}
    labels = {"time_constant": "Time constant [s]", "frequency": "Frequency [Hz]", "damping_ratio": "Damping ratio"}
    keys = [key for key in labels if any(is_number(facts.get(key)) for facts in known.values())]
    rows = []
    for name, facts in known.items():
        si = str(facts.get("unit") or "1")
        sizes = [in_both_units(si, digits_of(facts, key, 3)) for key in ("white", "correlated")]
        rest = [number(facts.get(key), 3) for key in keys]
        rows.append(cells(plain(name), *sizes, *rest, unit_cell(si)))
    columns = ["Channel:text", "White:num", "Correlated:num", *(f"{labels[k]}:num" for k in keys), "Unit:text"]
    caption = (
        "Estimated standard deviations (white and autocorrelated part) and time constants; frequency and damping ratio "
        "of oscillators. Wind, forces, roll and breathing are latent disturbances that the fit infers; the others are "
        "channels."
    )
    return table_of("|".join(columns), rows, caption, style="narrow")


def selected_table(facts: Mapping[str, Any]) -> Table | None:
    """The terms of one coefficient with colored and white standard errors."""
    rows = []
    for term in mappings(facts.get("selected")):
        se, white = term.get("se"), term.get("white_se")
        ratio = number(float(white) / float(se), 2) if is_number(white) and is_number(se) and se else MISSING
        unit = str(term.get("unit") or "1")
        rows.append(
            cells(
                Cell(str(term.get("term", MISSING)), "code"),
                Cell(at_precision(term.get("estimate"), se), "strong"),
                number(se, 2),
                number(white, 2),
                ratio,
                Cell("" if unit == "1" else unit, "muted"),
            )
        )
    columns = "Term:code|Estimate:num|Standard error:num|White-noise s.e.:num|White / colored:num"
    if not any(line[-1].text for line in rows):
        return table_of(columns, (line[:-1] for line in rows))
    return table_of(f"{columns}|Unit:text", rows)


def fitted_terms_table(found: Mapping[str, Any]) -> Table | None:
    """Terms of the simulated flight; where a search chose among candidates, these too, by the evidence for each."""
    evidence = found.get("log_bayes_factors")
    evidence = {name: x for name, x in evidence.items() if is_number(x)} if isinstance(evidence, Mapping) else {}
    terms = [str(name) for name in found.get("terms") or ()]
    core = [name for name in terms if name not in evidence]
    rows = []
    for name in [*core, *sorted(evidence, key=lambda name: -evidence[name])]:
        of = f"{evidence[name]:+.1f}" if name in evidence else MISSING
        kept = Cell("fitted", "strong") if name in terms else Cell("left out", "muted")
        rows.append(cells(Cell(name, "code"), Cell(parameter_meaning(name), "muted"), kept, of))
    if evidence:
        return table_of("Term:code|Meaning:text|Status:text|Log Bayes factor:num", rows)
    return table_of("Term:code|Meaning:text", (row[:2] for row in rows))


def ranking_table(facts: Mapping[str, Any]) -> Table | None:
    """The ranking of the orthogonal functions in the form of the NASA report's print-out (section 7.3)."""
    ranking = mappings(facts.get("ranking"))[:MOST_RANKED]
    rows = []
    for place, row in enumerate(ranking, start=1):
        mse, f_ratio, r2, perr = (row.get(k) for k in ("mse", "f_ratio", "r2", "perr"))
        rows.append(
            cells(
                str(place),
                str(row.get("index", MISSING)),
                Cell(str(row.get("term", "")), "code"),
                f"{float(mse) ** 0.5:.3e}" if is_number(mse) and mse >= 0 else MISSING,
                f"{float(row['dmse']):.3e}" if is_number(row.get("dmse")) else MISSING,
                f"{perr:.2f}" if is_number(perr) else MISSING,
                f"{r2:.2f}" if is_number(r2) else MISSING,
                f"{float(row['pe']):.3e}" if is_number(row.get("pe")) else MISSING,
                str(place),
                f"{f_ratio:.2f}" if is_number(f_ratio) else MISSING,
            )
        )
    columns = "o.f.:num|# index:num|term:code|sqrt(mse):num|dmse:num|perr:num|R2:num|pe:num|n:num|F:num"
    least = facts.get("pse_minimum_at")
    kept = int(least) if is_number(least) else len(mappings(facts.get("selected")))
    marked = frozenset({kept - 1}) if 0 < kept <= len(rows) else frozenset()
    return table_of(columns, rows, marked=marked, style="print")


def ceiling_table(facts: Mapping[str, Any]) -> Table | None:
    """Sensitivity of the structure to the noise ceiling."""
    used = facts.get("sigma_max2")
    rows, marked = [], set()
    for i, step in enumerate(mappings(facts.get("sensitivity"))):
        ceiling = step.get("sigma_max2")
        terms = [str(t) for t in step.get("terms") or []]
        root = number(float(ceiling) ** 0.5, 3) if is_number(ceiling) and ceiling >= 0 else MISSING
        low, high = step.get("low"), step.get("high")
        if is_number(used) and is_number(low) and low <= used and (high is None or used < high):
            marked.add(i)
        rows.append(cells(root, str(len(terms)), Cell(", ".join(terms) or MISSING, "code wrap")))
    columns = "Noise ceiling σ_max:num|Terms:num|Selected:code"
    return table_of(columns, rows, marked=frozenset(marked), style="narrow")


def _posterior_row(name: str, facts: Mapping[str, Any], with_truth: bool, most_rhat: float) -> tuple[Cell, ...]:
    """One row of the posterior table; R-hat that is not below `most_rhat` is marked."""
    si = str(facts.get("unit") or "1")
    unit = ", small print ".join(filter(None, (shown_unit(si)[1], us_unit(si)[1])))
    low, high = precision_of(facts, "q05", "sd"), precision_of(facts, "q95", "sd")
    rhat, contraction = facts.get("rhat"), facts.get("contraction")
    weak = is_number(contraction) and contraction < 0.1
    row = [
        Cell(name, "code", parameter_meaning(name) + (f" [{unit}]" if unit else "")),
        in_both_units(si, precision_of(facts, "prior_mean", "prior_sd"), "muted"),
        in_both_units(si, digits_of(facts, "prior_sd"), "muted"),
        in_both_units(si, precision_of(facts, "mean", "sd"), "strong"),
        in_both_units(si, digits_of(facts, "sd")),
        in_both_units(si, lambda scale: f"{low(scale)} … {high(scale)}"),
        Cell(f"{contraction:.2f}" if is_number(contraction) else MISSING, "weak" if weak else ""),
        Cell(f"{rhat:.3f}" if is_number(rhat) else MISSING, "bad" if is_number(rhat) and rhat >= most_rhat else ""),
        Cell(" / ".join(f"{facts[k]:,.0f}" if is_number(facts.get(k)) else MISSING for k in ("ess_bulk", "ess_tail"))),
    ]
    if with_truth:
        inside = truth_inside(facts)
        place = {True: "inside", False: "outside", None: ""}[inside]
        known = in_both_units(si, precision_of(facts, "truth", "sd"), "outside" if inside is False else "")
        row.append(known._replace(small=", ".join(filter(None, (known.small, place)))))
    return tuple(row)


def _rhat_bound(results: Results) -> float:
    """The bound of the run's check `rhat`; infinity where it has none, and nothing is to be marked."""
    bound = entries(results.part("checks")).get("rhat", {}).get("bound")
    return float(bound) if is_number(bound) else math.inf


def posterior_table(results: Results) -> Table | None:
    """Prior and posterior of every parameter, convergence diagnostics, and the true value where it is known."""
    parameters = entries(results.part("parameters"))
    with_truth = any(is_number(p.get("truth")) for p in parameters.values())
    most_rhat = _rhat_bound(results)
    rows = (_posterior_row(name, facts, with_truth, most_rhat) for name, facts in parameters.items())
    columns = (
        "Parameter:text|mean:num|sd:num|mean:num|sd:num|90 % interval:num|contraction:num|R-hat:num|ESS bulk / tail:num"
    )
    groups: tuple[tuple[str, int], ...] = (("", 1), ("Prior", 2), ("Posterior", 4), ("Chains", 2))
    if with_truth:
        columns += "|value:num"
        groups += (("Truth", 1),)
    return table_of(columns, rows, groups=groups, style="dense")


def output_error_table(results: Results) -> Table | None:
    """Estimates of output error with raw and corrected standard errors (the report's table 7.1-2)."""
    rows = []
    for facts in mappings(results.summary.get("output_error")):
        si = str(facts.get("unit") or "1")
        best = in_both_units(si, precision_of(facts, "estimate", "corrected_sd"), "strong")
        errors = [in_both_units(si, digits_of(facts, key)) for key in ("raw_sd", "corrected_sd")]
        rows.append(cells(Cell(str(facts.get("parameter", MISSING)), "code"), best, *errors, unit_cell(si)))
    columns = "Parameter:text|Estimate:num|Raw s.e.:num|Corrected s.e.:num|Unit:text"
    caption = (
        "Classical output error. Raw: Cramer-Rao bound for white residuals. Corrected: for colored (autocorrelated) "
        "residuals; none where the flight is so unstable that they are below the rounding of the estimate. In the form "
        "of table 7.1-2 of NASA/TM-2019-220410; priors included."
    )
    return table_of(columns, rows, caption, style="narrow")
