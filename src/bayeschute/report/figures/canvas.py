"""Style of the figures and how they are saved: one palette, one type size, no global pyplot state."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Sequence
from functools import partial, wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar
from urllib.parse import quote

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from bayeschute.core.files import write_whole
from bayeschute.report.wording import us_unit

P = ParamSpec("P")
T = TypeVar("T")

# Colours that colour-blind readers can distinguish (Okabe and Ito, 2008).
BLUE, SKY, VERMILION, ORANGE = "#0072B2", "#56B4E9", "#D55E00", "#E69F00"
GREEN, PURPLE = "#009E73", "#CC79A7"
INK, SOFT, LINE, SHADE = "#1f2933", "#66727f", "#d5dbe1", "#f0ece2"
SERIES = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILION)

_LONG = 10_000.0  # of a clock at a record's first sample, as GPS has [s]
_ROUND = 100.0  # steps of where ticks then count from [s]
WIDTH = 9.6  # [in], the width of the text at 100 %
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 8.6,
    "axes.titlesize": 9.0,
    "axes.titleweight": "semibold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8.6,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#8b96a1",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#e6eaee",
    "grid.linewidth": 0.7,
    "text.color": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.frameon": False,
    "legend.fontsize": 8.4,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.hashsalt": "bayeschute",
    "path.simplify_threshold": 0.2,
}


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Draw in the style of the report, without changing matplotlib's global settings."""

    @wraps(draw)
    def inside(*args: P.args, **kwargs: P.kwargs) -> T:
        with mpl.rc_context(STYLE):
            return draw(*args, **kwargs)

    return inside


def sheet(height: float, rows: int = 1, columns: int = 1, **kwargs: Any) -> tuple[Figure, list[Axes]]:
    """A figure of the report's width and its axes, row by row.

    Args:
        height: Height [in].
        rows: Rows of axes.
        columns: Columns of axes.
        **kwargs: For ``Figure.subplots``; ``width`` [in] replaces the report's.
    """
    layout = ConstrainedLayoutEngine(w_pad=0.07, h_pad=0.05)
    figure = Figure(figsize=(kwargs.pop("width", WIDTH), height), layout=layout)
    axes = figure.subplots(rows, columns, squeeze=False, **kwargs)
    return figure, list(axes.ravel())


def axes_or_new(axes: Axes | None, width: float = 6.0, height: float = 3.2) -> Axes:
    """Axes to draw on: those given, or else new ones in the style of the report on a sheet of their own.

    A notebook shows figures, and of axes their name only; new ones show their sheet.
    """
    if axes is not None:
        return axes
    with mpl.rc_context(STYLE):
        figure, (made,) = sheet(height, width=width)
    setattr(made, "_repr_png_", partial(png_of, figure))  # noqa: B010 - IPython asks for it, matplotlib has none
    return made


def png_of(figure: Figure) -> bytes:
    """The figure as a PNG."""
    drawn = io.BytesIO()
    with mpl.rc_context(STYLE):
        FigureCanvasAgg(_laid_out(figure)).print_png(drawn)
    return drawn.getvalue()


def panels(count: int, most: int, head: float, each: float, **kwargs: Any) -> tuple[Figure, list[Axes]]:
    """A figure of equal panels; places of the last row that are left over are empty.

    Args:
        count: Panels, at least one.
        most: In a row.
        head: Height beside that of the rows [in].
        each: Height of a row [in].
        **kwargs: As of `sheet`.
    """
    columns = min(count, most)
    rows = math.ceil(count / columns)
    figure, axes = sheet(head + each * rows, rows, columns, **kwargs)
    for empty in axes[count:]:
        empty.set_visible(False)
    return figure, axes[:count]


def legend_of(axes: Sequence[Axes], **kwargs: Any) -> None:
    """One legend above all axes of a figure, an entry per label.

    Args:
        axes: Those whose labels it explains.
        **kwargs: For ``Figure.legend``.
    """
    shown = {label: handle for a in axes for handle, label in zip(*a.get_legend_handles_labels(), strict=True)}
    axes[0].figure.legend(
        list(shown.values()), list(shown), loc="outside upper right", ncols=max(len(shown), 1), **kwargs
    )


