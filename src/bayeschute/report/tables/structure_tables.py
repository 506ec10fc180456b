"""The tables of how sure a structure is, how it predicts, and what data of known terms showed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bayeschute.report.tables.summary_tables import Cell, Table, cells, columns_of, mappings
from bayeschute.report.wording import MISSING, at_precision, is_number, number, percent

_MOST_ROWS = 14


def sureness_table(facts: Mapping[str, Any]) -> Table | None:
    """How often each term is kept over block replicates, under several ceilings, and what its error is made of."""
    frequency = facts.get("frequency")
    if not isinstance(frequency, Mapping) or not isinstance(frequency.get("terms"), Mapping):
        return None
    selected = {str(t.get("term")): t for t in mappings(facts.get("selected"))}
    rivals = {str(r.get("term")): r for r in mappings(facts.get("rivals"))}
    by_ceiling, ceilings = frequency.get("by_ceiling") or {}, list(frequency.get("ceilings") or [])
    rows, marked = [], set()
    often = sorted(frequency["terms"].items(), key=lambda pair: (pair[0] not in selected, -float(pair[1] or 0.0)))
    for i, (term, share) in enumerate(often[: max(_MOST_ROWS, len(selected))]):
        kept, rival = selected.get(term), rivals.get(term, {})
        if kept is not None:
            marked.add(i)
        chance = rival.get("chance")
        name = f"{rival.get('rival')} ({percent(chance)})" if is_number(chance) and chance >= 0.01 else ""
        rows.append(
            cells(
                Cell(str(term), "code"),
                percent(share),
                *(percent(value) for value in by_ceiling.get(term, [])),
                number((kept or {}).get("se"), 2),
                number((kept or {}).get("bootstrap_se"), 2),
                number((kept or {}).get("differentiation_sd"), 2),
                Cell(name, "code wrap"),
            )
        )
    heads = "".join(f"|{c:g} ×:num" for c in ceilings)
    columns = columns_of(
        f"Term:code|Kept:num{heads}|Standard error:num|by blocks:num|from positions:num|Taken for it (chance):code"
    )
    groups = (("", 1), ("share of block replicates, by ceiling", 1 + len(ceilings)), ("error", 3), ("", 1))
    caption = (
        "Selected terms stand out. By blocks: moving-block bootstrap, the check of the standard error. From positions: "
        "the part that noise of the recorded positions makes through differentiation. Taken for it: the candidate that "
        "noise most easily puts in the term's place."
    )
    return Table(columns, tuple(rows), caption, groups=groups, marked=frozenset(marked)) if rows else None


def structures_table(facts: Mapping[str, Any]) -> Table | None:
    """The few structures that the record supports, each with its own estimates."""
    rows = []
    for found in mappings(facts.get("structures")):
        terms, estimates, errors = (list(found.get(k) or []) for k in ("terms", "estimate", "se"))
        words = ", ".join(
            f"{at_precision(value, error)} {term}" for term, value, error in zip(terms, estimates, errors, strict=False)
        )
        rows.append(cells(percent(found.get("share")), Cell(words, "code wrap"), number(found.get("rms"), 3)))
    columns = columns_of("Share:num|Terms, each with its estimate:code|Residual:num")
    caption = "Sets of terms selected most often over block replicates of the record, fitted to the record itself."
    return Table(columns, tuple(rows), caption, style="narrow") if rows else None


def prediction_table(facts: Mapping[str, Any]) -> Table | None:
    """How the fit predicts canopies and flights that were not used."""
    rows = []
    for label, check in (facts.get("check") or {}).items():
        if isinstance(check, Mapping) and is_number(check.get("rms")):
            rows.append(
                cells(
                    str(label),
                    Cell(number(check.get("rms_ratio"), 3), "strong"),
                    number(check.get("least_ratio"), 3),
                    number(check.get("expected_ratio"), 3),
                    number(check.get("true_ratio"), 3),
                    percent(check.get("r2")),
                    number(check.get("theil"), 2),
                    number(check.get("bias"), 2),
                    percent(check.get("extrapolated")),
                    Cell(_spared(check.get("without")), "code wrap"),
                )
            )
    columns = columns_of(
        "Not used:text|Residual / fit's:num|at the least:num|expected:num|true:num|Explained:num|Theil:num|Bias:num"
        "|Extrapolated:num|Better without:code"
    )
    groups = (("", 1), ("over the fit's", 4), ("", 5))
    caption = (
        "At the least: the same terms fitted to that record itself; a noisier record has more than 1 here, whatever "
        "the model. Expected: from the fit's residual and the errors of its coefficients. True: what the coefficients "
        "leave that the flight was flown with. Better without: the term whose absence lowers the error most, and the "
        "ratio then."
    )
    return Table(columns, tuple(rows), caption, style="narrow", groups=groups) if rows else None


def _spared(without: Any) -> str:
    """The term that a prediction would be better without, and the ratio then."""
    return f"{without['term']}: {number(without['rms_ratio'], 3)}" if isinstance(without, Mapping) else ""


def known_table(facts: Mapping[str, Any]) -> Table | None:
    """True terms of synthetic data: how often selected, how intervals cover, and their nearest neighbours."""
    rows = []
    for term in mappings(facts.get("true")):
        se, unit = term.get("se"), str(term.get("unit") or "1")
        rival = f"{term.get('rival')}: {number(term.get('rival_correlation'), 3)}, {percent(term.get('rival_chance'))}"
        rows.append(
            cells(
                Cell(str(term.get("term")), "code", "" if unit == "1" else unit),
                at_precision(term.get("value"), se),
                at_precision(term.get("mean"), se),
                number(term.get("sd"), 2),
                number(se, 2),
                number(term.get("white_se"), 2),
                percent(term.get("coverage")),
                percent(term.get("white_coverage")),
                Cell(percent(term.get("share")), "strong"),
                percent(term.get("ranked")),
                Cell(rival if term.get("rival") else "", "code wrap"),
            )
        )
    columns = columns_of(
        "Term:code|True:num|Mean:num|Spread:num|Standard error:num|white:num|Colored:num|white:num|Selected:num"
        "|unexchanged:num|Neighbour: correlation, chance:code"
    )
    groups = (("", 3), ("error", 3), ("90 % intervals cover", 2), ("in replicates", 2), ("", 1))
    return Table(columns, tuple(rows), groups=groups) if rows else None


def false_table(facts: Mapping[str, Any]) -> Table | None:
    """Terms selected though they are not in the data."""
    rows = [
        cells(Cell(str(term.get("term")), "code"), percent(term.get("share")), percent(term.get("ranked")))
        for term in mappings(facts.get("false"))
    ]
    return (
        Table(columns_of("False term:code|Selected:num|unexchanged:num"), tuple(rows), style="narrow") if rows else None
    )


def target_table(synthetic: Mapping[str, Any]) -> Table | None:
    """What synthetic data were made to show."""
    rows = []
    for name, check in (synthetic.get("checks") or {}).items():
        if not isinstance(check, Mapping):
            continue
        bound = check.get("bound")
        limits = [number(b, 2) for b in bound] if isinstance(bound, list) else [number(bound, 2)]
        white = f" (as if white: {number(check.get('white'), 3)})" if is_number(check.get("white")) else ""
        verdict = Cell("reached", "good") if check.get("passed") is True else Cell("missed", "bad")
        rows.append(cells(str(name), f"{number(check.get('value'), 3)}{white}", " to ".join(limits), verdict))
    columns = columns_of("What:text|Value:num|Bound:num|Result:text")
    return Table(columns, tuple(rows), style="narrow") if rows else None


def synthetic_sentences(name: str, facts: Mapping[str, Any]) -> list[str]:
    """What the data of one coefficient were like."""
    low, high = (facts.get("penalty_per_term") or [None, None])[:2]
    rule = facts.get("report_rule")
    kept = rule.get("terms") if isinstance(rule, Mapping) else MISSING
    return [
        f"{name}: {facts.get('candidates')} candidates, {facts.get('samples')} samples, signal-to-noise ratio "
        f"{number(facts.get('snr'))} as made; Fourier smoothing, which knows white noise only, takes it for "
        f"{number(facts.get('seen_snr'), 3)}. Exactly the true terms in {percent(facts.get('exact'))} of "
        f"{facts.get('replicates')} replicates; intervals of the selected models cover "
        f"{percent(facts.get('selected_coverage'))}; greatest error {number(facts.get('largest_z'), 2)} "
        "standard errors.",
        f"First replicate: (pe² − mse)/n is {number(low, 7)} to {number(high, 7)} in every row; "
        f"the ceiling of 25 sigma^2 by smoothing would keep {kept} terms.",
    ]
