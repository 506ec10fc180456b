"""Figures of landings; a function that takes axes draws on them and returns them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle
from numpy.typing import NDArray

from bayeschute.landing.decisions.onset import Cell
from bayeschute.landing.decisions.requirements import Limit, exceedance
from bayeschute.landing.measures import LABELS, MEASURES
from bayeschute.report.figures.canvas import BLUE, INK, SERIES, SKY, SOFT, VERMILION, literal, sheet, styled

Rows = NDArray[np.void]
_SHOWN = 4000  # landings that are drawn as points
_SHARES = (0.5, 0.9, 0.99)  # of landings that an ellipse holds
_APART = 6  # wind profiles that have ellipses of their own


@styled
def scatter(ax: Axes, rows: Rows) -> Axes:
    """Where landings lie from the start, with ellipses that hold shares of a normal distribution of their moments.

    Where the landings are of a few wind profiles, each has ellipses of its own.

    Args:
        ax: Where to draw.
        rows: Landings.
    """
    fine = rows[rows["outcome"] == 0]
    some = fine[:: max(1, len(fine) // _SHOWN)]
    for i, word in enumerate(LABELS):
        here = some[some["label"] == i]
        if len(here):
            ax.plot(here["drift_east"], here["drift_north"], ".", ms=2.5, color=SERIES[i], label=word, alpha=0.6)
    profiles = np.unique(fine["profile"])
    for part in [fine[fine["profile"] == i] for i in profiles] if profiles.size <= _APART else [fine]:
        if len(part) > 2:
            _ellipses(ax, part)
    ax.plot(0.0, 0.0, "+", color=VERMILION, ms=8)
    ax.set(xlabel="east of the start [m]", ylabel="north of the start [m]", aspect="equal", title="Landings")
    ax.legend(loc="best", markerscale=3)
    return ax


def _ellipses(ax: Axes, part: Rows) -> None:
    place = np.stack([part["drift_east"], part["drift_north"]])
    values, vectors = np.linalg.eigh(np.cov(place))
    angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
    for share in _SHARES:
        # The squared distance of a plane's normal is exponential.
        size = 2.0 * np.sqrt(-2.0 * np.log1p(-share) * np.maximum(values, 0.0))
        middle = tuple(place.mean(axis=1))
        ax.add_patch(Ellipse(middle, size[1], size[0], angle=angle, fill=False, color=INK, lw=0.8))


@styled
def exceedance_curve(ax: Axes, table: pd.DataFrame, quantity: str, limits: Sequence[Limit] = ()) -> Axes:
    """P(quantity > threshold) with both limits: over the posterior, and for the number of landings.

    Args:
        ax: Where to draw.
        table: From `landing.decisions.requirements.exceedance`.
        quantity: Of the table.
        limits: Drawn where they are on this quantity.
    """
    least = 0.3 / max(1e3, 1.0 / max(float(table["clopper_pearson_high"].min()), 1e-9))
    x = table["threshold"]
    ax.fill_between(
        x, table["posterior_low"].clip(lower=least), table["posterior_high"].clip(lower=least), color=SKY, alpha=0.35,
        lw=0.0, label="90 % over the posterior",
    )  # fmt: skip
    for end in ("clopper_pearson_low", "clopper_pearson_high"):
        label = "90 % Monte Carlo limits" if end.endswith("low") else None
        ax.plot(x, table[end].clip(lower=least), ":", color=SOFT, lw=1.0, label=label)
    ax.plot(x, table["probability"].clip(lower=least), color=BLUE, lw=1.6, label="mean")
    for limit in limits:
        value = limit.at_most if limit.at_most is not None else limit.at_least
        if limit.quantity == quantity and value is not None:
            ax.axvline(value, color=VERMILION, lw=1.0)
    ax.set(yscale="log", ylim=(least, 1.1), xlabel=f"{quantity.replace('_', ' ')} [{MEASURES[quantity][0]}]")
    ax.set(ylabel="probability to exceed", title="Exceedance")
    ax.legend(loc="best")
    return ax


@styled
def tornado(
    ax: Axes, shares: Mapping[str, float], errors: Mapping[str, float] | None = None, title: str = "What drives it"
) -> Axes:
    """Shares of a variance, the greatest on top.

    Args:
        ax: Where to draw.
        shares: Share by source [1]; all NaN where nothing differs.
        errors: Standard error of each [1].
        title: Of the axes.
    """
    if shares and np.isnan(list(shares.values())).all():
        ax.text(0.5, 0.5, "the same in all landings", ha="center", va="center", transform=ax.transAxes)
        ax.set(xticks=[], yticks=[], title=literal(title))
        return ax
    names = sorted(shares, key=lambda name: shares[name])
    spread = [(errors or {}).get(name, 0.0) for name in names]
    ax.barh(names, [shares[name] for name in names], xerr=spread, color=BLUE, height=0.6, ecolor=SOFT)
    ax.set(xlabel="share of the variance [1]", title=literal(title))
    ax.locator_params(axis="x", nbins=5)  # small shares have long labels
    return ax


@styled
def landing_figure(rows: Rows, quantity: str, limits: Sequence[Limit] = ()) -> Figure:
    """Scatter and exceedance beside each other."""
    figure, axes = sheet(4.2, 1, 2)
    scatter(axes[0], rows)
    exceedance_curve(axes[1], exceedance(rows, quantity), quantity, limits)
    return figure


_SHADES = {"go": "#bfe3d3", "can't tell": "#f3e2b3", "no-go": "#f2c0a8"}


@styled
def onset_map(ax: Axes, cells: Sequence[Cell]) -> Axes:
    """P(pendulum) against shear and payload, cells shaded by the day's verdict: a placard.

    Args:
        ax: Where to draw.
        cells: From `landing.decisions.onset.placard`.
    """
    shears = sorted({one.shear for one in cells})
    masses = sorted({one.capsule_mass for one in cells})
    for one in cells:
        i, j = masses.index(one.capsule_mass), shears.index(one.shear)
        ax.add_patch(Rectangle((i - 0.5, j - 0.5), 1.0, 1.0, color=_SHADES[one.word], lw=0.0))
        spread = f"{100 * one.pendulum.low:.0f} to {100 * one.pendulum.high:.0f} %"
        words = f"{one.word}\npendulum {100 * one.pendulum.met:.0f} %\n({spread})"
        ax.text(i, j, words, ha="center", va="center", fontsize=7.4)
    ax.set_xticks(range(len(masses)), [f"{mass:.0f}" for mass in masses])
    ax.set_yticks(range(len(shears)), [f"{shear:.1f}" for shear in shears])
    ax.set(xlim=(-0.5, len(masses) - 0.5), ylim=(-0.5, len(shears) - 0.5), xlabel="payload [kg]")
    ax.set(ylabel="change of the wind across the layer [m/s]", title="Placard")
    ax.grid(visible=False)
    return ax


@styled
def placard_figure(cells: Sequence[Cell]) -> Figure:
    """The placard on a sheet of its own."""
    rows = len({one.shear for one in cells})
    figure, axes = sheet(1.4 + 0.7 * rows)
    onset_map(axes[0], cells)
    return figure


@styled
def drivers_figure(table: pd.DataFrame) -> Figure:
    """Tornado of the total shares of groups beside Shapley shares of parameters, a row for each quantity."""
    names = list(dict.fromkeys(table["quantity"]))
    figure, axes = sheet(2.2 * len(names), len(names), 2)
    for i, name in enumerate(names):
        for ax, kind in zip(axes[2 * i : 2 * i + 2], ("total", "shapley"), strict=True):
            part = table[(table["quantity"] == name) & (table["kind"] == kind)].set_index("source")
            title = f"{name.replace('_', ' ')}: " + ("groups, total" if kind == "total" else "parameters")
            tornado(ax, part["share"].to_dict(), part["standard_error"].fillna(0.0).to_dict(), title)
    return figure


@styled
def drop_values(ax: Axes, values: Mapping[str, float], what: str) -> Axes:
    """Candidate drops by what they are expected to teach, the best on top.

    Args:
        ax: Where to draw.
        values: Expected shrinking by candidate [1].
        what: That shrinks.
    """
    tornado(ax, values, title="Next drop")
    ax.set(xlabel=f"expected shrinking of the {literal(what)} [1]")
    return ax


@styled
def design_figure(values: Mapping[str, float], what: str) -> Figure:
    """Candidate drops on a sheet of their own."""
    figure, axes = sheet(1.2 + 0.35 * len(values))
    drop_values(axes[0], values, what)
    return figure
