"""Figures of records, predicted bands, variance decomposition and exceedance probabilities.

A function that takes axes draws one panel on them and returns them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayeschute.report.figures.canvas import (
    BLUE,
    GREEN,
    INK,
    LINE,
    ORANGE,
    PURPLE,
    SHADE,
    SKY,
    VERMILION,
    feet_axis,
    legend_of,
    panels,
    sheet,
    styled,
    time_axis,
)
from bayeschute.report.wording import is_number, quantity_name, shown_unit, statistic_name

BAND_UNITS = {
    "swing_angle": "rad",
    "descent_rate": "m/s",
    "sea_level_descent_rate": "m/s",
    "flyout_angle": "rad",
}
MOST_POINTS = 450  # of a band: one for every other pixel of the page
_HELD_OUT = "held out of the fit"
SOURCES = {"parameter": BLUE, "wind": SKY, "initial state": ORANGE, "canopy force": "#a7b0b8"}


def _spans(time: np.ndarray, flag: np.ndarray) -> Iterator[tuple[float, float]]:
    """Start and end [s] of every run of true values."""
    edges = np.flatnonzero(np.diff(np.r_[False, flag, False].astype(int)))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield float(time[start]), float(time[min(stop, len(time) - 1)])


def _shade_held_out(axes: Axes, bands: xr.Dataset) -> None:
    """Shade the part that was not fitted, where only a part was."""
    if "held_out" not in bands:
        return
    flag = np.asarray(bands["held_out"].values, dtype=bool)
    if not flag.all():
        for start, end in _spans(np.asarray(bands["time"].values, dtype=float), flag):
            axes.axvspan(start, end, color=SHADE, lw=0, zorder=0, label=_HELD_OUT)


def band_quantities(bands: xr.Dataset) -> list[str]:
    """Quantities of a flight that have bands."""
    known = [str(n) for n in bands.data_vars if {"quantile", "time"} == set(bands[n].dims)]
    return [n for n in BAND_UNITS if n in known] + [n for n in known if n not in BAND_UNITS]


def _curve(bands: xr.Dataset, name: str, quantile: float) -> np.ndarray:
    """One quantile of a quantity (time,)."""
    return np.asarray(bands[name].sel(quantile=quantile, method="nearest").values, dtype=float)


def coverage(bands: xr.Dataset, name: str, low: float, high: float) -> float | None:
    """Coverage: share of the truth (or else of the record) between two quantiles; of the held-out part, if any.

    Args:
        bands: Bands of one flight.
        name: Quantity.
        low: Lower quantile [1].
        high: Upper quantile [1].

    Returns:
        Share of the finite samples [1]; None where nothing can be scored.
    """
    kind = next((k for k in ("truth", "record") if f"{name}_{k}" in bands), None)
    if kind is None:
        return None
    value = np.asarray(bands[f"{name}_{kind}"].values, dtype=float)
    below, above = _curve(bands, name, low), _curve(bands, name, high)
    use = np.isfinite(value) & np.isfinite(below) & np.isfinite(above)
    if "held_out" in bands and bands["held_out"].values.any():
        use &= np.asarray(bands["held_out"].values, dtype=bool)
    return float(((value >= below) & (value <= above))[use].mean()) if use.any() else None


@styled
def band(axes: Axes, bands: xr.Dataset, name: str, limit: float | None = None) -> Axes:
    """Predicted band of one quantity over time, with its true motion and record.

    Args:
        axes: Where to draw.
        bands: Dataset with dims (quantile, time) per quantity, see the run folder.
        name: Quantity.
        limit: That it must not exceed at any time (SI), drawn as a line.
    """
    bands = bands.isel(time=slice(None, None, max(1, math.ceil(bands.sizes["time"] / MOST_POINTS))))
    time = np.asarray(bands["time"].values, dtype=float)
    si = str(bands[name].attrs.get("units") or BAND_UNITS.get(name, "1"))
    scale, unit = shown_unit(si)
    low, q25, median, q75, high = (scale * _curve(bands, name, q) for q in (0.05, 0.25, 0.5, 0.75, 0.95))
    axes.fill_between(time, low, high, color=BLUE, alpha=0.20, lw=0, label="90 % band")
    axes.fill_between(time, q25, q75, color=BLUE, alpha=0.34, lw=0, label="50 % band")
    axes.plot(time, median, color=BLUE, lw=1.1, label="median")
    if f"{name}_record" in bands:
        record = scale * np.asarray(bands[f"{name}_record"].values, dtype=float)
        if np.isfinite(record).any():
            (dots,) = axes.plot(time, record, ".", color=INK, ms=3.2, alpha=0.6, mew=0, zorder=2.5, label="record")
            dots.set_rasterized(True)
    if f"{name}_truth" in bands:
        truth = scale * np.asarray(bands[f"{name}_truth"].values, dtype=float)
        axes.plot(time, truth, color=VERMILION, lw=1.3, zorder=3, label="truth")
    if is_number(limit):
        axes.axhline(scale * limit, color=INK, lw=1.0, ls=(0, (5, 3)), label="required limit")
    _shade_held_out(axes, bands)
    axes.set(title=quantity_name(name).capitalize(), ylabel=f"[{unit}]")
    _focus(axes, np.concatenate([low, high]))
    axes.margins(x=0)
    if si == "m/s":
        feet_axis(axes)
    return axes


@styled
def band_figure(bands: xr.Dataset, limits: Mapping[str, float] | None = None) -> Figure:
    """Predicted bands of one flight, one panel per quantity over time.

    Args:
        bands: As of `band`.
        limits: Quantity to the limit that it must not exceed at any time (SI).
    """
    names = band_quantities(bands)
    figure, all_axes = sheet(0.7 + 2.15 * len(names), len(names), 1, sharex=True)
    for axes, name in zip(all_axes, names, strict=True):
        band(axes, bands, name, (limits or {}).get(name))
    time_axis(all_axes[-1], float(bands["time"].values[0]))
    legend_of(all_axes, markerscale=2)
    return figure


def _focus(axes: Axes, values: np.ndarray) -> None:
    """Limit the axis to the band and its surroundings, so that outliers of a record don't flatten the curves."""
    finite = values[np.isfinite(values)]
    if finite.size:
        low, high = float(finite.min()), float(finite.max())
        margin = 0.35 * max(high - low, 1e-9)
        current = axes.get_ylim()
        axes.set_ylim(max(current[0], low - margin), min(current[1], high + margin))


