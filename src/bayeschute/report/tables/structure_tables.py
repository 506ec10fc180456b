"""Tables of selection stability, prediction of data that were not fitted, and the simulation study with known terms."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from bayeschute.report.run_results import entries, mappings
from bayeschute.report.tables.summary_tables import Cell, Table, cells, table_of
from bayeschute.report.wording import MISSING, at_precision, is_number, number, percent

_MOST_ROWS = 14


def stability_table(facts: Mapping[str, Any]) -> Table | None:
    """Selection frequency of each term over bootstrap replicates and ceilings, and the parts of its standard error."""
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
    columns = (
        f"Term:code|Selected:num{heads}|Colored:num|Bootstrap:num|Differentiation:num|Confusable (probability):code"
    )
    groups = (("", 1), ("Share of bootstrap replicates, by ceiling", 1 + len(ceilings)), ("Standard error", 3), ("", 1))
    caption = (
        "Selected terms are highlighted. Colored: standard error corrected for colored residuals. Bootstrap: by "
        "moving-block bootstrap, for comparison. Differentiation: the part due to noise of the recorded positions, "
        "through numerical differentiation. Confusable: the candidate that noise is most likely to put in the "
        "term's place, and the probability."
    )
    return table_of(columns, rows, caption, groups=groups, marked=frozenset(marked))


def structures_table(facts: Mapping[str, Any]) -> Table | None:
    """The model structures that were selected most often, each with its own estimates."""
    rows = []
    for found in mappings(facts.get("structures")):
        terms, estimates, errors = (list(found.get(k) or []) for k in ("terms", "estimate", "se"))
        words = ", ".join(
            f"{at_precision(value, error)} {term}" for term, value, error in zip(terms, estimates, errors, strict=False)
        )
        rows.append(cells(percent(found.get("share")), Cell(words, "code wrap"), number(found.get("rms"), 3)))
    caption = "Sets of terms selected most often over moving-block bootstrap replicates, each fitted to the record."
    return table_of("Share:num|Terms, each with its estimate:code|Residual:num", rows, caption, style="narrow")


def prediction_table(facts: Mapping[str, Any]) -> Table | None:
    """Prediction of canopies and flights that were not fitted."""
    rows = []
    for label, check in entries(facts.get("check")).items():
        if is_number(check.get("rms")):
            rows.append(
                cells(
                    label,
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
    columns = (
        "Data not fitted:text|Predicted:num|Refitted:num|Expected:num|True:num|R2:num|Theil:num|Bias:num"
        "|Extrapolated:num|Better without:code"
    )
    groups = (("", 1), ("Residual, relative to that of the fit", 4), ("", 5))
    caption = (
        "Predicted: residual of the prediction. Refitted: the same terms fitted to that record itself; a noisier "
        "record has more than 1 here, whatever the model. Expected: from the residual of the fit and the standard "
        "errors of its coefficients. True: residual with the true coefficients of a virtual flight. Theil: inequality "
        "coefficient. Extrapolated: share of samples outside the range of the fitted data. Better without: the term "
        "whose omission lowers the error most, and the ratio then."
    )
    return table_of(columns, rows, caption, style="narrow", groups=groups)


def _spared(without: Any) -> str:
    """The term that a prediction would be better without, and the ratio then."""
    return f"{without['term']}: {number(without['rms_ratio'], 3)}" if isinstance(without, Mapping) else ""


def known_table(facts: Mapping[str, Any]) -> Table | None:
    """True terms of synthetic data: selection frequency, coverage of intervals, and most confusable candidates."""
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
    columns = (
        "Term:code|True:num|Mean:num|Sample sd:num|Colored:num|White:num|Colored:num|White:num|Final:num"
        "|Before exchange:num|Most confusable: correlation, probability:code"
    )
    groups = (("", 3), ("Standard error", 3), ("90 % interval coverage", 2), ("Selected in replicates", 2), ("", 1))
    return table_of(columns, rows, groups=groups)


def false_table(facts: Mapping[str, Any]) -> Table | None:
    """Terms selected though they are not in the data."""
    rows = [
        cells(Cell(str(term.get("term")), "code"), percent(term.get("share")), percent(term.get("ranked")))
        for term in mappings(facts.get("false"))
    ]
    return table_of("False term:code|Selected:num|Before exchange:num", rows, style="narrow")


def target_table(synthetic: Mapping[str, Any]) -> Table | None:
    """Acceptance criteria of the simulation study, and whether they were met."""
    rows = []
    for name, check in entries(synthetic.get("checks")).items():
        bound = check.get("bound")
        limits = [number(b, 2) for b in bound] if isinstance(bound, list) else [number(bound, 2)]
        white = f" (as if white: {number(check.get('white'), 3)})" if is_number(check.get("white")) else ""
        verdict = Cell("passed", "good") if check.get("passed") is True else Cell("failed", "bad")
        rows.append(cells(name, f"{number(check.get('value'), 3)}{white}", " to ".join(limits), verdict))
    return table_of("Criterion:text|Value:num|Bound:num|Result:text", rows, style="narrow")


def synthetic_sentences(name: str, facts: Mapping[str, Any]) -> list[str]:
    """Properties of the synthetic data of one coefficient."""
    low, high = (facts.get("penalty_per_term") or [None, None])[:2]
    rule = facts.get("report_rule")
    kept = rule.get("terms") if isinstance(rule, Mapping) else MISSING
    return [
        f"{name}: {facts.get('candidates')} candidates, {facts.get('samples')} samples, signal-to-noise ratio "
        f"{number(facts.get('snr'))} by construction; Fourier smoothing, which assumes white noise, estimates it as "
        f"{number(facts.get('seen_snr'), 3)}. Exactly the true terms are selected in {percent(facts.get('exact'))} of "
        f"{facts.get('replicates')} replicates; 90 % intervals of the selected models cover "
        f"{percent(facts.get('selected_coverage'))}; the largest error is {number(facts.get('largest_z'), 2)} "
        "standard errors.",
        f"First replicate: (pe² − mse)/n is {number(low, 7)} to {number(high, 7)} in every row; "
        f"a ceiling of 25 sigma^2 with sigma by Fourier smoothing would select {kept} terms.",
    ]
