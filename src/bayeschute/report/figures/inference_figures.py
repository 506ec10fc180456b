"""Figures of structure selection, prior and posterior densities, and Markov chain diagnostics.

A function that takes axes draws one panel on them and returns them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy import stats

from bayeschute.report.figures.canvas import BLUE, INK, SERIES, SOFT, VERMILION, legend_of, panels, sheet, styled
from bayeschute.report.wording import is_number, shown_unit

MOST_PANELS = 16
RANK_BINS = 20


@styled
def predicted_error(axes: Axes, name: str, facts: Mapping[str, Any]) -> Axes:
    """Fit error and predicted error of a coefficient against the number of terms.

    Args:
        axes: Where to draw.
        name: Coefficient.
        facts: ``ranking`` (``mse``, ``pse`` by number of terms), ``selected``, ``pse_minimum_at``.
    """
    ranking = facts.get("ranking") or []
    count = np.arange(1, len(ranking) + 1)
    mse = np.array([float(r.get("mse", math.nan)) for r in ranking])
    pse = np.array([float(r.get("pse", math.nan)) for r in ranking])
    axes.plot(count, np.sqrt(mse), "o-", color=SOFT, ms=3.5, lw=1.1, label="fit error, √mse")
    axes.plot(count, np.sqrt(pse), "o-", color=BLUE, ms=3.5, lw=1.4, label="predicted error, √PSE")
    kept = facts.get("pse_minimum_at")
    kept = int(kept) if is_number(kept) else len(facts.get("selected") or [])
    if 0 < kept <= len(pse):
        axes.plot(kept, math.sqrt(pse[kept - 1]), "o", ms=11, mfc="none", mec=VERMILION, mew=1.6, label="selected")
    axes.set_yscale("log")
    axes.set(title=f"{name.capitalize()} coefficient", xlabel="number of terms")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc="best")
    return axes


@styled
def pse_figure(structure: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Fit error and predicted error against the number of terms, one panel per coefficient."""
    figure, all_axes = sheet(2.9, 1, max(len(structure), 1))
    for axes, (name, facts) in zip(all_axes, structure.items(), strict=True):
        predicted_error(axes, name, facts)
    all_axes[0].set_ylabel("error of the coefficient [1]")
    return figure


@styled
def autocorrelation(axes: Axes, name: str, lag: np.ndarray, value: np.ndarray) -> Axes:
    """Autocorrelation (lag,) of a channel's residuals over lags [s]."""
    axes.fill_between(lag, 0, value, color=BLUE, alpha=0.22, lw=0)
    axes.plot(lag, value, color=BLUE, lw=1.2)
    axes.axhline(0, color=SOFT, lw=0.8)
    axes.set(title=name.replace("_", " ").capitalize(), xlabel="lag [s]")
    axes.set_ylim(min(-0.35, float(np.nanmin(value)) - 0.05), 1.02)
    axes.margins(x=0)
    return axes


