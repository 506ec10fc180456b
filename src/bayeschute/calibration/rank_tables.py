"""Results of rank tests (simulation-based calibration) as one object for JSON, and as lines for the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bayeschute.calibration.simulation_based import Row, tested

PROBABILITY = 0.95
"""Probability that all curves of a right inference stay inside their bands."""


def summarise_ranks(rows: Sequence[Row], levels: int, shift: float) -> dict[str, Any]:
    """Everything about a campaign of rank tests.

    Args:
        rows: Rows of `simulation_based.ranked`, and those of replicates that failed (``ok`` false, with ``error``).
        levels: As given to `ranked`.
        shift: As given to `ranked`: of the draws that were spoiled on purpose.

    Returns:
        ``replicates`` that are ok, ``failed`` with the reasons, ``redrawn``, ``levels``, ``probability``, whether all
        quantities ``passed``, the test of each of the ``quantities``, and the same of the ``spoiled`` draws, which must
        not pass.
    """
    good = [row for row in rows if row["ok"]]
    quantities, spoiled = (_tests(good, levels, which) for which in ("ranks", "spoiled"))
    return {
        "replicates": len(good),
        "failed": {str(row["seed"]): row["error"] for row in rows if not row["ok"]},
        "redrawn": sum(row["redrawn"] for row in good),
        "levels": levels,
        "probability": PROBABILITY,
        "passed": bool(quantities) and all(one["passed"] for one in quantities.values()),
        "quantities": quantities,
        "spoiled": {
            "shift": shift,
            "passed": bool(spoiled) and all(one["passed"] for one in spoiled.values()),
            "quantities": spoiled,
        },
    }


def _tests(good: Sequence[Row], levels: int, which: str) -> dict[str, dict[str, Any]]:
    if not good:
        return {}
    return {
        name: {
            "value": test.value,
            "bound": test.bound,
            "passed": bool(test.passed),
            "mean_rank": float(np.mean([row[which][name] for row in good])) / levels,
        }
        for name, test in tested(good, levels, PROBABILITY, which).items()
    }


def rank_lines(result: dict[str, Any]) -> list[str]:
    """The table for the terminal: quantity, whether its ranks are uniform, test value, bound, mean rank."""
    made = [f"{result['replicates']} replicates, {len(result['failed'])} failed, {result['redrawn']} draws did not fly"]
    for words, part in (
        ("", result),
        (f"the same draws, moved by {result['spoiled']['shift']} sd:", result["spoiled"]),
    ):
        made += [words] if words else []
        for name, one in part["quantities"].items():
            says = "inside" if one["passed"] else "OUTSIDE"
            numbers = f"least prob. {one['value']:.4f}, bound {one['bound']:.4f}, mean rank {one['mean_rank']:.3f}"
            made.append(f"  {name:28} {says:8} {numbers}")
    broken = "pass too: the test has no power yet" if result["spoiled"]["passed"] else "fail, as they must"
    return [*made, f"{'All' if result['passed'] else 'NOT all'} ranks are uniform; the spoiled draws {broken}"]
