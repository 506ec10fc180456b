"""Figures of records, predicted bands, variance decomposition and exceedance probabilities."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

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
    panels,
    sheet,
    styled,
)
from bayeschute.report.wording import is_number, quantity_name, shown_unit, statistic_name

BAND_UNITS = {
    "swing_angle": "rad",
    "descent_rate": "m/s",
    "sea_level_descent_rate": "m/s",
    "flyout_angle": "rad",
}
MOST_POINTS = 450  # of a band: one for every other pixel of the page
SOURCES = {"parameter": BLUE, "wind": SKY, "initial state": ORANGE, "canopy force": "#a7b0b8"}


def _spans(time: np.ndarray, flag: np.ndarray) -> Iterator[tuple[float, float]]:
    """Start and end [s] of every run of true values."""
    edges = np.flatnonzero(np.diff(np.r_[False, flag, False].astype(int)))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield float(time[start]), float(time[min(stop, len(time) - 1)])


def _shade_held_out(axes: Axes, bands: xr.Dataset) -> bool:
    """Shade the part that was not fitted, where only a part was; returns whether anything was shaded."""
    if "held_out" not in bands:
        return False
    flag = np.asarray(bands["held_out"].values, dtype=bool)
    if not flag.any() or flag.all():
        return False
    for start, end in _spans(np.asarray(bands["time"].values, dtype=float), flag):
        axes.axvspan(start, end, color=SHADE, lw=0, zorder=0)
    return True


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
def band_figure(bands: xr.Dataset, limits: Mapping[str, float] | None = None) -> Figure:
    """Predicted bands of one flight, with its true motion and record.

    Args:
        bands: Dataset with dims (quantile, time) per quantity, see the run folder.
        limits: Quantity to the limit that it must not exceed at any time (SI), drawn as a line.

    Returns:
        One panel per quantity over time.
    """
    names = band_quantities(bands)
    bands = bands.isel(time=slice(None, None, max(1, math.ceil(bands.sizes["time"] / MOST_POINTS))))
    figure, all_axes = sheet(0.7 + 2.15 * len(names), len(names), 1, sharex=True)
    time = np.asarray(bands["time"].values, dtype=float)
    shaded = False
    handles: dict[str, Any] = {}
    for axes, name in zip(all_axes, names, strict=True):
        si = str(bands[name].attrs.get("units") or BAND_UNITS.get(name, "1"))
        scale, unit = shown_unit(si)
        low, q25, median, q75, high = (scale * _curve(bands, name, q) for q in (0.05, 0.25, 0.5, 0.75, 0.95))
        handles["90 % band"] = axes.fill_between(time, low, high, color=BLUE, alpha=0.20, lw=0)
        handles["50 % band"] = axes.fill_between(time, q25, q75, color=BLUE, alpha=0.34, lw=0)
        handles["median"] = axes.plot(time, median, color=BLUE, lw=1.1)[0]
        if f"{name}_record" in bands:
            record = scale * np.asarray(bands[f"{name}_record"].values, dtype=float)
            if np.isfinite(record).any():
                dots = axes.plot(time, record, ".", color=INK, ms=3.2, alpha=0.6, mew=0, zorder=2.5)[0]
                dots.set_rasterized(True)
                handles["record"] = dots
        if f"{name}_truth" in bands:
            truth = scale * np.asarray(bands[f"{name}_truth"].values, dtype=float)
            handles["truth"] = axes.plot(time, truth, color=VERMILION, lw=1.3, zorder=3)[0]
        if limits and is_number(limits.get(name)):
            handles["required limit"] = axes.axhline(scale * limits[name], color=INK, lw=1.0, ls=(0, (5, 3)))
        shaded |= _shade_held_out(axes, bands)
        axes.set_title(quantity_name(name).capitalize())
        axes.set_ylabel(f"[{unit}]")
        _focus(axes, np.concatenate([low, high]))
        axes.margins(x=0)
        if si == "m/s":
            feet_axis(axes)
    all_axes[-1].set_xlabel("time [s]")
    if shaded:
        handles["held out of the fit"] = Patch(color=SHADE)
    figure.legend(list(handles.values()), list(handles), loc="outside upper right", ncols=len(handles), markerscale=2)
    return figure


def _focus(axes: Axes, values: np.ndarray) -> None:
    """Limit the axis to the band and its surroundings, so that outliers of a record don't flatten the curves."""
    finite = values[np.isfinite(values)]
    if finite.size:
        low, high = float(finite.min()), float(finite.max())
        margin = 0.35 * max(high - low, 1e-9)
        current = axes.get_ylim()
        axes.set_ylim(max(current[0], low - margin), min(current[1], high + margin))


def _series(record: xr.Dataset) -> list[tuple[str, str, list[tuple[str, np.ndarray]]]]:
    """Title, SI unit and curves of the panels that a record allows."""
    made: list[tuple[str, str, list[tuple[str, np.ndarray]]]] = []

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
        made.append(("Altitude", "m", [("altitude", altitude)]))
    elif down is not None:
        made.append(("Height above the origin", "m", [("height", -down)]))
    rate = values("descent_rate")
    rate = values("capsule_velocity", axis="down") if rate is None else rate
    if rate is not None:
        made.append(("Descent rate", "m/s", [("descent rate", rate)]))
    wind = [(axis, values("wind", axis=axis)) for axis in ("north", "east")]
    curves = [(axis, v) for axis, v in wind if v is not None]
    if curves:
        made.append(("Wind, as given to the fit (moving towards)", "m/s", curves))
    return made


