"""Plausibility of a record before any fit: channels compared by each law, and statistics relative to their limits.

A function that takes axes draws one panel on them and returns them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayeschute.atmosphere.standard import HIGHEST, LOWEST, STANDARD_GRAVITY, standard_density
from bayeschute.records.plausibility.evidence import Evidence, evidence_of, slope, turned
from bayeschute.records.plausibility.reading import FAULT, WARNING, Reading
from bayeschute.records.plausibility.vehicle_laws import attached
from bayeschute.records.plausibility.verdict import Verdict
from bayeschute.report.figures.canvas import BLUE, GREEN, INK, ORANGE, PURPLE, SHADE, SKY, VERMILION, sheet, styled

_LAG = 1.0  # over which a derivative is taken [s]
_AXES = ("north", "east", "down")
_COLORS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION)  # of canopies


class Curve(NamedTuple):
    """A line in a panel: label, times, values; those `derived` from other channels are dashed."""

    label: str
    time: np.ndarray
    values: np.ndarray
    color: str
    derived: bool = False


class Panel(NamedTuple):
    """A panel: title, unit, lines."""

    title: str
    unit: str
    curves: list[Curve]


def _velocities(e: Evidence, used: Evidence) -> list[Panel]:
    if e.velocity is None:
        return []
    k, found = e.samples(_LAG), []
    for j, axis in enumerate(_AXES):
        curves = [Curve("recorded", e.time, e.velocity[:, j], BLUE)]
        if e.position is not None:
            middle = e.time[:-k] + 0.5 * k * e.step
            curves.append(Curve("d(position)/dt", middle, slope(e.position[:, j], k, e.step), ORANGE, True))
        if e.wind is not None and j < 2:
            curves.append(Curve("wind", e.time, e.wind[:, j], GREEN))
        elif used.profile is not None and j < 2:
            curves.append(Curve("wind by altitude", used.time, used.profile[:, j], GREEN))
        found.append(Panel(f"Velocity {axis}", "m/s", curves))
    return found


def _canopy_velocities(e: Evidence) -> list[Panel]:
    if e.canopy_velocity is None:
        return []
    k, found = e.samples(_LAG), []
    for j, axis in enumerate(_AXES):
        curves = []
        for i, color in zip(range(e.canopy_velocity.shape[1]), _COLORS * 3, strict=False):
            curves.append(Curve(f"canopy {i + 1}", e.time, e.canopy_velocity[:, i, j], color))
            if e.canopies is not None:
                middle, moved = e.time[:-k] + 0.5 * k * e.step, slope(e.canopies[:, i, j], k, e.step)
                curves.append(Curve("d(position)/dt", middle, moved, color, True))
        found.append(Panel(f"Velocity of the canopies {axis}", "m/s", curves))
    return found


def _forces(e: Evidence) -> list[Panel]:
    if e.force is None:
        return []
    if e.attitude is None or e.velocity is None:
        return [
            Panel(
                "Size of the specific force",
                "m/s^2",
                [Curve("recorded", e.time, np.linalg.norm(e.force, axis=1), BLUE)],
            )
        ]
    k = e.samples(_LAG)
    middle = e.time[:-k] + 0.5 * k * e.step
    shown = slope(e.velocity, k, e.step) - np.array([0.0, 0.0, STANDARD_GRAVITY])
    said = turned(e.attitude, e.force)
    return [
        Panel(
            f"Specific force {axis}, turned by the attitude",
            "m/s^2",
            [
                Curve("recorded", e.time, said[:, j], BLUE),
                Curve("dv/dt less gravity", middle, shown[:, j], ORANGE, True),
            ],
        )
        for j, axis in enumerate(_AXES)
    ]


def _heights(e: Evidence) -> list[Panel]:
    curves = []
    if e.altitude is not None:
        curves.append(Curve("altitude", e.time, e.altitude, BLUE))
    if e.position is not None:
        curves.append(Curve("minus down", e.time, -e.position[:, 2], ORANGE, True))
    return [Panel("Altitude", "m", curves)] if curves else []


def _distances(e: Evidence) -> list[Panel]:
    if (apart := attached(e)) is None:
        return []
    length = np.linalg.norm(apart, axis=2)
    curves = [Curve(f"canopy {i + 1}", e.time, x, _COLORS[i % 6]) for i, x in enumerate(length.T)]
    if e.vehicle is not None:
        curves.append(Curve("risers", e.time[[0, -1]], np.full(2, e.vehicle.riser_length), INK, True))
    return [Panel("Distance of the canopies", "m", curves)]


def _rates(e: Evidence) -> list[Panel]:
    if e.rate is None:
        return []
    rates = zip("xyz", np.rad2deg(e.rate).T, (BLUE, ORANGE, GREEN), strict=True)
    return [Panel("Angular rate, body axes", "deg/s", [Curve(axis, e.time, x, color) for axis, x, color in rates])]


def _densities(e: Evidence) -> list[Panel]:
    height = e.height()
    if e.density is None or height is None:
        return []
    usual = standard_density(np.clip(height, LOWEST, HIGHEST))
    return [
        Panel(
            "Density",
            "kg/m^3",
            [Curve("recorded", e.time, e.density, BLUE), Curve("standard", e.time, usual, ORANGE, True)],
        )
    ]


def _cells(e: Evidence) -> list[Panel]:
    if e.tension is None:
        return []
    curves = [
        Curve(f"cell {i + 1}", e.time, x, c)
        for i, (x, c) in enumerate(zip(e.tension.T, (BLUE, ORANGE, GREEN, PURPLE) * 4, strict=False))
    ]
    if e.vehicle is not None:
        share = e.vehicle.mass * STANDARD_GRAVITY / e.vehicle.canopies
        curves.append(Curve("weight per riser", e.time[[0, -1]], np.full(2, share), INK, True))
    return [Panel("Load cells", "N", curves)]


def panels(e: Evidence, used: Evidence) -> list[Panel]:
    """What a record allows to be drawn: all of it, and the wind by altitude over the times used."""
    with np.errstate(invalid="ignore"):
        kinds: tuple[Callable[[Evidence], list[Panel]], ...] = (
            _heights,
            partial(_velocities, used=used),
            _canopy_velocities,
            _forces,
            _rates,
            _distances,
            _cells,
            _densities,
        )
        return [panel for kind in kinds for panel in kind(e)]


@styled
def plausibility_figure(
    verdict: Verdict, window: tuple[float, float] | None = None, record: xr.Dataset | None = None
) -> Figure:
    """The record with what its laws compare, and how far each law is from its limit.

    Args:
        verdict: What the laws say.
        window: Times used [s]; what lies outside is shaded. None: all.
        record: The whole record; None: only the times used are drawn.

    Returns:
        One panel a channel, two beside each other, and below a bar for every law.
    """
    used = verdict.evidence
    shown = panels(used if record is None else evidence_of(record, used.vehicle), used)
    laws = sorted(verdict.readings, key=lambda r: r.excess)
    rows = (len(shown) + 1) // 2
    tall = 0.17 * len(laws) + 0.7
    figure, (top, below) = sheet(1.6 * rows + tall, 2, 1, height_ratios=[max(1.6 * rows, 0.1), tall])
    place = top.get_subplotspec()
    top.remove()
    assert place is not None  # made by `sheet`
    grid = place.subgridspec(max(rows, 1), 2)
    for i, panel in enumerate(shown):
        channel(figure.add_subplot(grid[i // 2, i % 2]), panel, window)
    excess_by_law(below, laws)
    return figure


@styled
def excess_by_law(axes: Axes, readings: Sequence[Reading]) -> Axes:
    """How far each law is from its limit: a bar for every law, the first lowest."""
    excess = np.clip([r.excess for r in readings], 0.004, 30.0)
    colors = [VERMILION if x >= FAULT else ORANGE if x >= WARNING else BLUE for x in excess]
    axes.barh(range(len(readings)), excess, color=colors, height=0.7)
    axes.axvline(FAULT, color=INK, lw=1.0)
    axes.set_xscale("log")
    axes.set_yticks(range(len(readings)), [r.law for r in readings], fontsize=7)
    axes.set_title("Laws: statistic over its limit (1 and more is a fault)")
    axes.margins(y=0.01)
    return axes


@styled
def channel(axes: Axes, panel: Panel, window: tuple[float, float] | None = None) -> Axes:
    """A channel of a record with what its laws compare it with.

    Args:
        axes: Where to draw.
        panel: From `panels`.
        window: Times used [s]; what lies outside is shaded. None: all.
    """
    for curve in panel.curves:
        every = max(1, curve.time.size // 2000)
        style = {"lw": 0.9, "ls": (0, (4, 2))} if curve.derived else {"lw": 1.0}
        axes.plot(curve.time[::every], curve.values[::every], color=curve.color, label=curve.label, **style)
    if window is not None:
        low, high = axes.get_xlim()
        for start, end in ((low, window[0]), (window[1], high)):
            if end > start:
                axes.axvspan(start, end, color=SHADE, lw=0, zorder=0)
        axes.set_xlim(low, high)
    axes.set(title=panel.title, ylabel=f"[{panel.unit}]")
    if len(panel.curves) > 1:
        axes.legend(loc="best", fontsize=7)
    return axes
