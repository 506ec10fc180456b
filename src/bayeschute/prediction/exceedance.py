"""Draws of quantities as a table, P(quantity > threshold), and Wilks' tolerance limits.

A draw whose simulation failed is never dropped: it counts as exceeding every limit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from bayeschute.core.errors import Fault, InputError
from bayeschute.prediction.binomial_limits import clopper_pearson, jeffreys, wilks_failures, wilks_sample_size

TOLERANCES = ((0.99865, 0.9), (0.9973, 0.9), (0.95, 0.95))  # share and confidence in common use
Widened = Mapping[str, Mapping[str, float]]  # run to quantity to the factor by which its draws were widened [1]


def samples_table(runs: Mapping[str, Mapping[str, ArrayLike]]) -> pd.DataFrame:
    """Draws of quantities, of one statistic each, as one frame.

    Args:
        runs: Run (flight) name to arrays (draw,) by quantity. NaN: the simulation failed.

    Returns:
        Columns run, draw and the quantities; NaN for quantities that a run does not have.

    Raises:
        InputError: If there is no run, or the arrays of a run differ in length.
    """
    frames = []
    for run, quantities in runs.items():
        arrays = {name: np.asarray(values) for name, values in quantities.items()}
        shapes = {values.shape for values in arrays.values()}
        if len(shapes) != 1 or len(next(iter(shapes))) != 1:
            raise InputError(Fault(f"samples_table {run}", f"shapes {sorted(shapes)}", "one shape (draw,) for all"))
        size = next(iter(shapes))[0]
        frames.append(pd.DataFrame({"run": run, "draw": np.arange(size)} | arrays))
    if not frames:
        raise InputError(Fault("samples_table runs", "none", "at least one run"))
    table = pd.concat(frames, ignore_index=True)
    table["run"] = table["run"].astype(str)
    return table


def _samples(samples: pd.DataFrame) -> Iterable[tuple[str, str, np.ndarray]]:
    """Run, quantity and its values; failed simulations are +inf, missing quantities are omitted."""
    for run, part in samples.groupby("run", sort=False):
        for name in part.select_dtypes("number").columns.drop("draw"):
            x = part[name].to_numpy(dtype=float)
            if np.isfinite(x).any():
                yield str(run), str(name), np.where(np.isfinite(x), x, np.inf)


def exceedance_table(
    samples: pd.DataFrame,
    statistic: str,
    thresholds: Mapping[str, Sequence[float]] | None = None,
    confidence: float = 0.9,
    independent: float | None = None,
    units: Mapping[str, str] | None = None,
    widened: Widened | None = None,
) -> pd.DataFrame:
    """P(quantity > threshold) with both kinds of limits.

    Args:
        samples: Frame of `samples_table`.
        statistic: Statistic that the draws are of, such as "final" or "mean"; goes into the table.
        thresholds: Quantity to thresholds of special interest [unit]; 41 over the range of the draws are added.
        confidence: Two-sided confidence of the limits [1].
        independent: Number of independent draws per run, if fewer than the draws; the counts are scaled down to it.
        units: Quantity to unit; "1" where not named.
        widened: Factors by which draws were widened before; 1 where not named.

    Returns:
        Columns run, quantity, statistic, unit, threshold, exceeded, draws, failed, probability, credible_low,
        credible_high (Jeffreys), clopper_pearson_low, clopper_pearson_high, confidence, independent_draws, widened_by.
        Failed solves exceed.
    """
    rows = []
    for run, name, x in _samples(samples):
        finite = x[np.isfinite(x)]
        grid = set(np.linspace(finite.min(), finite.max(), 41)) | {float(t) for t in (thresholds or {}).get(name, ())}
        total = min(float(independent or x.size), float(x.size))
        for threshold in sorted(grid):
            exceeded = int((x > threshold).sum())
            count = exceeded * total / x.size
            rows.append(
                {
                    "run": run,
                    "quantity": name,
                    "statistic": statistic,
                    "unit": (units or {}).get(name, "1"),
                    "threshold": threshold,
                    "exceeded": exceeded,
                    "draws": x.size,
                    "failed": x.size - finite.size,
                    "probability": exceeded / x.size,
                    **dict(zip(("credible_low", "credible_high"), jeffreys(count, total, confidence), strict=True)),
                    "clopper_pearson_low": clopper_pearson(count, total, confidence).low,
                    "clopper_pearson_high": clopper_pearson(count, total, confidence).high,
                    "confidence": confidence,
                    "independent_draws": total,
                    "widened_by": (widened or {}).get(run, {}).get(name, 1.0),
                }
            )
    return pd.DataFrame(rows)


def tolerance_table(
    samples: pd.DataFrame,
    statistic: str,
    tolerances: Sequence[tuple[float, float]] = TOLERANCES,
    independent: float | None = None,
    units: Mapping[str, str] | None = None,
    widened: Widened | None = None,
) -> pd.DataFrame:
    """Upper tolerance limits by Wilks' order statistics.

    Args:
        samples: Frame of `samples_table`.
        statistic: Statistic that the draws are of, such as "final" or "mean"; goes into the table.
        tolerances: Pairs of share and one-sided confidence [1].
        independent: Number of independent draws per run, if fewer than the draws; they are thinned down to it.
        units: Quantity to unit; "1" where not named.
        widened: Factors by which draws were widened before; 1 where not named.

    Returns:
        Columns run, quantity, statistic, unit, share, confidence, failures, needed (draws), draws, independent_draws,
        enough, limit, widened_by. `limit` is the (failures+1)-th greatest draw; NaN where the draws are too few, inf
        where a simulation failed there. Failures are 0, 1, 2 and, where it is more, the most that the draws allow.
    """
    rows = []
    for run, name, x in _samples(samples):
        step = int(np.ceil(x.size / min(float(independent or x.size), x.size)))
        ordered = np.sort(x[::step])[::-1]
        for share, confidence in tolerances:
            most = wilks_failures(ordered.size, share, confidence)
            for failures in sorted({0, 1, 2, max(most, 0)}):
                needed = wilks_sample_size(share, confidence, failures)
                enough = ordered.size >= needed
                rows.append(
                    {
                        "run": run,
                        "quantity": name,
                        "statistic": statistic,
                        "unit": (units or {}).get(name, "1"),
                        "share": share,
                        "confidence": confidence,
                        "failures": failures,
                        "needed": needed,
                        "draws": x.size,
                        "independent_draws": ordered.size,
                        "enough": enough,
                        "limit": float(ordered[failures]) if enough else np.nan,
                        "widened_by": (widened or {}).get(run, {}).get(name, 1.0),
                    }
                )
    return pd.DataFrame(rows)
