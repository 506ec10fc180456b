"""Result of the simulation study with known terms, as plain values: the entry ``synthetic`` of ``structure.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.regression.collinearity import collinearity
from bayeschute.regression.noise_ceiling import REPORT_SAFETY
from bayeschute.structure.polar_names import coefficient_unit
from bayeschute.structure.structure_entry import plain, ranking
from bayeschute.structure.synthetic import Making, Replicates

Array = NDArray[np.float64]
LEAST_TRUE, MOST_FALSE = 0.8, 0.2  # shares of the replicates that select a true and a false term
FAR = 2.5  # colored standard errors
COVERED = (0.85, 0.95)  # of nominal 90 % intervals
_ROWS = 20  # of the print-out
_LISTED = 0.02  # share from which a false term is listed


def synthetic_entry(found: Replicates, making: Making, X: Array) -> dict[str, Any]:
    """The entry of one coefficient.

    Args:
        found: Results over the replicates.
        making: How the data were made.
        X: All candidates along the record, (T, p).

    Returns:
        Plain values.
    """
    shares, ranked = found.kept.mean(axis=0), found.ranked.mean(axis=0)
    true = list(found.true)
    false = [j for j in np.argsort(-shares, kind="stable") if j not in true and shares[j] >= _LISTED]
    others = np.delete(np.arange(len(found.names)), true)
    near = collinearity(X[:, true], [found.names[j] for j in true])
    first = found.first.selection
    selected = int(found.kept[:, true].sum())
    report = {
        "snr": making.snr,
        "sigma": found.sigma,
        "memory": found.memory,
        "candidates": len(found.names),
        "samples": first.samples,
        "replicates": making.replicates,
        "seen_snr": found.seen.with_mean,
        "seen_snr_about_mean": found.seen.about_mean,
        "ceiling_over_truth": np.quantile(found.ceiling, [0.05, 0.5, 0.95]) / (found.sigma**2 * found.memory),
        "true": [_true(found, k, float(shares[j]), float(ranked[j])) for k, j in enumerate(true)],
        "false": [{"term": found.names[j], "share": shares[j], "ranked": ranked[j]} for j in false],
        "least_true": float(shares[true].min()),
        "most_false": float(shares[others].max(initial=0.0)),
        "least_true_ranked": float(ranked[true].min()),
        "most_false_ranked": float(ranked[others].max(initial=0.0)),
        "exact": found.exact,
        "coverage": float(found.inside.mean()),
        "white_coverage": float(found.white_inside.mean()),
        "selected_coverage": float(found.kept_inside.sum() / selected) if selected else np.nan,
        "largest_z": float(np.abs(found.z).max()),
        "beyond": float((np.abs(found.z) > FAR).mean()),
        "collinearity": {
            "max_correlation": near.max_correlation,
            "pair": list(near.pair),
            "max_vif": near.max_vif,
            "condition_index": near.condition_index,
        },
        "ranking": ranking(first, _ROWS),
        "pse_minimum_at": first.minimum,
        "penalty_factor": first.penalty_factor,
        "ceiling": first.ceiling._asdict(),
        "penalty_per_term": penalty_per_term(ranking(first, _ROWS)),
        "report_rule": {
            "sigma_max2": REPORT_SAFETY * found.seen.sd**2,
            "terms": first.at(REPORT_SAFETY * found.seen.sd**2).n,
        },
    }
    return dict(plain(report))


def _true(found: Replicates, k: int, share: float, ranked: float) -> dict[str, Any]:
    """One true term."""
    name, rival = found.names[found.true[k]], found.rivals[k]
    return {
        "term": name,
        "value": found.value[k],
        "unit": coefficient_unit(name),
        "share": share,
        "ranked": ranked,
        "mean": found.estimate[:, k].mean(),
        "sd": found.estimate[:, k].std(ddof=1),
        "se": np.sqrt(np.mean(found.se[:, k] ** 2)),
        "white_se": np.sqrt(np.mean(found.white_se[:, k] ** 2)),
        "bootstrap_ratio": found.bootstrap_se[k] / found.first_fit.se[k],
        "coverage": found.inside[:, k].mean(),
        "white_coverage": found.white_inside[:, k].mean(),
        "largest_z": np.abs(found.z[:, k]).max(),
        "rival": rival.rival,
        "rival_correlation": rival.correlation,
        "rival_chance": rival.chance,
        "rival_share": found.kept[:, found.names.index(rival.rival)].mean() if rival.rival else 0.0,
    }


def penalty_per_term(rows: Sequence[Mapping[str, Any]]) -> list[float]:
    """Least and greatest (pe^2 - mse)/n over the rows of a ranking; equal where the penalty is one per term."""
    found = [(row["pe"] ** 2 - row["mse"]) / row["n"] for row in rows]
    return [min(found), max(found)]


def checks(entries: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Acceptance criteria of the simulation study, each with value, bound and verdict.

    Args:
        entries: Entries by coefficient.

    Returns:
        Checks by name; coverage is over all coefficients' true terms together.
    """
    least = min(e["least_true"] for e in entries.values())
    most = max(e["most_false"] for e in entries.values())
    counts = [e["replicates"] * len(e["true"]) for e in entries.values()]
    covered = float(np.average([e["coverage"] for e in entries.values()], weights=counts))
    white = float(np.average([e["white_coverage"] for e in entries.values()], weights=counts))
    beyond = float(np.average([e["beyond"] for e in entries.values()], weights=counts))
    constant = max(abs(high / low - 1.0) for low, high in (e["penalty_per_term"] for e in entries.values()))
    return {
        "true terms selected": {"passed": least >= LEAST_TRUE, "value": least, "bound": LEAST_TRUE},
        "false terms selected": {"passed": most <= MOST_FALSE, "value": most, "bound": MOST_FALSE},
        "coverage of 90 % intervals": {
            "passed": COVERED[0] <= covered <= COVERED[1], "value": covered, "bound": list(COVERED), "white": white,
        },
        f"estimates beyond {FAR:g} standard errors": {"passed": beyond <= 0.025, "value": beyond, "bound": 0.025},
        "penalty per term constant": {"passed": constant <= 1e-9, "value": constant, "bound": 1e-9},
    }  # fmt: skip
