"""Figures of the pendulum studies: phase portraits, bistability, onset by wind shear, pivot point.

A function that takes axes draws one panel on them and returns them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bayeschute.reduced.behaviour import QUANTITIES, Bistability, Configuration, Onset, PivotSensitivity
from bayeschute.reduced.motion import Array, Motion
from bayeschute.reduced.planar import PlanarAero
from bayeschute.report.figures.canvas import (
    BLUE,
    GREEN,
    INK,
    LINE,
    ORANGE,
    SERIES,
    SHADE,
    SOFT,
    VERMILION,
    feet_axis,
    legend_of,
    sheet,
    styled,
)

_DEG = float(np.rad2deg(1.0))
_ENOUGH = 4000  # points of a curve


def _dots(axes: Axes, trim: float) -> None:
    """Equilibria of the angle of attack: stable filled, unstable open."""
    if trim > 0.0:
        axes.plot([-trim * _DEG, trim * _DEG], [0.0, 0.0], "o", color=BLUE, ms=6.0, zorder=4, label="stable trim")
        axes.plot([0.0], [0.0], "o", mfc="white", mec=VERMILION, mew=1.5, ms=6.0, zorder=4, label="unstable trim")
    else:
        axes.plot([0.0], [0.0], "o", color=BLUE, ms=6.0, zorder=4, label="stable trim")


@styled
def phase_portrait(axes: Axes, angle: Array, rate: Array, name: str) -> Axes:
    """Rate over angle, with its start and its end.

    Args:
        axes: Where to draw.
        angle: (time,) [rad].
        rate: (time,) [rad/s].
        name: Of the angle.
    """
    step = max(1, len(angle) // _ENOUGH)
    axes.plot(_DEG * angle[::step], _DEG * rate[::step], color=SOFT, lw=0.8)
    axes.plot(_DEG * angle[0], _DEG * rate[0], "s", color=ORANGE, ms=5.0, zorder=3, label="start")
    tail = slice(-min(len(angle), 600), None)
    axes.plot(_DEG * angle[tail], _DEG * rate[tail], color=INK, lw=1.5, zorder=2, label="last minute")
    axes.set(xlabel=f"{name} [deg]", ylabel=f"rate of {name} [deg/s]")
    return axes


@styled
def swing(axes: Axes, time: Array, angle: Array, color: str = BLUE) -> Axes:
    """Swing angle (time,) [rad] over time [s]."""
    axes.plot(time, _DEG * angle, color=color, lw=1.1)
    axes.set(xlabel="time [s]", ylabel="swing angle [deg]")
    axes.margins(x=0)
    return axes


@styled
def motion_figure(motion: Motion, trim: float, flipped_at: float | None = None) -> Figure:
    """Swing angle over time and phase portrait of the angle of attack (figures 7.1-8 and -9).

    Args:
        motion: One motion.
        trim: Trim angle of the canopies [rad].
        flipped_at: When the damping changed its sign [s], if it did.
    """
    figure, (left, right) = sheet(3.1, 1, 2)
    swing(left, motion.time, motion.swing).set_title("Swing angle")
    if flipped_at is not None:
        left.axvline(flipped_at, color=INK, lw=1.0, ls=(0, (5, 3)))
        left.annotate(
            "damping turned positive", (flipped_at, left.get_ylim()[1]), (4, -3), textcoords="offset points", va="top"
        )
    phase_portrait(right, motion.alpha, motion.alpha_rate, "angle of attack")
    right.set_title("Angle of attack of the canopies")
    _dots(right, trim)
    legend_of([right])
    return figure


def _name(one: Configuration) -> str:
    kinds = ("stable" if stable else "unstable" for stable in (one.statically_stable, one.dynamically_stable))
    static, dynamic = kinds
    return f"statically {static}, dynamically {dynamic}"


@styled
def configuration_figure(configurations: Sequence[Configuration]) -> Figure:
    """Phase portraits of swing angle and angle of attack, a row per design (figures 7.1-10..13)."""
    figure, all_axes = sheet(0.5 + 2.35 * len(configurations), len(configurations), 2)
    for row, one in enumerate(configurations):
        left, right = all_axes[2 * row : 2 * row + 2]
        phase_portrait(left, one.motion.swing, one.motion.swing_rate, "swing angle")
        phase_portrait(right, one.motion.alpha, one.motion.alpha_rate, "angle of attack")
        _dots(right, one.trim)
        end = one.ending
        if one.cycle is not None:
            end += f", {_DEG * one.cycle.amplitude:.1f} deg at {one.cycle.frequency:.3f} Hz"
        left.set_title(_name(one).capitalize())
        right.set_title(f"Ends in a {end}")
    legend_of(all_axes[1:2])
    return figure


@styled
def curves_figure(unstable: PlanarAero, stable: PlanarAero) -> Figure:
    """Static coefficients by angle of attack of two designs (figure 6.3.1-2)."""
    figure, (left, right) = sheet(2.8, 1, 2)
    alpha = np.linspace(-0.45, 0.45, 361)
    for aero, color, label in ((unstable, VERMILION, "statically unstable"), (stable, BLUE, "statically stable")):
        left.plot(_DEG * alpha, np.asarray(aero.normal(alpha)), color=color, lw=1.4, label=label)
        right.plot(_DEG * alpha, np.asarray(aero.axial(alpha)), color=color, lw=1.4)
    left.axhline(0.0, color=LINE, lw=0.8)
    for axes, title in ((left, "Normal force coefficient"), (right, "Axial force coefficient")):
        axes.set(title=title, xlabel="angle of attack [deg]")
        axes.margins(x=0)
    legend_of([left])
    return figure


@styled
def bistability(axes: Axes, found: Bistability) -> Axes:
    """Final amplitude of the swing by damping, a curve per disturbance of the glide."""
    order = np.argsort(found.damping)
    damping, both = found.damping[order], found.bistable()[order]
    if both.any():
        axes.axvspan(damping[both].min(), damping[both].max(), color=SHADE, lw=0, zorder=0, label="bistable")
    for j, (angle, color) in enumerate(zip(found.disturbance, SERIES * 9, strict=False)):
        axes.plot(
            damping, _DEG * found.amplitude[order, j], "o-", color=color, ms=3.5, lw=1.1,
            label=f"{_DEG * angle:.0f} deg",
        )  # fmt: skip
    axes.axvline(found.threshold, color=INK, lw=1.0, ls=(0, (5, 3)), label="linear threshold")
    axes.set(title="Final amplitude of a disturbed glide", xlabel=r"$C_{N\dot\alpha}$ [s/rad]")
    axes.set_ylabel("swing angle [deg]")
    return axes


@styled
def bistability_figure(found: Bistability) -> Figure:
    """Final amplitude of the swing by damping, with its legend; see `bistability`."""
    figure, (axes,) = sheet(3.3)
    legend_of([bistability(axes, found)])
    return figure


@styled
def onset_figure(found: Onset, shown: Sequence[tuple[int, int]] = ()) -> Figure:
    """Response to shear layers: final amplitude, time of onset, and some of the motions.

    Args:
        found: The study.
        shown: Motions to draw, as indices of change and thickness.
    """
    rows = 2 if shown else 1
    figure, all_axes = sheet(0.4 + 2.8 * rows, rows, 2)
    left, right = all_axes[:2]
    for j, (thickness, color) in enumerate(zip(found.thickness, SERIES * 9, strict=False)):
        label = f"{thickness:.0f} m thick"
        left.plot(found.change, _DEG * found.amplitude[:, j], "o-", color=color, ms=3.5, lw=1.1, label=label)
        right.plot(found.change, found.onset[:, j], "o", color=color, ms=4.0)
    left.set(title="Final amplitude", ylabel="swing angle [deg]")
    right.set(title=f"Time until the swing passes {_DEG * found.angle:.0f} deg", ylabel="time [s]")
    for axes in (left, right):
        axes.set_xlabel("change of the wind through the layer [m/s]")
    for axes, (i, j), color in zip(all_axes[2:], shown, (GREEN, VERMILION), strict=False):
        swing(axes, found.motion.time, found.motion.swing[:, i, j], color)
        axes.set_title(f"{found.change[i]:+.1f} m/s through {found.thickness[j]:.0f} m")
    legend_of([left])
    return figure


@styled
def pivot_figure(found: PivotSensitivity) -> Figure:
    """Pivot point, descent and limit cycle when payload mass, density or drag are scaled (F-1..F-4)."""
    figure, all_axes = sheet(5.2, 2, 2, sharex=True)
    panels = (
        ("Capsule to pivot point", "[m]", found.distance),
        ("Airspeed of the steady descent", "[m/s]", found.speed),
        ("Decay rate of the linear pendulum", "[1/s]", found.decay),
        ("Amplitude of the limit cycle", "[deg]", _DEG * found.swing),
    )
    for axes, (title, unit, values) in zip(all_axes, panels, strict=True):
        for name, curve, color in zip(QUANTITIES, values, SERIES, strict=False):
            axes.plot(found.factor, curve, "o-", color=color, ms=3.5, lw=1.1, label=name)
        axes.set(title=title, ylabel=unit)
    for axes, unit in zip(all_axes, ("ft", "ft/s"), strict=False):
        feet_axis(axes, unit)
    for axes in all_axes[2:]:
        axes.set_xlabel("factor on the quantity")
    legend_of(all_axes[:1])
    return figure
