"""Aerodynamic curves: prior and posterior bands with external knowledge, over the range that was flown.

A function that takes axes draws one panel on them and returns them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from bayeschute.report.figures.canvas import (
    BLUE,
    INK,
    ORANGE,
    SHADE,
    SOFT,
    VERMILION,
    literal,
    panels,
    styled,
)
from bayeschute.report.wording import shown_unit

Array = NDArray[np.float64]
_MARKS = "os^Dv"
_LABEL = {"alpha": "total angle of attack", "D_prox": "distance of the canopies over the reference length, D_prox"}


def shown_axis(symbol: str, unit: str) -> tuple[float, str]:
    """Factor from SI to what an axis shows, and its label."""
    scale, shown = shown_unit(unit)
    return scale, f"{_LABEL.get(symbol, symbol)} [{shown or 1}]"


@styled
def curve(
    axes: Axes,
    symbol: str,
    unit: str,
    at: Array,
    bands: Mapping[str, tuple[Array, Array, Array]],
    flown: tuple[float, float],
    known: Sequence[Mapping[str, Any]] = (),
    truth: Array | None = None,
    words: str = "90 %",
) -> Axes:
    """A curve with its bands.

    Args:
        axes: Where to.
        symbol: What the curve is over.
        unit: Its SI unit.
        at: Grid (K,).
        bands: ``posterior`` and, where known, ``prior``: low, median and high (K,) each.
        flown: Range that was flown, SI; outside, the median is dotted: extrapolated.
        known: What others know: ``name``, ``at``, ``values``, ``sd``.
        truth: The true curve (K,), where it is known.
        words: What the band holds.
    """
    scale, label = shown_axis(symbol, unit)
    x = scale * at
    inside = (at >= flown[0] - 1e-9) & (at <= flown[1] + 1e-9)
    if not inside.all():
        axes.axvspan(scale * flown[0], scale * flown[1], color=SHADE, lw=0, zorder=0, label="range flown")
    low, middle, high = bands["posterior"]
    if "prior" in bands:
        axes.plot(x, bands["prior"][0], "--", color=SOFT, lw=0.9, label=f"prior, {words}")
        axes.plot(x, bands["prior"][2], "--", color=SOFT, lw=0.9)
    axes.fill_between(x, low, high, color=BLUE, alpha=0.1, lw=0)
    axes.fill_between(x, low, high, where=inside.tolist(), color=BLUE, alpha=0.22, lw=0, label=f"posterior, {words}")
    axes.plot(x, middle, ":", color=BLUE, lw=1.1)
    axes.plot(x, np.where(inside, middle, np.nan), color=BLUE, lw=1.5, label="median")
    if truth is not None:
        axes.plot(x, truth, color=VERMILION, lw=1.1, label="truth")
    for i, one in enumerate(known):
        place, value, sd = (np.asarray(one[key], float) for key in ("at", "values", "sd"))
        style: dict[str, Any] = {
            "color": INK if i % 2 else ORANGE,
            "fmt": _MARKS[i % len(_MARKS)],
            "ms": 4,
            "lw": 0,
            "elinewidth": 1.1,
        }
        axes.errorbar(scale * place, value, 1.645 * sd, capsize=2, label=f"{literal(one['name'])}, 90 %", **style)
    axes.axhline(0.0, color=SOFT, lw=0.6)
    _bound(axes, [low, high, *([] if truth is None else [truth])], known)
    axes.set_xlabel(label)
    axes.margins(x=0)
    return axes


def _bound(axes: Axes, lines: Sequence[Array], known: Sequence[Mapping[str, Any]]) -> None:
    """Limits that show what was found and what others know; a prior that is wide beside it runs off the axes."""
    ends = [np.asarray(line, float) for line in lines]
    for one in known:
        value, sd = np.asarray(one["values"], float), np.asarray(one["sd"], float)
        ends += [value - 2.0 * sd, value + 2.0 * sd]
    every = np.concatenate([end[np.isfinite(end)] for end in ends])
    span = float(np.ptp(every)) or abs(float(every.mean())) or 1.0
    axes.set_ylim(float(every.min()) - 0.35 * span, float(every.max()) + 0.35 * span)


@styled
def curve_figure(
    table: pd.DataFrame,
    known: Sequence[Mapping[str, Any]],
    words: Mapping[str, str],
    flown: Mapping[str, Sequence[float]],
) -> Figure:
    """The curves of a run, a panel each.

    Args:
        table: ``curves.csv`` of a run.
        known: What others know of curves: ``target``, ``name``, ``at``, ``values``, ``sd``.
        words: What each curve is.
        flown: Range that was flown [SI], by what a curve is over; the whole grid where it is not told.
    """
    names = list(dict.fromkeys(table["curve"]))
    figure, all_axes = panels(len(names), 2, 0.4, 2.9)
    for axes, name in zip(all_axes, names, strict=True):
        one = table[table["curve"] == name]
        at, symbol = one["at"].to_numpy(float), str(one["symbol"].iloc[0])
        bands = {
            kind: (
                one[f"{kind}_q05"].to_numpy(float),
                one[f"{kind}_q50"].to_numpy(float),
                one[f"{kind}_q95"].to_numpy(float),
            )
            for kind in ("posterior", "prior")
            if f"{kind}_q05" in one and one[f"{kind}_q05"].notna().all()
        }
        truth = one["truth"].to_numpy(float) if "truth" in one and one["truth"].notna().all() else None
        low, high = flown.get(symbol, (at[0], at[-1]))
        beside = [k for k in known if k.get("kind") == "curve" and k.get("target") == name]
        curve(axes, symbol, str(one["unit"].iloc[0]), at, bands, (low, high), beside, truth)
        axes.set_title(f"{name}: {words.get(name, '')}".rstrip(": "))
        axes.legend(loc="best", fontsize=7.4)
    return figure
