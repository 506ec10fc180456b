"""Figure of posterior predictive checks: p-values by statistic, and PIT histograms of the innovations by channel.

A function that takes axes draws one panel on them and returns them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import binom

from bayeschute.report.figures.canvas import BLUE, SHADE, SOFT, VERMILION, sheet, styled

Array = NDArray[np.float64]
LEAST = 1e-12  # smaller p-values are drawn here


@styled
def predictive_figure(
    checks: Sequence[Mapping[str, Any]], pit: Mapping[str, Mapping[str, Sequence[int]]], bound: float
) -> Figure:
    """Predictive checks of the fitted records.

    Args:
        checks: Entries with ``statistic`` and ``p``.
        pit: Counts of the probability integral transform in equal bins, by flight and channel.
        bound: Probability of a false alarm over all checks together.
    """
    counts: dict[str, Array] = {}
    for by_channel in pit.values():
        for channel, each in by_channel.items():
            counts[channel] = counts.get(channel, np.zeros(len(each))) + np.asarray(each, float)
    figure, all_axes = sheet(3.0, 1, 1 + len(counts), gridspec_kw={"width_ratios": [2.2] + [1.0] * len(counts)})
    p_values(all_axes[0], checks, bound)
    for axes, (channel, some) in zip(all_axes[1:], counts.items(), strict=True):
        pit_histogram(axes, some).set_title(channel.replace("_", " "))
    return figure


@styled
def pit_histogram(axes: Axes, counts: Array) -> Axes:
    """Histogram of the probability integral transform; shaded: 90 % of chance.

    Args:
        axes: Where to draw.
        counts: In equal bins from 0 to 1.
    """
    total, bins = int(counts.sum()), counts.size
    low, high = binom.ppf([0.05, 0.95], total, 1.0 / bins) if total else (0.0, 1.0)
    axes.axhspan(low, high, color=SHADE, zorder=0)
    axes.bar((np.arange(bins) + 0.5) / bins, counts, 1.0 / bins, color=BLUE, alpha=0.65, ec="white", lw=0.5)
    axes.set(xlabel="PIT [1]", xlim=(0.0, 1.0))
    return axes


@styled
def p_values(axes: Axes, checks: Sequence[Mapping[str, Any]], bound: float) -> Axes:
    """p-values by statistic, on a logarithmic axis, with the bound that holds for all of them.

    Args:
        axes: Where to draw.
        checks: Entries with ``statistic`` and ``p``; grey where they say that a small one does not count (``matters``).
        bound: Probability of a false alarm over all checks together.
    """
    names = list(dict.fromkeys(str(one["statistic"]) for one in checks))
    limit = bound / max(len(checks), 1)
    for place, name in enumerate(names):
        some = [one for one in checks if one["statistic"] == name]
        p = np.array([max(float(one["p"]), LEAST) for one in some])
        away = 0.25 * np.sin(np.arange(p.size) * 2.4)  # apart, so that points do not cover each other
        beyond = [value < limit for value in p]
        counts = [bool(one.get("matters", True)) for one in some]
        colours = [(VERMILION if c else SOFT) if b else BLUE for b, c in zip(beyond, counts, strict=True)]
        axes.scatter(p, place + away, s=10, c=colours, alpha=0.75, lw=0)
    axes.axvline(limit, color=VERMILION, lw=1.0, ls="--")
    axes.axvline(1.0, color=SOFT, lw=0.6)
    axes.set(xscale="log", xlabel="p-value [1]", title="p-values; dashed: bound for all together")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.5, -0.5)
    return axes