class Channel(NamedTuple):
    """What a panel of a record shows: title, SI unit, and curves (time,) by name."""

    title: str
    unit: str
    curves: Mapping[str, np.ndarray]


def channels_of(record: xr.Dataset) -> list[Channel]:
    """What a record allows to be drawn: altitude, descent rate, wind."""
    made: list[Channel] = []

    def values(name: str, **pick: str) -> np.ndarray | None:
        if name not in record or not set(pick) <= set(record[name].dims):
            return None
        try:
            chosen = record[name].sel(pick) if pick else record[name]
        except KeyError:
            return None
        found = np.asarray(chosen.values, dtype=float)
        return found if found.ndim == 1 and np.isfinite(found).any() else None

    altitude = values("altitude")
    down = values("capsule_position", axis="down")
    if altitude is not None:
        made.append(Channel("Altitude", "m", {"altitude": altitude}))
    elif down is not None:
        made.append(Channel("Height above the origin", "m", {"height": -down}))
    rate = values("descent_rate")
    rate = values("capsule_velocity", axis="down") if rate is None else rate
    if rate is not None:
        made.append(Channel("Descent rate", "m/s", {"descent rate": rate}))
    wind = {axis: v for axis in ("north", "east") if (v := values("wind", axis=axis)) is not None}
    if wind:
        made.append(Channel("Wind, as given to the fit (moving towards)", "m/s", wind))
    return made


@styled
def recorded(axes: Axes, time: np.ndarray, shown: Channel, repairs: Sequence[Mapping[str, Any]] = ()) -> Axes:
    """A channel of a record over time, and where it was repaired.

    Args:
        axes: Where to draw.
        time: Of the samples (time,) [s].
        shown: From `channels_of`.
        repairs: List of {kind, variable, start, end} with times [s].
    """
    for (label, values), color in zip(shown.curves.items(), (BLUE, ORANGE, GREEN), strict=False):
        axes.plot(time, values, color=color, lw=1.1, label=label)
    for repair in repairs:
        start, end = repair.get("start"), repair.get("end")
        if is_number(start) and time.size:
            ends = np.clip([start, end if is_number(end) else start], time[0], time[-1])
            axes.axvspan(*ends, color=PURPLE, alpha=0.28, lw=0.8)
    if (count := len(shown.curves)) > 1:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=count, borderaxespad=0.1)
    axes.set(title=shown.title, ylabel=f"[{shown.unit}]")
    axes.margins(x=0)
    if shown.unit == "m/s":
        feet_axis(axes)
    return axes


@styled
def record_figure(record: xr.Dataset, repairs: Sequence[Mapping[str, Any]] = ()) -> Figure:
    """A record as it was used: altitude, descent rate, wind, and where it was repaired.

    Args:
        record: Record with dims (time, axis, ...).
        repairs: As of `recorded`.

    Returns:
        The figure; an empty figure if the record holds none of these.
    """
    shown = channels_of(record)
    if not shown:
        return Figure()
    figure, all_axes = sheet(0.55 + 1.45 * len(shown), len(shown), 1, sharex=True)
    time = np.asarray(record["time"].values, dtype=float)
    for axes, channel in zip(all_axes, shown, strict=True):
        recorded(axes, time, channel, repairs)
    time_axis(all_axes[-1], time[0])
    return figure