@styled
def autocorrelation_figure(curves: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Autocorrelation of residuals, one panel per channel.

    Args:
        curves: Name to lags [s] and autocorrelation [1].
    """
    figure, all_axes = panels(len(curves), 3, 0.4, 2.0, sharey=True)
    for axes, (name, curve) in zip(all_axes, curves.items(), strict=True):
        autocorrelation(axes, name, *curve)
    all_axes[0].set_ylabel("autocorrelation [1]")
    return figure


def _density(values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Kernel density of at most 4,000 draws on a grid; zero where the draws don't vary."""
    values = values[np.isfinite(values)]
    values = values[:: max(1, values.size // 4000)]
    return stats.gaussian_kde(values)(grid) if values.size > 2 and values.std() > 0 else np.zeros_like(grid)


@styled
def marginal(
    axes: Axes,
    name: str,
    posterior: np.ndarray,
    prior: np.ndarray | None = None,
    truth: float | None = None,
    unit: str = "1",
) -> Axes:
    """Prior and posterior density of a parameter, with the true value where it is known.

    Args:
        axes: Where to draw.
        name: Parameter.
        posterior: Draws of any shape, SI.
        prior: Likewise.
        truth: True value.
        unit: SI unit.
    """
    scale, shown = shown_unit(unit)
    after = scale * np.ravel(posterior)
    before = scale * np.ravel(prior) if prior is not None else np.empty(0)
    centre, sd = float(after.mean()), float(after.std()) or abs(float(after.mean())) or 1.0
    low, high = centre - 3.6 * sd, centre + 3.6 * sd
    if before.size:  # wide enough to see the prior, narrow enough to resolve the posterior
        edges = np.quantile(before, [0.01, 0.99])
        low, high = max(min(low, edges[0]), centre - 10 * sd), min(max(high, edges[1]), centre + 10 * sd)
    if is_number(truth):
        low, high = min(low, scale * truth - sd), max(high, scale * truth + sd)
    grid = np.linspace(low, high, 101)
    if before.size:
        curve = _density(before, grid)
        axes.fill_between(grid, curve, color=SOFT, alpha=0.16, lw=0)
        axes.plot(grid, curve, color=SOFT, lw=1.2, ls=(0, (4, 2)), label="prior")
    curve = _density(after, grid)
    axes.fill_between(grid, curve, color=BLUE, alpha=0.24, lw=0)
    axes.plot(grid, curve, color=BLUE, lw=1.5, label="posterior")
    if is_number(truth):
        axes.axvline(scale * truth, color=VERMILION, lw=1.6, label="truth")
    axes.set_title(name if not shown else f"{name} [{shown}]", fontsize=8.4)
    axes.set_yticks([])
    axes.set_ylim(bottom=0)
    axes.spines["left"].set_visible(False)
    axes.margins(x=0)
    axes.xaxis.set_major_locator(MaxNLocator(nbins=4, prune="both"))
    return axes


@styled
def marginal_figure(
    posterior: Mapping[str, np.ndarray],
    prior: Mapping[str, np.ndarray],
    truth: Mapping[str, float],
    units: Mapping[str, str],
) -> Figure:
    """Marginal prior and posterior densities in small panels, the first 16 parameters; see `marginal`.

    Args:
        posterior: Parameter name to draws of any shape.
        prior: Parameter name to draws of any shape.
        truth: Parameter name to true value.
        units: Parameter name to SI unit.
    """
    names = list(posterior)[:MOST_PANELS]
    figure, all_axes = panels(len(names), 4, 0.55, 1.75)
    for axes, name in zip(all_axes, names, strict=True):
        marginal(axes, name, posterior[name], prior.get(name), truth.get(name), units.get(name, "1"))
    legend_of(all_axes)
    return figure


@styled
def correlations(axes: Axes, names: list[str], matrix: np.ndarray) -> Axes:
    """Pair correlations of the posterior, the lower triangle as a heat map with numbers.

    Args:
        axes: Where to draw; a colour bar takes a part of them.
        names: Parameters.
        matrix: Correlations (P, P).
    """
    size = len(names) - 1
    matrix = matrix[1:, :-1]
    shown = np.ma.masked_where(np.triu(np.ones_like(matrix, dtype=bool), 1), matrix)
    image = axes.imshow(shown, vmin=-1, vmax=1, cmap="RdBu_r")
    axes.set_xticks(range(size), names[:-1], rotation=40, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(size), names[1:])
    axes.grid(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.tick_params(length=0)
    if size <= 14:
        for i in range(size):
            for j in range(i + 1):
                color = "white" if abs(matrix[i, j]) > 0.6 else INK
                words = f"{matrix[i, j]:.2f}".replace("-", "−")
                axes.text(j, i, words, ha="center", va="center", size=7.6, color=color)
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02)
    bar.ax.spines["outline"].set_visible(False)
    bar.set_label("correlation [1]")
    return axes


@styled
def correlation_figure(names: list[str], matrix: np.ndarray) -> Figure:
    """Pair correlations of the posterior on a sheet of their own; see `correlations`."""
    side = min(2.2 + 0.5 * (len(names) - 1), 8.2)
    figure, (axes,) = sheet(side * 0.84, width=side + 1.2)
    correlations(axes, names, matrix)
    return figure


def rank_counts(draws: np.ndarray, bins: int = RANK_BINS) -> np.ndarray:
    """Rank histogram of each chain: ranks among all draws, in equal bins (Vehtari et al. 2021).

    Args:
        draws: Draws (chain, draw).
        bins: Number of bins.

    Returns:
        Counts (chain, bin); equal, up to chance and autocorrelation, when the chains agree.
    """
    ranks = stats.rankdata(draws).reshape(draws.shape)
    edges = np.linspace(0.5, draws.size + 0.5, bins + 1)
    return np.stack([np.histogram(chain, edges)[0] for chain in ranks])


@styled
def trace(axes: Axes, draws: np.ndarray) -> Axes:
    """Draws of each chain (chain, draw) one after the other, thinned to what a panel can show."""
    step = max(1, draws.shape[1] // 100)  # panels are some 250 pixels wide
    for chain, values in enumerate(draws):
        color = SERIES[chain % len(SERIES)]
        axes.plot(np.arange(0, draws.shape[1], step), values[::step], color=color, lw=0.5, alpha=0.85)
    axes.margins(x=0)
    axes.grid(False)
    return axes


@styled
def ranks(axes: Axes, draws: np.ndarray) -> Axes:
    """Rank histogram of each chain (chain, draw) over the expected count; shaded: 99 % of chance."""
    counts = rank_counts(draws)
    expected = draws.shape[1] / RANK_BINS
    low, high = stats.binom(draws.shape[1], 1 / RANK_BINS).ppf([0.005, 0.995]) / expected
    axes.axhspan(low, high, color="#e9edf1", lw=0)
    for chain, count in enumerate(counts):
        color = SERIES[chain % len(SERIES)]
        axes.stairs(count / expected, np.linspace(0, 1, RANK_BINS + 1), color=color, lw=1.0)
    axes.set_xlim(0, 1)
    axes.set_ylim(0, max(2.0, float(counts.max() / expected) * 1.05))
    axes.set_xticks([0, 0.5, 1], ["0", "½", "1"])
    axes.set_yticks([0, 1, 2])
    axes.grid(False)
    return axes


@styled
def chain_figure(posterior: Mapping[str, np.ndarray], units: Mapping[str, str]) -> Figure:
    """Trace plot and rank histogram of the chains.

    Args:
        posterior: Parameter name to draws (chain, draw).
        units: Parameter name to SI unit.

    Returns:
        Two parameters per row, the first 16.
    """
    names = list(posterior)[:MOST_PANELS]
    rows = math.ceil(len(names) / 2)
    figure, all_axes = sheet(0.35 + 1.35 * rows, rows, 4, width_ratios=[2.1, 1, 2.1, 1])
    for place, name in enumerate(names):
        scale, unit = shown_unit(units.get(name, "1"))
        left, right = all_axes[2 * place : 2 * place + 2]
        trace(left, scale * posterior[name]).set_title(name if not unit else f"{name} [{unit}]", fontsize=8.2)
        ranks(right, scale * posterior[name])
        for axes, word in ((left, "draw"), (right, "rank")):
            lowest = place >= len(names) - 2
            axes.tick_params(labelbottom=lowest, labelsize=7.2)
            axes.set_xlabel(word if lowest else "")
    for axes in all_axes[2 * len(names) :]:
        axes.set_visible(False)
    return figure
