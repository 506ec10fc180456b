"""Figures of structure selection, prior and posterior densities, and Markov chain diagnostics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from scipy import stats

from bayeschute.report.figures.canvas import BLUE, INK, SERIES, SOFT, VERMILION, panels, sheet, styled
from bayeschute.report.wording import is_number, shown_unit

MOST_PANELS = 16
RANK_BINS = 20


@styled
def pse_figure(structure: Mapping[str, Mapping[str, Any]]) -> Figure:
    """Fit error and predicted error against the number of terms, one panel per coefficient."""
    figure, all_axes = sheet(2.9, 1, max(len(structure), 1))
    for axes, (name, facts) in zip(all_axes, structure.items(), strict=True):
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
        axes.set_title(f"{name.capitalize()} coefficient")
        axes.set_xlabel("number of terms")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(loc="best")
    all_axes[0].set_ylabel("error of the coefficient [1]")
    return figure


@styled
def autocorrelation_figure(curves: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Autocorrelation of residuals.

    Args:
        curves: Name to lags [s] and autocorrelation [1].
    """
    figure, all_axes = panels(len(curves), 3, 0.4, 2.0, sharey=True)
    for axes, (name, (lag, value)) in zip(all_axes, curves.items(), strict=True):
        axes.fill_between(lag, 0, value, color=BLUE, alpha=0.22, lw=0)
        axes.plot(lag, value, color=BLUE, lw=1.2)
        axes.axhline(0, color=SOFT, lw=0.8)
        axes.set_title(name.replace("_", " ").capitalize())
        axes.set_xlabel("lag [s]")
        axes.set_ylim(min(-0.35, float(np.nanmin(value)) - 0.05), 1.02)
        axes.margins(x=0)
    all_axes[0].set_ylabel("autocorrelation [1]")
    return figure


