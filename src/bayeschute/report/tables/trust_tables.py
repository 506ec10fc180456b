"""Tables of checks, coverage, requirements, tolerance limits and provenance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from bayeschute.prediction.marginal_fits import NO_EVIDENCE
from bayeschute.report.check_words import wanted
from bayeschute.report.run_results import Results, entries
from bayeschute.report.sentences import plain, requirement_limit, requirements
from bayeschute.report.tables.summary_tables import Cell, Table, cells, plain_table, table_of
from bayeschute.report.wording import (
    MISSING,
    also,
    counted,
    is_number,
    number,
    percent,
    probability,
    quantity,
    quantity_name,
    scaled,
    short,
    shown_unit,
    statistic_name,
    us_unit,
    whole,
)

USUAL = (  # quantity, statistic: commonly needed, shown also where no requirement refers to it
    ("swing_angle", "maximum"),
    ("sea_level_descent_rate", "final"),
    ("descent_rate", "final"),
    ("horizontal_speed", "final"),
)


def coverage_table(results: Results, half: Mapping[tuple[str, str], float]) -> Table | None:
    """Coverage: share of truth and record inside the bands.

    Args:
        results: The run.
        half: Share inside the 50 % band by flight and quantity, of the truth where known, else of the record.
    """
    rows = []
    for flight, quantities in entries(results.part("coverage")).items():
        for name, shares in entries(quantities).items():
            texts = [percent(shares.get("truth")), percent(shares.get("record")), percent(half.get((flight, name)))]
            p = shares.get("truth_p") if is_number(shares.get("truth")) else shares.get("record_p")
            texts.append(number(p, 2) if is_number(p) else MISSING)
            flown, failed = shares.get("draws"), shares.get("failed")
            words = f"{failed} of {flown + failed} simulations failed" if is_number(flown) and failed else ""
            none = [Cell("none", "bad")] * 4 if flown == 0 else texts
            rows.append(cells(flight, Cell(quantity_name(name), "", words), *none))
    columns = "Flight:text|Quantity:text|Truth in 90 % band:num|Record in 90 % band:num|In 50 % band:num|p:num"
    caption = (
        "The bands are of the true motion; a record also contains sensor noise, so a smaller share of it may lie "
        "inside. 50 % band: share of the truth where it is known, else of the record. p: how often a flight drawn from "
        "this forecast has no more of itself in its 90 % band; a very small p contradicts the band."
    )
    return table_of(columns, rows, caption)


def check_table(results: Results) -> Table | None:
    """Every check with its question, value and bound."""
    rows = []
    for name, check in entries(results.part("checks")).items():
        passed = check.get("passed")
        words = {True: ("passed", "good"), False: ("failed", "bad")}
        verdict = words.get(passed, ("not judged", "weak")) if isinstance(passed, bool) else ("not judged", "weak")
        bound = wanted(name, check["bound"]) if is_number(check.get("bound")) else MISSING
        question = Cell(str(check.get("detail") or ""), "wrap")
        rows.append(cells(Cell(plain(name), "strong"), question, short(check.get("value")), bound, Cell(*verdict)))
    return table_of("Check:text|Question:text|Value:num|Wanted:num|Result:text", rows)


def requirement_table(results: Results) -> Table | None:
    """Probability of meeting each requirement, with Monte Carlo limits and with the spread over the posterior."""
    rows = []
    for r in requirements(results):
        unit = str(r.get("unit") or "1")
        simulation = f"{probability(r.get('simulation_low'))} … {probability(r.get('simulation_high'))}"
        posterior = f"{probability(r.get('posterior_q05'))} … {probability(r.get('posterior_q95'))}"
        scale, shown = shown_unit(unit)
        edges = [number(scaled(r, key, scale)) for key in ("q05", "median", "q95")]
        beside = also([r.get(key) for key in ("q05", "median", "q95")], unit)
        small = statistic_name(str(r.get("quantity", "")), str(r.get("statistic") or ""))
        small += f", {r['run']}" if r.get("run") else ""
        failed = r.get("failed")
        rows.append(
            cells(
                Cell(str(r.get("name", MISSING)), "wrap strong", small),
                Cell(requirement_limit(r), "wrap"),
                Cell(f"{edges[1]} {shown}", "", f"90 %: {edges[0]} … {edges[2]}{beside and f'; {beside}'}"),
                Cell(probability(r.get("probability_met")), "big"),
                simulation if is_number(r.get("simulation_low")) else MISSING,
                posterior if is_number(r.get("posterior_q05")) else MISSING,
                Cell(whole(r.get("simulations")), "", f"{failed} failed" if failed else ""),
            )
        )
    columns = (
        "Requirement:text|Limit:text|Predicted:num|P(met):num|Monte Carlo (Clopper-Pearson):num"
        "|over the posterior:num|Simulations:num"
    )
    return table_of(columns, rows, groups=(("", 4), ("90 % limits of P(met)", 2), ("", 1)))


def shown_statistics(results: Results, table: pd.DataFrame) -> pd.DataFrame:
    """The statistics of flights that the report shows: those of the requirements, then `USUAL`.

    Args:
        results: The run.
        table: Frame with columns quantity and statistic.

    Returns:
        Columns quantity and statistic, one row each, of those that are in the table.
    """
    there = set(zip(table["quantity"], table["statistic"], strict=True))
    asked = [(str(r.get("quantity")), str(r.get("statistic"))) for r in requirements(results)]
    rows = [pair for pair in dict.fromkeys([*asked, *USUAL]) if pair in there]
    return pd.DataFrame(rows, columns=["quantity", "statistic"])


def tolerance_report(results: Results) -> Table | None:
    """Wilks' tolerance limits of the statistics that are shown, the tightest that the draws allow."""
    by = ["run", "quantity", "statistic", "share", "confidence"]
    table = results.table("tolerance", *by, "unit", "failures", "needed", "enough", "limit")
    if table is None:
        return None
    table, rows = shown_statistics(results, table).merge(table), []
    for (run, name, statistic, share, confidence), part in table.groupby(by, sort=False):
        enough = part[part["enough"].astype(bool)]
        best = (enough if len(enough) else part).iloc[-1 if len(enough) else 0]
        limit = quantity(float(best["limit"]), str(best["unit"])) if len(enough) else "too few draws"
        rows.append(
            cells(
                str(run),
                statistic_name(str(name), str(statistic)),
                f"{100 * share:g} / {100 * confidence:g}",
                f"{best['needed']:,.0f}",
                f"{best['failures']:,.0f}",
                Cell(limit if limit != MISSING else "none: failed simulations", "" if len(enough) else "weak"),
            )
        )
    columns = (
        "Flight:text|Quantity:text|Share / confidence [%]:num|Draws needed:num|Failures allowed:num|Upper limit:num"
    )
    caption = (
        "Distribution-free tolerance limits by order statistics (Wilks): with the stated confidence, at least the "
        "stated share of flights lies below the limit. Failures allowed: draws that may lie above it. All quantities "
        "and statistics are in risk/tolerance.csv."
    )
    return table_of(columns, rows, caption)


