"""Recalibration of predicted bands: the widening factor that gives nominal coverage, by conformal risk control.

Bands about the median, all widened by one factor, are nested. The factor is the smallest for which the expected share
of samples outside the band of a new replicate is at most 10 %: with n replicates and their mean share outside R,
``(n R + 1)/(n + 1)`` is at most 10 % (conformal risk control, Angelopoulos et al. 2024). The guarantee holds for
flights exchangeable with the replicates, whatever the errors of the model, and for no others.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.calibration.promises import NOMINAL

Array = NDArray[np.float64]
FACTORS = tuple(round(0.6 + 0.02 * i, 2) for i in range(71))
"""Factors whose shares are kept: 0.6 to 2."""


def scaled_shares(draws: Array, truth: Array) -> list[float]:
    """Share of samples inside the 90 % band widened about the median, by `FACTORS`.

    Args:
        draws: (S, T); draws that failed are not finite and left out; no band holds anything where all did.
        truth: (T,); samples that are NaN are left out.
    """
    known = np.isfinite(truth)
    draws, truth = draws[np.isfinite(draws).all(axis=1)][:, known], truth[known]
    if not draws.size:
        return [0.0] * len(FACTORS)
    low, middle, high = np.quantile(draws, [0.5 - NOMINAL / 2.0, 0.5, 0.5 + NOMINAL / 2.0], axis=0)
    off = truth - middle
    half = np.where(off < 0.0, middle - low, high - middle)
    return [float(np.mean(np.abs(off) <= factor * half)) for factor in FACTORS]


def learned(summary: Mapping[str, Any]) -> dict[str, float | None]:
    """Factors by quantity, over the flights that replicates did not see.

    Args:
        summary: As written by ``bayeschute calibrate``.

    Returns:
        None for a quantity that no factor of `FACTORS` would do for; empty where shares were not kept.
    """
    count, shares = int(summary["replicates"]), dict[str, list[list[float]]]()
    for name, entry in summary["bands"].items():
        if entry["role"] == "predict" and "scaled" in entry:
            shares.setdefault(name.split("/", 1)[1], []).append(entry["scaled"])
    made: dict[str, float | None] = {}
    for quantity, several in shares.items():
        missed = 1.0 - np.mean(several, axis=0)
        expected = (count * missed + 1.0) / (count + 1.0)
        made[quantity] = next((f for f, m in zip(FACTORS, expected, strict=True) if m <= 1.0 - NOMINAL + 1e-12), None)
    return made
