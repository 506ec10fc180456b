"""What a record can tell before anything is fitted, and what it can't, in words (report, 6.3.5 and 7.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.regression.collinearity import HIGH_CORRELATION

Array = NDArray[np.float64]
LOW_SNR = 3.0  # signal over noise (report, 6.3.5)
PENDULUM_PERIOD = 14.5  # [s], 0.069 Hz (report, 7.1)
_LEVELS = (0.02, 0.98)  # quantiles that are told as a range
_WORDS = {
    "speed": "airspeed",
    "alpha": "angle of attack",
    "alpha_rate": "rate of the angle of attack",
    "azimuth_rate": "rate of the azimuth",
    "q": "dynamic pressure",
    "distance": "distance of the canopies",
    "closing": "closing speed of the canopies",
}


def record_sentences(name: str, made: xr.Dataset) -> list[str]:
    """What the motion along a record covers.

    Args:
        name: Of the flight.
        made: What `bayeschute.records.reconstruct` made of it.

    Returns:
        Sentences: range of the angle of attack, length, airspeed, distance of the canopies.
    """
    low, high = np.rad2deg(np.nanquantile(made["alpha_T"].values, _LEVELS))
    duration = float(made["time"][-1] - made["time"][0])
    spread = float(np.nanstd(made["airspeed"].values) / np.nanmean(made["airspeed"].values))
    said = [
        f"{name}: total angle of attack between {low:.0f} and {high:.0f} deg; "
        "nothing is known of the aerodynamics beyond.",
        f"{name}: {duration:.0f} s, about {duration / PENDULUM_PERIOD:.0f} pendulum periods of {PENDULUM_PERIOD:g} s.",
    ]
    if low > 5.0:
        said.append(
            f"{name}: the angle of attack is rarely below {low:.0f} deg: "
            "slopes at zero are told by the assumed form only."
        )
    if spread < 0.1:
        said.append(
            f"{name}: airspeed varies by {100 * spread:.0f} % only, "
            "so terms in airspeed or dynamic pressure are weakly told."
        )
    distance = made["D_prox"].values
    if np.isfinite(distance).any():
        near, far = np.nanquantile(distance, _LEVELS)
        said.append(
            f"{name}: canopies between {near:.2f} and {far:.2f} reference lengths apart; "
            "a spline whose knot lies outside is a straight line here."
        )
    return said


def variable_sentences(name: str, values: Mapping[str, Array]) -> list[str]:
    """Which explanatory variables move together along a record.

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
                    f"{name}: {_WORDS[a]} and {_WORDS[b]} move together (correlation {r:.2f}); "
                    "the record can hardly tell their effects apart."
                )
    return said or [f"{name}: no two explanatory variables are correlated beyond {HIGH_CORRELATION:g}."]


def noise_sentences(snr: Mapping[str, float]) -> list[str]:
    """What the noise allows.

    Args:
        snr: Signal-to-noise ratio by coefficient: standard deviation of the data over that of their noise.

    Returns:
        One sentence per coefficient.
    """
    said = []
    for name, ratio in snr.items():
        judged = (
            "enough for a structure" if ratio > LOW_SNR else f"below {LOW_SNR:g}: a structure can't be told reliably"
        )
        said.append(f"{name}: signal-to-noise ratio {ratio:.2g}, {judged}.")
    return said


def rival_sentences(name: str, found: Sequence[Mapping[str, object]], least: float = 0.05) -> list[str]:
    """Which kept terms might as well be others.

    Args:
        name: Of the coefficient.
        found: Rivals as plain values, see `bayeschute.structure.confusable_terms.Rival`.
        least: Chance from which a rival is told.

    Returns:
        One sentence per such term.
    """
    said = []
    for rival in found:
        chance = rival.get("chance")
        if isinstance(chance, float) and chance >= least:
            said.append(
                f"{name}: in place of {rival['term']} noise could have chosen {rival['rival']} "
                f"(correlation {rival['correlation']:.3f} given the other terms, chance {100 * chance:.0f} %)."
            )
    return said