def marginal_report(results: Results) -> Table | None:
    """Marginal fits: distribution family and its constants, by parameter."""
    table = results.table(
        "marginals", "parameter", "unit", "family", "location", "scale", "q00135", "q99865", "ks_distance"
    )
    if table is None:
        return None
    rows = []
    for row in table.to_dict("records"):
        unit = "" if row["unit"] in ("1", 1) else str(row["unit"])
        factor, beside = us_unit(unit)
        constants = [number(float(row[k]), 4) for k in ("location", "scale")]
        ends = [float(row[k]) for k in ("q00135", "q05", "q50", "q95", "q99865")]
        values = [Cell(number(x, 4), "", number(factor * x, 4) if beside else "") for x in ends]
        rows.append(
            cells(
                Cell(str(row["parameter"]), "code"),
                Cell(unit, "muted", beside),
                str(row["family"]),
                *constants,
                *values,
                number(float(row["ks_distance"]), 2),
            )
        )
    heads = "".join(f"|{k}:num" for k in ("0.135 %", "5 %", "50 %", "95 %", "99.865 %"))
    columns = f"Parameter:code|Unit:text|Family:text|location:num|scale:num{heads}|K-S:num"
    caption = (
        "The first of normal, lognormal, truncated normal and Student-t whose Akaike criterion per independent draw "
        f"lies within {NO_EVIDENCE:g} of the smallest; K-S: Kolmogorov-Smirnov distance from the draws. SI units; "
        "small print: quantiles in US units."
    )
    return table_of(columns, rows, caption, style="dense")


def sampling_table(results: Results) -> Table | None:
    """Settings and cost of the sampling."""
    words = {
        "wall_s": "wall time [s]",
        "min_ess_per_s": "smallest effective sample size per second",
        "failed_solves": "failed simulations",
        "divergences": "divergent transitions",
    }
    return plain_table({words.get(k, k): v for k, v in results.part("sampling").items()}, "Item", "Value")


def provenance_tables(results: Results) -> Sequence[Table]:
    """Seed, versions and hashes."""
    rows = [cells(str(k), Cell(str(v), "code wrap")) for k, v in results.part("hashes").items()]
    hashes = table_of("Input:text|Hash:code", rows, style="narrow")
    return [t for t in (plain_table(results.part("versions"), "Package", "Version"), hashes) if t is not None]


def warnings_of(results: Results) -> list[str]:
    """What a reader must not miss: flights without bands, and counts of the sampling that no failed check tells."""
    sampling, checks = results.part("sampling"), entries(results.part("checks"))
    failed = [one for name in ("bands", "divergences") if (one := checks.get(name)) and one.get("passed") is False]
    found = [f"Failed check: {one.get('detail')}." for one in failed]
    for key, noun, verb in (("divergences", "transition", "diverged"), ("failed_solves", "simulation", "failed")):
        count = sampling.get(key)
        if is_number(count) and count > 0 and (key == "failed_solves" or key not in checks):
            found.append(f"{counted(int(count), noun)} of the sampling {verb}; see “Checks and diagnostics”.")
    return found
