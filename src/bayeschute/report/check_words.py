"""Bounds of the checks of a run in words."""

from __future__ import annotations

from bayeschute.report.wording import number

_SENSES = {
    "rhat": "at most", "ess_bulk": "at least", "ess_tail": "at least", "optimum": "at most", "failed_solves": "at most",
    "step_error": "at most", "mode": "above", "draws_distance": "at most", "innovations": "near",
    "log_determinant": "at most", "score_dispersion": "at most", "predictive": "at least", "calibration": "at least",
    "pareto_k": "below", "optima": "at most", "structures": "at most", "bands": "at most",
    "divergences": "at most",
}  # fmt: skip


def wanted(name: str, bound: float | None) -> str:
    """What a check wants.

    Args:
        name: Of the check.
        bound: Its bound; None where it has none.

    Returns:
        Such as ``at most 1.01``; the bound alone for a check whose sense is not known here, nothing without a bound.
    """
    return "" if bound is None else f"{_SENSES.get(name, '')} {number(bound)}".strip()