def _density(values: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Kernel density of at most 4,000 draws on a grid; zero where the draws don't vary."""
    values = values[np.isfinite(values)]
    values = values[:: max(1, values.size // 4000)]
    return stats.gaussian_kde(values)(grid) if values.size > 2 and values.std() > 0 else np.zeros_like(grid)


@styled
def marginal_figure(
    posterior: Mapping[str, np.ndarray],
    prior: Mapping[str, np.ndarray],
    truth: Mapping[str, float],
    units: Mapping[str, str],
) -> Figure:
    """Marginal prior and posterior densities, with the true value where it is known.

    Args:
        posterior: Parameter name to draws of any shape.
        prior: Parameter name to draws of any shape.
        truth: Parameter name to true value.
        units: Parameter name to SI unit.

    Returns:
        Small panels, the first 16 parameters.
    """
    names = list(posterior)[:MOST_PANELS]
    figure, all_axes = panels(len(names), 4, 0.55, 1.75)
    handles: dict[str, Any] = {}
    for axes, name in zip(all_axes, names, strict=True):
        scale, unit = shown_unit(units.get(name, "1"))
        after = scale * np.ravel(posterior[name])
        before = scale * np.ravel(prior[name]) if name in prior else np.empty(0)
        centre, sd = float(after.mean()), float(after.std()) or abs(float(after.mean())) or 1.0
        low, high = centre - 3.6 * sd, centre + 3.6 * sd
        if before.size:  # wide enough to see the prior, narrow enough to resolve the posterior
            edges = np.quantile(before, [0.01, 0.99])
            low, high = max(min(low, edges[0]), centre - 10 * sd), min(max(high, edges[1]), centre + 10 * sd)
        if is_number(truth.get(name)):
            low, high = min(low, scale * truth[name] - sd), max(high, scale * truth[name] + sd)
        grid = np.linspace(low, high, 151)
        if before.size:
            curve = _density(before, grid)
            axes.fill_between(grid, curve, color=SOFT, alpha=0.16, lw=0)
            handles["prior"] = axes.plot(grid, curve, color=SOFT, lw=1.2, ls=(0, (4, 2)))[0]
        curve = _density(after, grid)
        axes.fill_between(grid, curve, color=BLUE, alpha=0.24, lw=0)
        handles["posterior"] = axes.plot(grid, curve, color=BLUE, lw=1.5)[0]
        if is_number(truth.get(name)):
            handles["truth"] = axes.axvline(scale * truth[name], color=VERMILION, lw=1.6)
        axes.set_title(name if not unit else f"{name} [{unit}]", fontsize=8.4)
        axes.set_yticks([])
        axes.set_ylim(bottom=0)
        axes.spines["left"].set_visible(False)
        axes.margins(x=0)
        axes.xaxis.set_major_locator(MaxNLocator(nbins=4, prune="both"))
    figure.legend(list(handles.values()), list(handles), loc="outside upper right", ncols=len(handles))
    return figure


@styled
def correlation_figure(names: list[str], matrix: np.ndarray) -> Figure:
    """Pair correlations of the posterior, the lower triangle as a heat map with numbers."""
    size = len(names) - 1
    side = min(2.2 + 0.5 * size, 8.2)
    figure, (axes,) = sheet(side * 0.84, width=side + 1.2)
    matrix = matrix[1:, :-1]
    shown = np.ma.masked_where(np.triu(np.ones_like(matrix, dtype=bool), 1), matrix)
    image = axes.imshow(shown, vmin=-1, vmax=1, cmap="RdBu_r")
    axes.set_xticks(range(size), names[:-1], rotation=40, ha="right", rotation_mode="anchor")
    axes.set_yticks(range(size), names[1:])
    axes.grid(False)
    for side_name in ("left", "bottom"):
        axes.spines[side_name].set_visible(False)
    axes.tick_params(length=0)
    if size <= 14:
        for i in range(size):
            for j in range(i + 1):
                color = "white" if abs(matrix[i, j]) > 0.6 else INK
                axes.text(
                    j, i, f"{matrix[i, j]:.2f}".replace("-", "−"), ha="center", va="center", size=7.6, color=color
                )
    bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02)
    bar.ax.spines["outline"].set_visible(False)
    bar.set_label("correlation [1]")
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
        trace, rank = all_axes[2 * place], all_axes[2 * place + 1]
        scale, unit = shown_unit(units.get(name, "1"))
        draws = scale * posterior[name]
        step = max(1, draws.shape[1] // 125)  # panels are some 250 pixels wide
        counts = rank_counts(draws)
        expected = draws.shape[1] / RANK_BINS
        low, high = stats.binom(draws.shape[1], 1 / RANK_BINS).ppf([0.005, 0.995]) / expected
        rank.axhspan(low, high, color="#e9edf1", lw=0)
        for chain, (values, count) in enumerate(zip(draws, counts, strict=True)):
            color = SERIES[chain % len(SERIES)]
            trace.plot(np.arange(0, draws.shape[1], step), values[::step], color=color, lw=0.5, alpha=0.85)
            rank.stairs(count / expected, np.linspace(0, 1, RANK_BINS + 1), color=color, lw=1.0)
        trace.set_title(name if not unit else f"{name} [{unit}]", fontsize=8.2)
        trace.margins(x=0)
        rank.set_xlim(0, 1)
        rank.set_ylim(0, max(2.0, float(counts.max() / expected) * 1.05))
        rank.set_xticks([0, 0.5, 1], ["0", "½", "1"])
        rank.set_yticks([0, 1, 2])
        for axes in (trace, rank):
            axes.tick_params(labelbottom=place >= len(names) - 2, labelsize=7.2)
            axes.grid(False)
    for axes in all_axes[2 * len(names) :]:
        axes.set_visible(False)
    for place in range(max(0, len(names) - 2), len(names)):
        all_axes[2 * place].set_xlabel("draw")
        all_axes[2 * place + 1].set_xlabel("rank")
    return figure
