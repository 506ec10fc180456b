"""How much of a flight lies inside its band, and how often a flight of the forecast itself has no more there.

A swing that is once out of phase stays so for long: the share of one flight scatters widely about 90 % however honest
the band is. The forecast's own draws tell how widely, for this flight and this quantity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bayeschute.prediction.bands import QUANTILES, quantiles

Array = NDArray[np.float64]
Ends = tuple[float, float]
"""Probabilities of the lower and the upper end of a band."""
NOMINAL: Ends = (QUANTILES[0], QUANTILES[-1])


def shares_inside(draws: Array, motions: Array, counted: NDArray[np.bool_], ends: Ends = NOMINAL) -> Array:
    """Share of counted samples that each motion has inside a band of draws.

    Args:
        draws: (B, T); of those that failed the band knows nothing.
        motions: (N, T) or (T,).
        counted: Samples that count (T,).
        ends: Of the band; the 90 % band where not told.

    Returns:
        (N,); NaN where no sample is known and has a band, which draws that all failed have nowhere.
    """
    low, high = quantiles(draws, ends)
    several = np.atleast_2d(motions)
    known = counted & np.isfinite(low) & np.isfinite(several)
    with np.errstate(invalid="ignore"):
        inside = known & (several >= low) & (several <= high)
        return np.asarray(inside.sum(axis=1) / known.sum(axis=1))


def coverage(draws: Array, reference: Array, counted: NDArray[np.bool_]) -> float | None:
    """Share of counted samples with the reference (T,) inside the 90 % band of draws (B, T).

    Returns:
        The share [1]; None where no sample has both a reference and a band, which draws that all failed have nowhere.
    """
    (share,) = shares_inside(draws, reference, counted)
    return float(share) if np.isfinite(share) else None


def p_value(draws: Array, reference: Array, counted: NDArray[np.bool_], ends: Ends = NOMINAL) -> float | None:
    """How often one of the draws (B, T) and the reference (T,) is in the band for no more of the time than that is.

    Of a forecast that is right it is uniform between zero and one, or larger (Gelman, Meng and Stern 1996).

    Returns:
        It; None where there is neither a draw that did not fail nor a sample with a reference.
    """
    flown, known = draws[np.isfinite(draws).all(axis=1)], counted & np.isfinite(reference)
    (share,) = shares_inside(draws, reference, known, ends)
    if not len(flown) or not np.isfinite(share):
        return None
    return float((1 + np.sum(shares_inside(draws, flown, known, ends) <= share)) / (1 + len(flown)))
