"""Aerodynamic curves of a posterior: draws on a grid, prior beside, and the table ``curves.csv`` of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayeschute.aero.coefficient import terms_of
from bayeschute.aero.curve_names import CURVES
from bayeschute.aero.curves import Setting, regressors

Array = NDArray[np.float64]
POINTS = 61
LEVELS = (0.5, 0.9)


class CurveDraws(NamedTuple):
    """A curve of every draw.

    Attributes:
        grid: Angles [rad] or D_prox [1] (K,).
        draws: Of the posterior (draw, K).
        prior: Of the prior (draw, K); None where it is not known.
    """

    grid: Array
    draws: Array
    prior: Array | None


def known_curves(names: list[str]) -> tuple[str, ...]:
    """Curves of which some parameter is part."""
    axial, transverse, _ = terms_of(names)
    probe = np.array([0.3])
    return tuple(name for name in CURVES if np.any(regressors(name, axial, transverse, probe) != 0.0))


def curve_draws(
    name: str,
    posterior: Mapping[str, Array],
    prior: Mapping[str, Array] | None,
    grid: Array,
    setting: Setting | None = None,
) -> CurveDraws:
    """A curve of every draw of posterior and prior.

    Args:
        name: One of `CURVES`.
        posterior: Draws by parameter (chain, draw).
        prior: Likewise; None: not known.
        grid: Where (K,).
        setting: The rest of the airflow; None: a canopy alone at its reference speed.
    """
    names = list(posterior)
    axial, transverse, places = terms_of(names)
    design = regressors(name, axial, transverse, grid, setting or Setting())
    part = np.any(design != 0.0, axis=0)
    chosen = [names[i] for i, here in zip(places, part, strict=True) if here]

    def of(draws: Mapping[str, Array]) -> Array:
        flat = [np.ravel(draws[n]) for n in chosen]
        return np.stack(flat, axis=-1) @ design[:, part].T if chosen else np.zeros((1, grid.size))

    before = None if prior is None or not set(chosen) <= set(prior) else of(prior)
    return CurveDraws(grid, of(posterior), before)


def table(
    posterior: Mapping[str, Array],
    prior: Mapping[str, Array] | None,
    ranges: Mapping[str, tuple[float, float]],
    reach: Mapping[str, float],
    truth: Mapping[str, float] | None = None,
    saturation: float | None = None,
) -> pd.DataFrame:
    """Bands of all curves of a posterior, over the range flown and as far beyond as there is something to compare.

    Args:
        posterior: Draws by parameter (chain, draw).
        prior: Likewise.
        ranges: From `flown.ranges`.
        reach: By curve, how far the grid goes at least.
        truth: Coefficients that a virtual drop was flown with; None: not known.
        saturation: Of the fitted terms, as of `Structure` [rad].

    Returns:
        A row a point: curve, symbol, unit, at, flown, quantiles of posterior and prior, the truth where it is known.
    """
    frames = []
    for name in known_curves(list(posterior)):
        symbol, unit, _ = CURVES[name]
        if symbol not in ranges:
            continue
        low, high = ranges[symbol]
        start = min(low, reach.get(f"{name} from", low))
        grid = np.linspace(start, max(high, reach.get(name, high)), POINTS)
        made = curve_draws(name, posterior, prior, grid, Setting(saturation=saturation))
        rows: dict[str, Any] = {"curve": name, "symbol": symbol, "unit": unit, "at": grid}
        rows["flown"] = (grid >= low - 1e-12) & (grid <= high + 1e-12)
        for words, values in (("posterior", made.draws), ("prior", made.prior)):
            if values is not None:
                rows |= quantiles(words, values)
        if truth:
            flown = {n: np.array([v]) for n, v in truth.items()}
            rows["truth"] = curve_draws(name, flown, None, grid).draws[0]
        frames.append(pd.DataFrame(rows))
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def quantiles(words: str, values: Array) -> dict[str, Array]:
    """Median and ends of the central bands of draws (draw, K), as columns of the table."""
    shares = {"q05": 0.05, "q25": 0.25, "q50": 0.5, "q75": 0.75, "q95": 0.95}
    found = np.quantile(values, list(shares.values()), axis=0)
    return {f"{words}_{name}": row for name, row in zip(shares, found, strict=True)}