@styled
def variance(axes: Axes, shares: Mapping[str, xr.DataArray]) -> Axes:
    """Variance decomposition of the predictions by source: one stacked bar per flight and quantity.

    Args:
        axes: Where to draw.
        shares: Flight name to shares of variance with dims (source, quantity) [1].
    """
    bars = [(f, str(q), s.sel(quantity=q)) for f, s in shares.items() for q in s["quantity"].values]
    sources = list(dict.fromkeys(str(v) for s in shares.values() for v in s["source"].values))
    for row, (_, _, share) in enumerate(bars):
        left = 0.0
        for source in sources:
            value = float(share.sel(source=source)) if source in share["source"].values else 0.0
            if not math.isfinite(value) or value <= 0:
                continue
            color = SOURCES.get(source, PURPLE)
            axes.barh(row, value, left=left, color=color, height=0.66, ec="white", lw=0.8, label=source)
            if value > 0.04:
                color = "white" if source == "parameter" else INK
                axes.text(left + value / 2, row, f"{100 * value:.0f} %", ha="center", va="center", size=8, color=color)
            left += value
    several = len(shares) > 1
    axes.set_yticks(range(len(bars)), [f"{quantity_name(q)}{', ' + f if several else ''}" for f, q, _ in bars])
    axes.invert_yaxis()
    axes.grid(False)
    axes.set_xlim(0, 1.001)
    axes.set_xticks(np.linspace(0, 1, 6), [f"{v:.0f} %" for v in np.linspace(0, 100, 6)])
    return axes


@styled
def variance_figure(shares: Mapping[str, xr.DataArray]) -> Figure:
    """Variance decomposition of the predictions by source, with its legend; see `variance`."""
    figure, (axes,) = sheet(0.9 + 0.34 * sum(s.sizes["quantity"] for s in shares.values()))
    legend_of([variance(axes, shares)])
    return figure


@styled
def exceedance(axes: Axes, table: pd.DataFrame, limits: Sequence[float] = ()) -> Axes:
    """P(statistic of a quantity > threshold) with Clopper-Pearson limits, on a logarithmic axis; one curve per run.

    Args:
        axes: Where to draw.
        table: Rows of exceedance.csv of one quantity and statistic.
        limits: That are required of it (SI).
    """
    first = table.iloc[0]
    scale, unit = shown_unit(str(first["unit"]))
    for (run, curve), color in zip(table.groupby("run", sort=False), (BLUE, GREEN, PURPLE, ORANGE) * 9, strict=False):
        x = scale * curve["threshold"].to_numpy(dtype=float)
        bounds = [curve[f"clopper_pearson_{side}"].to_numpy(dtype=float) for side in ("low", "high")]
        axes.fill_between(x, np.maximum(bounds[0], 1e-9), bounds[1], color=color, alpha=0.22, lw=0)
        axes.plot(x, curve["probability"].replace(0, np.nan), color=color, lw=1.4, label=str(run))
    for limit in limits:
        axes.axvline(scale * limit, color=INK, lw=1.1, ls=(0, (5, 3)), label="required limit")
    axes.axhline(1.0, color=LINE, lw=0.7)
    axes.set_yscale("log")
    axes.set_ylim(max(0.3 / float(table["draws"].max()), 1e-5), 1.3)
    words = statistic_name(str(first["quantity"]), str(first["statistic"]))
    axes.set(title=words[0].upper() + words[1:].replace(", ", ",\n", 1), xlabel=f"threshold [{unit}]")
    axes.margins(x=0)
    return axes


@styled
def exceedance_figure(table: pd.DataFrame, limits: Mapping[tuple[str, str], Sequence[float]] | None = None) -> Figure:
    """Exceedance probabilities, one panel per quantity and statistic in the order of the table; see `exceedance`.

    Args:
        table: Frame of exceedance.csv, of the quantities and statistics to draw.
        limits: Quantity and statistic to the limits that are required of it (SI).
    """
    names = list(dict.fromkeys(zip(table["quantity"], table["statistic"], strict=True)))
    figure, all_axes = panels(len(names), 2, 0.5, 2.9, sharey=True)
    for axes, name in zip(all_axes, names, strict=True):
        part = table[(table["quantity"] == name[0]) & (table["statistic"] == name[1])]
        exceedance(axes, part, (limits or {}).get(name, ()))
    legend_of(all_axes)
    all_axes[0].set_ylabel("P(more than the threshold)")
    return figure
