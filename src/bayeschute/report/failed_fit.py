"""Report of a failed fit: the reason, what was tried, and the residuals of the best trajectory found."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from bayeschute.core.trees import load_tree
from bayeschute.posterior.best_path import BestPath
from bayeschute.records.record import VARIABLES
from bayeschute.report.figures.canvas import INK, SERIES, SHADE, VERMILION, sheet, styled, time_axis
from bayeschute.report.run_results import Results, entries, json_object, mappings, try_read
from bayeschute.report.structure_view import Draw
from bayeschute.report.tables.summary_tables import (
    Cell,
    Table,
    cells,
    digits_of,
    in_both_units,
    precision_of,
    table_of,
    unit_cell,
)
from bayeschute.report.wording import (
    MISSING,
    counted,
    is_number,
    listed,
    number,
    parameter_meaning,
    shown_unit,
    whole,
)

_UNITS = {name: variable.unit for name, variable in VARIABLES.items()} | {"capsule_attitude": "rad"}
_WIDE = 2.0  # residuals this many times the sensor noise are marked
_INSIDE = 1.6449  # standard deviations that hold 90 %
_MOST_LINES = 6


def is_failed(results: Results) -> bool:
    """Whether the fit of this run failed."""
    return bool(results.part("fit").get("reason"))


def _channel(output: str) -> str:
    """The channel of an output: ``capsule_velocity.east`` is of ``capsule_velocity``."""
    return re.split(r"[.\[\s]", output)[0]


def _residuals(results: Results) -> list[tuple[str, str, Mapping[str, Any]]]:
    """Flight, output and numbers of every row of residuals."""
    flights = entries(results.part("fit").get("residuals"))
    return [
        (flight, output, facts) for flight, outputs in flights.items() for output, facts in entries(outputs).items()
    ]


def _ratio(facts: Mapping[str, Any]) -> float | None:
    """Root mean square residual over the noise of the sensor; None where one of them is not known."""
    rms, noise = facts.get("rms"), facts.get("noise")
    return float(rms) / float(noise) if is_number(rms) and is_number(noise) and noise > 0 else None


def key_sentences(results: Results) -> list[str]:
    """The sentences of the header."""
    found = [str(results.part("fit")["reason"])]
    rows = [(ratio, flight, output) for flight, output, f in _residuals(results) if (ratio := _ratio(f)) is not None]
    if rows:
        ratio, flight, output = max(rows)
        found.append(
            f"The largest residuals of the best trajectory found are those of {output} on {flight}: "
            f"{number(ratio, 2)} times the sensor noise."
        )
    found.append(
        "There are no estimates, bands or risk numbers. The results that need no fit are given below: records, "
        "repairs, and the structure found by equation error."
    )
    return found


def residual_table(results: Results) -> Table | None:
    """Residuals of every output, compared with the sensor noise."""
    rows = []
    for flight, output, facts in _residuals(results):
        si = _UNITS.get(_channel(output), "1")
        rms, noise = (in_both_units(si, digits_of(facts, key)) for key in ("rms", "noise"))
        ratio = _ratio(facts)
        wide = "bad" if ratio is not None and ratio > _WIDE else ""
        name, samples = Cell(output, "code"), whole(facts.get("samples"))
        rows.append(cells(flight, name, samples, rms, noise, Cell(number(ratio, 2), wide), unit_cell(si)))
    columns = "Flight:text|Output:code|Samples:num|Residual, rms:num|Sensor noise, sd:num|Ratio:num|Unit:text"
    return table_of(columns, rows)


def parameter_table(facts: Mapping[str, Any]) -> Table | None:
    """Parameters at the point where the search stopped, and their priors."""
    rows = []
    for row in mappings(facts.get("parameters")):
        si = str(row.get("unit") or "1")
        name = str(row.get("name", MISSING))
        rows.append(
            cells(
                Cell(name, "code", parameter_meaning(name)),
                in_both_units(si, precision_of(row, "value", "standard_error"), "strong"),
                in_both_units(si, digits_of(row, "standard_error")),
                in_both_units(si, precision_of(row, "prior_mean", "prior_sd"), "muted"),
                in_both_units(si, digits_of(row, "prior_sd"), "muted"),
                unit_cell(si),
            )
        )
    return table_of("Parameter:text|Value:num|Standard error:num|Prior mean:num|Prior sd:num|Unit:text", rows)


def _outputs_by_channel(path: BestPath) -> dict[str, list[int]]:
    """Numbers of the outputs of every channel."""
    groups: dict[str, list[int]] = {}
    for i, name in enumerate(path.outputs):
        groups.setdefault(_channel(name), []).append(i)
    return groups


@styled
def residuals(axes: Axes, path: BestPath, channel: str) -> Axes:
    """Residuals of a channel over time; shaded: the range that would contain 90 % of the sensor noise.

    Args:
        axes: Where to draw.
        path: The best trajectory found for a record.
        channel: One of its channels.
    """
    columns = _outputs_by_channel(path)[channel]
    scale, unit = shown_unit(_UNITS.get(channel, "1"))
    noise = _INSIDE * scale * float(np.nanmax(path.noise[columns]))
    axes.axhspan(-noise, noise, color=SHADE, lw=0, zorder=0)
    for place, i in enumerate(columns):
        label = path.outputs[i][len(channel) :].strip(".[] ")
        axes.plot(path.time, scale * path.residual[:, i], color=SERIES[place % len(SERIES)], lw=0.9, label=label)
    axes.set(title=f"{channel.replace('_', ' ').capitalize()}: measured minus simulated", ylabel=f"[{unit or 1}]")
    if 1 < len(columns) <= _MOST_LINES:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(columns), borderaxespad=0.1)
    axes.margins(x=0)
    return axes


@styled
def defects(axes: Axes, path: BestPath) -> Axes:
    """Largest multiple-shooting defect of each step of the best trajectory found, relative to its tolerance."""
    axes.plot(path.time[1:], path.defect, color=VERMILION, lw=0.9)
    axes.axhline(1.0, color=INK, lw=0.8, ls=(0, (5, 3)))
    axes.set(title="Largest continuity defect of each step, relative to its tolerance", ylabel="[1]")
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0)
    return axes


@styled
def residual_figure(path: BestPath) -> Figure:
    """Residuals over time, one panel per channel, with the sensor noise; then the multiple-shooting defects, if any.

    Args:
        path: The best trajectory found for a record.
    """
    groups = _outputs_by_channel(path)
    loose = bool(np.nanmax(path.defect, initial=0.0) > 0.0)
    panels = len(groups) + loose
    figure, all_axes = sheet(0.6 + 1.55 * panels, panels, 1, sharex=True)
    for axes, channel in zip(all_axes, groups, strict=False):
        residuals(axes, path, channel)
    if loose:
        defects(all_axes[-1], path)
    time_axis(all_axes[-1], float(path.time[0]))
    figure.legend(handles=[Patch(color=SHADE, label="90 % range of the sensor noise")], loc="outside upper right")
    return figure


def _read_paths(file: Path) -> tuple[BestPath, ...]:
    return load_tree(file, tuple[BestPath, ...])


def view(results: Results, draw: Draw) -> dict[str, Any]:
    """Content of the section on the failed fit.

    Args:
        results: The run.
        draw: Saves a figure and returns what the template shows.
    """
    folder, absent = results.folder / "fit", [line for line in results.absent if line.startswith("structure.json")]
    facts = try_read(folder / "failed.json", json_object, absent, "no parameters of the best point are shown") or {}
    paths = try_read(folder / "failed.npz", _read_paths, absent, "no residuals are drawn") or ()
    pictures = []
    for i, path in enumerate(paths):
        channels = listed([name.replace("_", " ") for name in dict.fromkeys(map(_channel, path.outputs))])
        caption = f"{path.flight}: residuals of the best trajectory found. Shaded: the range that would contain 90 % "
        caption += "of the residuals if they were sensor noise alone."
        alt = f"Residuals of {channels} over time on {path.flight}; {counted(len(path.outputs), 'output')}."
        pictures.append(draw(residual_figure(path), f"failed-{i + 1}", alt, caption))
    tried = results.part("fit").get("tried")
    return {
        "tried": [str(line) for line in tried] if isinstance(tried, list) else [],
        "residuals": residual_table(results),
        "pictures": pictures,
        "parameters": parameter_table(facts),
        "absent": absent,
    }
