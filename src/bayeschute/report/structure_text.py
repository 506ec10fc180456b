"""Result of the structure selection as plain text, like the print-outs of NASA/TM-2019-220410, section 7.3."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

Entry = Mapping[str, Any]
AS_GOOD = 1.05  # times the residual of a refit: a prediction up to this is as good as its terms allow
MOST_RANKED = 20  # rows of a ranking that are shown


def structure_text(structure: Entry) -> str:
    """All tables of a ``structure.json`` as text.

    Args:
        structure: Its content.

    Returns:
        Text to be printed or stored as ``structure.txt``.
    """
    blocks = []
    if structure.get("sufficiency"):
        blocks.append("\n".join(["Data adequacy", *map(str, structure["sufficiency"])]))
    for part in ("coefficients", "polar"):
        for name, entry in (structure.get(part) or {}).items():
            blocks.append(_coefficient(name, entry))
    synthetic = structure.get("synthetic")
    if synthetic:
        blocks.append(_synthetic(synthetic))
    return "\n\n".join(blocks) + "\n"


def print_out(rows: Sequence[Entry], minimum: int) -> list[str]:
    """A ranking in the columns of the print-out of the NASA report, with the term next to its index.

    Args:
        rows: Rows of the ranking.
        minimum: Number of functions with the least predicted squared error, of no fewer than the terms that were
            required.
    """
    shown = rows[:MOST_RANKED]
    width = max([7, *(len(str(row["index"])) for row in shown)])
    lines = [
        f"{'o.f.':>4} {'# index':>{width}} {'sqrt(mse)':>10} {'dmse':>11} {'perr':>7} {'R2':>7} {'pe':>10} {'n':>3} "
        f"{'F':>9}  term"
    ]
    lower = any(row["pe"] < kept["pe"] for row in rows for kept in rows if kept["n"] == minimum)
    least = "minimum PSE" + (" with the required terms" if lower else "")
    for row in shown:
        mark = f"  <- {least}" if row["n"] == minimum else ""
        lines.append(
            f"{row['n']:>4} {row['index']:>{width}} {_root(row['mse']):>10.3e} {row['dmse']:>11.3e} "
            f"{row['perr']:>7.2f} {_number(row['r2'], '.2f'):>7} {row['pe']:>10.3e} {row['n']:>3} "
            f"{_number(row['f_ratio'], '.2f'):>9}  {row['term']}{mark}"
        )
    return lines


def grid(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Columns of equal width, the first to the left, the others to the right."""
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    return [
        "  ".join(
            cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in [head, *rows]
    ]


def _root(value: float) -> float:
    return float(max(value, 0.0)) ** 0.5


def _number(value: Any, form: str = ".4g") -> str:
    return "-" if value is None else format(value, form)


def _percent(value: Any) -> str:
    return "-" if value is None else f"{100 * value:.0f} %"


def _coefficient(name: str, entry: Entry) -> str:
    """Terms, prediction errors and ranking of one coefficient."""
    rows = [
        [
            term["term"],
            _number(term["estimate"]),
            _number(term["se"], ".2g"),
            _number(term["white_se"], ".2g"),
            _number(term.get("bootstrap_se"), ".2g"),
            _number(term.get("differentiation_sd"), ".2g"),
            _percent(term.get("frequency")),
            term["unit"],
        ]
        for term in entry["selected"]
    ]
    noise = entry["noise"]
    lines = [
        f"{name}: {len(rows)} of {len(entry['candidates'])} candidates selected, R2 {_percent(entry['r2'])}, "
        f"signal-to-noise ratio {_number(entry['snr'], '.2g')}",
        *grid(["term", "estimate", "s.e.", "white s.e.", "bootstrap", "differentiation", "selected", "unit"], rows),
        f"noise ceiling {noise['factor']:g} x sigma^2 ({noise['source']}), sigma {_number(noise['sd'], '.3g')}, "
        f"autocorrelation time {_number(noise['memory'], '.3g')} samples; null model {entry['null_model']['name']}: R2 "
        f"{_percent(entry['null_model']['r2'])}",
    ]
    if "saturation" in entry:
        angle = math.degrees(entry["saturation"])
        lines.append(f"powers of the angle of attack level off at {angle:.3g} deg (saturate)")
    if entry["check"]:
        lines.append(
            "tested on canopies and flights that had no part in the choice of terms and teach no parameter here:"
        )
    for label, check in entry["check"].items():
        lines.append(f"prediction of {label}: {_predicted(check)}")
    return "\n".join([*lines, *print_out(entry["ranking"], entry["pse_minimum_at"])])


def _predicted(check: Entry) -> str:
    """Error of the prediction of data that were not fitted, with reference values."""
    ratio, least = check["rms_ratio"], check.get("least_ratio")
    words = [f"residual {_number(ratio, '.2f')} times that of the fit"]
    if least is not None:
        words.append(f"{least:.2f} with these terms refitted")
        words.append(f"{_number(check.get('expected_ratio'), '.2f')} expected from their standard errors")
    if check.get("true_ratio") is not None:
        words.append(f"{check['true_ratio']:.2f} with the true coefficients")
    words.append(f"mean error {_number(check.get('bias'), '+.2g')}")
    if check.get("without"):
        words.append(f"{check['without']['rms_ratio']:.2f} without {check['without']['term']}")
    if least is not None and ratio is not None and ratio <= AS_GOOD * least:
        words.append("as good as these terms allow")
    return "; ".join(words)


def _synthetic(synthetic: Entry) -> str:
    """Simulation study with known terms: selection frequency, coverage, and why terms were missed."""
    way = "orthogonal functions" + (", then exchange of terms" if synthetic["exchange"] else "")
    lines = [
        f"Simulation study with known terms ({synthetic['source']}; signs {synthetic['reading']})",
        f"on the variables of {synthetic['flight']}, canopy {synthetic['canopy']}; noise with a time constant of "
        f"{synthetic['time_constant']:g} s; {synthetic['replicates']} replicates; ceiling {synthetic['sigma_max']:g} "
        f"sigma^2; {way}",
    ]
    for name, entry in synthetic["coefficients"].items():
        lines += ["", *_known(name, entry)]
    lines += ["", "Acceptance criteria"]
    for name, check in synthetic["checks"].items():
        verdict = "passed" if check["passed"] else "FAILED"
        bound = check["bound"]
        text = f"{bound[0]:g} to {bound[1]:g}" if isinstance(bound, list) else f"{bound:g}"
        if_white = f" (as if white: {_number(check['white'], '.3g')})" if "white" in check else ""
        lines.append(f"{name}: {_number(check['value'], '.3g')}{if_white}, bound {text}: {verdict}")
    return "\n".join(lines)


def _known(name: str, entry: Entry) -> list[str]:
    """Results for one coefficient with known terms."""
    rows = [
        [
            t["term"], _number(t["value"]), _number(t["mean"]), _number(t["sd"], ".2g"), _number(t["se"], ".2g"),
            _number(t["white_se"], ".2g"), _percent(t["coverage"]), _percent(t["white_coverage"]),
            _percent(t["share"]), _percent(t["ranked"]), t["unit"],
        ]
        for t in entry["true"]
    ]  # fmt: skip
    head = ["true term", "value", "mean", "sd", "s.e.", "white s.e.", "coverage", "white"]
    head += ["selected", "before exchange"]
    false = [[f["term"], _percent(f["share"]), _percent(f["ranked"])] for f in entry["false"]]
    low, high = entry["penalty_per_term"]
    lines = [
        f"{name}: {entry['candidates']} candidates, {entry['samples']} samples, signal-to-noise ratio {entry['snr']:g} "
        f"(Fourier smoothing estimates {_number(entry['seen_snr'], '.3g')}); exactly the true terms in "
        f"{_percent(entry['exact'])} of the replicates",
        *grid([*head, "unit"], rows),
        *(grid(["false term", "selected", "before exchange"], false) if false else ["no false term above 2 %"]),
        *_reasons(entry),
        f"Ranking in the first replicate, (pe^2 - mse)/n from {low:.6e} to {high:.6e}; "
        f"a ceiling of 25 sigma^2 by Fourier smoothing would select {entry['report_rule']['terms']} terms:",
        *print_out(entry["ranking"], entry["pse_minimum_at"]),
    ]
    return lines


def _reasons(entry: Entry) -> list[str]:
    """The candidate that is selected in place of a term that is sometimes missed."""
    return [
        f"{t['term']}, selected in {_percent(t['share'])}: its partial correlation with {t['rival']} (selected in "
        f"{_percent(t['rival_share'])}) given the other terms is {t['rival_correlation']:.3f}; "
        f"noise makes the wrong one fit better with probability {_percent(t['rival_chance'])}"
        for t in entry["true"]
        if t["share"] < 1.0 and t["rival"]
    ]
