"""Data adequacy before any fit: range and correlation of the explanatory variables, signal-to-noise ratio, in words.

After sections 6.3.5 and 7.3 of NASA/TM-2019-220410.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import scipy.signal
import xarray as xr
from numpy.typing import NDArray

from bayeschute.regression.collinearity import HIGH_CORRELATION

Array = NDArray[np.float64]
LOW_SNR = 3.0  # signal over noise (report, 6.3.5)
_LEVELS = (0.02, 0.98)  # quantiles that are given as a range
_WORDS = {
    "speed": "airspeed",
    "alpha": "angle of attack",
    "alpha_rate": "rate of the angle of attack",
    "azimuth_rate": "rate of the azimuth",
    "q": "dynamic pressure",
    "distance": "distance of the canopies",
    "closing": "closing speed of the canopies",
}


def record_sentences(name: str, motion: xr.Dataset) -> list[str]:
    """Range of the motion along a record.

    Args:
        name: Of the flight.
        motion: Motion by `bayeschute.records.reconstruct`.

    Returns:
        Sentences: range of the angle of attack, length and period, airspeed, distance of the canopies.
    """
    low, high = np.rad2deg(np.nanquantile(motion["alpha_T"].values, _LEVELS))
    duration = float(motion["time"][-1] - motion["time"][0])
    period = swing_period(motion["time"].values, motion["riser_direction"].values)
    spread = float(np.nanstd(motion["airspeed"].values) / np.nanmean(motion["airspeed"].values))
    said = [
        f"{name}: total angle of attack between {low:.0f} and {high:.0f} deg; "
        "there is no information on the aerodynamics outside this range.",
        f"{name}: {duration:.0f} s, about {duration / period:.0f} periods of the swing of {period:.3g} s each.",
    ]
    if low > 5.0:
        said.append(
            f"{name}: the angle of attack is rarely below {low:.0f} deg; "
            "slopes at zero angle of attack are extrapolated by the assumed form of the terms."
        )
    if spread < 0.1:
        said.append(
            f"{name}: airspeed varies by {100 * spread:.0f} % only, "
            "so terms in airspeed or dynamic pressure are weakly identifiable."
        )
    distance = motion["D_prox"].values
    if np.isfinite(distance).any():
        near, far = np.nanquantile(distance, _LEVELS)
        said.append(
            f"{name}: canopies between {near:.2f} and {far:.2f} reference lengths apart; "
            "a spline term with its knot outside this range is linear here."
        )
    return said


def swing_period(time: Array, direction: Array) -> float:
    """Period at which the mean riser swings most: peak of the spectrum of its horizontal components.

    Args:
        time: Evenly spaced (T,) [s].
        direction: Unit vectors of the risers (T, N, 3); NaN where unknown.

    Returns:
        The period [s]; at most the length of the record.
    """
    seen = np.isfinite(direction).all(axis=(1, 2))
    mean = direction[seen, :, :2].mean(axis=1)
    sideways = np.stack([np.interp(time, time[seen], column) for column in mean.T], axis=1)
    frequency, power = scipy.signal.periodogram(sideways, 1.0 / (time[1] - time[0]), "hann", detrend="linear", axis=0)
    return float(1.0 / frequency[1:][np.argmax(power[1:].sum(axis=1))])


def variable_sentences(name: str, values: Mapping[str, Array]) -> list[str]:
    """Which explanatory variables are highly correlated along a record.

    Args:
        name: Of the flight and canopy.
        values: Variables by name, (T,); NaN left out; those without a name in words are passed over.

    Returns:
        One sentence per pair beyond a correlation of 0.9, or one that there is none.
    """
    known = {key: np.asarray(v) for key, v in values.items() if key in _WORDS and np.isfinite(v).any()}
    if not known:
        return []
    rows = np.isfinite(np.stack(list(known.values()))).all(axis=0)
    said = []
    for a, b in combinations(known, 2):
        x, y = known[a][rows], known[b][rows]
        if x.size > 2 and np.std(x) > 0.0 and np.std(y) > 0.0:
            r = float(np.corrcoef(x, y)[0, 1])
            if abs(r) > HIGH_CORRELATION:
                said.append(
                    f"{name}: {_WORDS[a]} and {_WORDS[b]} are highly correlated ({r:.2f}); "
                    "the record can hardly separate their effects."
                )
    return said or [f"{name}: no two explanatory variables are correlated beyond {HIGH_CORRELATION:g}."]


def noise_sentences(snr: Mapping[str, float]) -> list[str]:
    """Whether the signal-to-noise ratio is enough for structure selection.

    Args:
        snr: Signal-to-noise ratio by coefficient: standard deviation of the data over that of their noise.

    Returns:
        One sentence per coefficient.
    """
    said = []
    for name, ratio in snr.items():
        enough = "enough for structure selection"
        low = f"below {LOW_SNR:g}, so structure selection is not reliable"
        said.append(f"{name}: signal-to-noise ratio {ratio:.2g}, {enough if ratio > LOW_SNR else low}.")
    return said


def rival_sentences(name: str, found: Sequence[Mapping[str, object]], least: float = 0.05) -> list[str]:
    """Selected terms that may be confused with other candidates.

    Args:
        name: Of the coefficient.
        found: Confusable terms as plain values, see `bayeschute.structure.confusable_terms.Rival`.
        least: Probability of confusion from which there is a sentence.

    Returns:
        One sentence per such term.
    """
    said = []
    for rival in found:
        chance = rival.get("chance")
        if isinstance(chance, float) and chance >= least:
            said.append(
                f"{name}: {rival['term']} may be confused with {rival['rival']} (partial correlation "
                f"{rival['correlation']:.3f} given the other terms, probability of confusion by noise "
                f"{100 * chance:.0f} %)."
            )
    return said