def feet_axis(axes: Axes, unit: str = "ft/s") -> None:
    """A second axis in feet, of one in metres."""
    factor = us_unit("m")[0]
    axes.secondary_yaxis(
        "right", functions=(lambda v: np.asarray(v) * factor, lambda v: np.asarray(v) / factor)
    ).set_ylabel(f"[{unit}]")


def time_axis(axes: Axes, start: float) -> None:
    """Label an axis of times [s]; on a clock that had run for long at the first, ticks count from near there."""
    if abs(start) < _LONG:
        axes.set_xlabel("time [s]")
        return
    origin = _ROUND * math.floor(start / _ROUND)
    axes.xaxis.set_major_formatter(lambda time, _: f"{time - origin:g}")
    axes.set_xlabel(f"time after {origin:.0f} s on the record's clock [s]")


def literal(text: str) -> str:
    """A user's text as drawn: matplotlib would read what stands between dollar signs as mathematics, or fail on it."""
    return text.replace("$", r"\$")


_GEOMETRY = re.compile(r'(?<= )(?:d|x|y)="[^"]*"')
_DECIMALS = re.compile(r"\d+\.\d{3,}")
_LINE_ENDS = re.compile(r"\s*\n\s*")


_POLYGONS = re.compile(r'(?<= d=")(?:M [-\d. ]+(?:L [-\d. ]+)*(?:z ?)?)+(?=")')
_COMMAND = re.compile(r"([MLz])([^MLz]*)")


def lighter(svg: str) -> str:
    """The same SVG with coordinates to a hundredth of a point, which is less than is seen in print.

    Matplotlib writes six decimals, and every point of a line by itself; here each is told from the one before it.
    Scale factors of glyphs (``transform``) are left as they are.
    """

    def rounded(found: re.Match[str]) -> str:
        return _LINE_ENDS.sub(" ", _DECIMALS.sub(lambda number: f"{float(number[0]):.2f}", found[0]))

    return _POLYGONS.sub(_relative, _GEOMETRY.sub(rounded, svg))


def _relative(found: re.Match[str]) -> str:
    """Straight lines of a path, points after the first relative to the one before; in whole hundredths, so exactly."""
    made, at, before = list[str](), (0, 0), ""
    for command, numbers in _COMMAND.findall(found[0]):
        values = [round(100.0 * float(one)) for one in numbers.split()]
        for x, y in zip(values[::2], values[1::2], strict=True):
            to = (x, y) if command == "M" else (x - at[0], y - at[1])
            letter = {"M": "M", "L": "l"}[command]
            made.append(f"{' ' if letter == before == 'l' else letter}{to[0] / 100:g} {to[1] / 100:g}")
            at, before = (x, y), letter
        if command == "z":
            made.append("z")
            before = "z"
    return "".join(made)


def _laid_out(figure: Figure) -> Figure:
    """The figure with its layout fixed: it is computed once and reused for each format."""
    if isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine):
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
    return figure


def svg_of(figure: Figure) -> str:
    """The figure as the text of an SVG."""
    drawn = io.StringIO()
    with mpl.rc_context(STYLE):
        _laid_out(figure).set_dpi(150)  # of pictures in it
        FigureCanvasSVG(figure).print_svg(drawn, metadata={"Date": None})  # `savefig` would draw everything twice
    return lighter(drawn.getvalue())


def data_uri(svg: str) -> Markup:
    """An SVG as a data URI for an attribute in double quotes; over a quarter shorter than base64.

    Only what would end the attribute or mean something in HTML or in a URI is percent-encoded. Attributes of the SVG
    get single quotes, which matplotlib doesn't write.
    """
    plain = _LINE_ENDS.sub(" ", svg).replace("'", "&apos;").replace('"', "'")
    return Markup("data:image/svg+xml," + quote(plain, safe=" /=,;()-+.?@!$*[]{}<>:'"))


def save(figure: Figure, folder: Path, name: str) -> Path:
    """Write ``name.png`` (at about twice the screen's resolution) and ``name.svg``; returns the path of the SVG."""
    with mpl.rc_context(STYLE):
        _laid_out(figure).set_dpi(180)
        write_whole(folder / f"{name}.png", FigureCanvasAgg(figure).print_png)
    write_whole(folder / f"{name}.svg", partial(Path.write_text, data=svg_of(figure), encoding="utf-8"))
    return folder / f"{name}.svg"