@styled
def record_figure(record: xr.Dataset, repairs: Sequence[Mapping[str, Any]] = ()) -> Figure:
    """A record as it was used: altitude, descent rate, wind, and where it was repaired.

    Args:
        record: Record with dims (time, axis, ...).
        repairs: List of {kind, variable, start, end} with times [s].

    Returns:
        The figure; an empty figure if the record holds none of these.
    """
    shown = _series(record)
    if not shown:
        return Figure()
    figure, all_axes = sheet(0.55 + 1.45 * len(shown), len(shown), 1, sharex=True)
    time = np.asarray(record["time"].values, dtype=float)
    for axes, (title, unit, curves) in zip(all_axes, shown, strict=True):
        for (label, values), color in zip(curves, (BLUE, ORANGE, GREEN), strict=False):
            axes.plot(time, values, color=color, lw=1.1, label=label)
        for repair in repairs:
            start, end = repair.get("start"), repair.get("end")
            if is_number(start) and time.size:
                ends = np.clip([start, end if is_number(end) else start], time[0], time[-1])
                axes.axvspan(*ends, color=PURPLE, alpha=0.28, lw=0.8)
        if len(curves) > 1:
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(curves), borderaxespad=0.1)
        axes.set_title(title)
        axes.set_ylabel(f"[{unit}]")
        axes.margins(x=0)
        if unit == "m/s":
            feet_axis(axes)
    all_axes[-1].set_xlabel("time [s]")
    return figure


@styled
def variance_figure(shares: Mapping[str, xr.DataArray]) -> Figure:
    """Variance decomposition of the predictions by source.

    Args:
        shares: Flight name to shares of variance with dims (source, quantity) [1].

    Returns:
        One stacked bar per flight and quantity.
    """
    bars = [(f, str(q), s.sel(quantity=q)) for f, s in shares.items() for q in s["quantity"].values]
    figure, (axes,) = sheet(0.9 + 0.34 * len(bars))
    sources: list[str] = []
    for s in shares.values():
        sources += [str(v) for v in s["source"].values if str(v) not in sources]
    for row, (_, _, share) in enumerate(bars):
        left = 0.0
        for source in sources:
            value = float(share.sel(source=source)) if source in share["source"].values else 0.0
            if not math.isfinite(value) or value <= 0:
                continue
            axes.barh(row, value, left=left, color=SOURCES.get(source, PURPLE), height=0.66, ec="white", lw=0.8)
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
    patches = [Patch(color=SOURCES.get(s, PURPLE), label=s) for s in sources]
    figure.legend(handles=patches, loc="outside upper right", ncols=len(patches))
    return figure


@styled
def exceedance_figure(table: pd.DataFrame, limits: Mapping[tuple[str, str], Sequence[float]] | None = None) -> Figure:
    """P(statistic of a quantity > threshold) with Clopper-Pearson limits, on a logarithmic axis.

    Args:
        table: Frame of exceedance.csv, of the quantities and statistics to draw.
        limits: Quantity and statistic to the limits that are required of it (SI).

    Returns:
        One panel per quantity and statistic, in the order of the table, one curve per run.
    """
    names = list(dict.fromkeys(zip(table["quantity"], table["statistic"], strict=True)))
    figure, all_axes = panels(len(names), 2, 0.5, 2.9, sharey=True)
    for axes, name in zip(all_axes, names, strict=True):
        part = table[(table["quantity"] == name[0]) & (table["statistic"] == name[1])]
        scale, unit = shown_unit(str(part["unit"].iloc[0]))
        for (run, curve), color in zip(
            part.groupby("run", sort=False), (BLUE, GREEN, PURPLE, ORANGE) * 9, strict=False
        ):
            x = scale * curve["threshold"].to_numpy(dtype=float)
            bounds = [curve[f"clopper_pearson_{side}"].to_numpy(dtype=float) for side in ("low", "high")]
            axes.fill_between(x, np.maximum(bounds[0], 1e-9), bounds[1], color=color, alpha=0.22, lw=0)
            axes.plot(x, curve["probability"].replace(0, np.nan), color=color, lw=1.4, label=str(run))
        for limit in (limits or {}).get(name, ()):
            axes.axvline(scale * limit, color=INK, lw=1.1, ls=(0, (5, 3)), label="required limit")
        axes.set_yscale("log")
        axes.set_ylim(max(0.3 / float(part["draws"].max()), 1e-5), 1.3)
        words = statistic_name(*name)
        axes.set_title(words[0].upper() + words[1:].replace(", ", ",\n", 1))
        axes.set_xlabel(f"threshold [{unit}]")
        axes.margins(x=0)
    handles = {label: handle for a in all_axes for handle, label in zip(*a.get_legend_handles_labels(), strict=True)}
    figure.legend(list(handles.values()), list(handles), loc="outside upper right", ncols=len(handles))
    all_axes[0].set_ylabel("P(more than the threshold)")
    for axes in all_axes:
        axes.axhline(1.0, color=LINE, lw=0.7)
    return figure
