"""Aerodynamic curves of a posterior, with bands over the range that was flown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayeschute.aero.curve_names import CURVES
from bayeschute.api import html
from bayeschute.api.quantity import central
from bayeschute.core.errors import Fault, InputError
from bayeschute.report.wording import shown_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Curve:
    """A force coefficient as a curve: C_A(alpha), C_N(alpha), damping by rate, or the force between canopies.

    Of a canopy alone, in steady planar airflow at its reference speed in sea-level air, unless asked otherwise; what
    each curve is: `bayeschute.aero.curve_names`.

    Attributes:
        name: ``C_A``, ``C_N``, ``C_N_rate`` or ``proximity``.
        symbol: What it is over: ``alpha`` or ``D_prox``.
        unit: SI unit of the grid; the curve itself has no unit.
        grid: Where it is evaluated (point,).
        draws: Of the posterior (draw, point).
        prior: Of the prior (draw, point); None where it is not known.
        flown: Central 99 % of what the fitted flights flew; beyond it the curve is extrapolated.
        level: Probability in the band at every point.
        known: What the study says that others know of this curve.

    Example:
        >>> draws = np.array([[0.9, 0.8], [1.0, 0.8]])
        >>> curve = bc.Curve("C_A", "alpha", "rad", np.array([0.1, 0.3]), draws, None, (0.1, 0.3), 0.9, ())
        >>> curve.median
        array([0.95, 0.8 ])
        >>> curve
        Curve C_A over alpha from 5.73 to 17.19 deg (flown 5.73 to 17.19): 2 points, 2 draws
    """

    name: str
    symbol: str
    unit: str
    grid: Array
    draws: Array
    prior: Array | None
    flown: tuple[float, float]
    level: float
    known: tuple[Mapping[str, Any], ...] = ()

    def __post_init__(self) -> None:
        """Refuse a level that is no probability."""
        central(self.level)

    @property
    def median(self) -> Array:
        """Median at every point (point,)."""
        return np.asarray(np.median(self.draws, axis=0))

    @property
    def band(self) -> tuple[Array, Array]:
        """Ends of the central band at every point (point,) each."""
        return _ends(self.draws, self.level)

    @property
    def prior_band(self) -> tuple[Array, Array] | None:
        """Ends of the prior's central band (point,) each; None where it is not known."""
        return None if self.prior is None else _ends(self.prior, self.level)

    def at_level(self, level: float) -> Curve:
        """The curve with a band of another probability."""
        return replace(self, level=level)

    def to_frame(self) -> pd.DataFrame:
        """Grid, median, band and prior band as a table; a row a point. Angles in deg, and their column says so."""
        low, high = self.band
        scale, unit = shown_unit(self.unit)
        inside = (self.grid >= self.flown[0] - 1e-12) & (self.grid <= self.flown[1] + 1e-12)
        made = pd.DataFrame(
            {self._over: scale * self.grid, "low": low, "median": self.median, "high": high, "flown": inside}
        )
        if (before := self.prior_band) is not None:
            made = made.assign(prior_low=before[0], prior_high=before[1])
        made.attrs = {"curve": self.name, "level": self.level, "unit": unit or "1"}
        return made

    def plot(self, ax: Axes | None = None) -> Axes:
        """The curve with its band, the prior's, and what others know; dashed beyond the range flown.

        Args:
            ax: Where to; axes of a new figure where None (``.figure``).
        """
        from bayeschute.report.figures.canvas import axes_or_new
        from bayeschute.report.figures.curve_figures import curve as draw

        bands = {"posterior": (self.band[0], self.median, self.band[1])}
        if (before := self.prior_band) is not None and self.prior is not None:
            bands["prior"] = (before[0], np.median(self.prior, axis=0), before[1])
        words = f"{100 * self.level:g} %"
        drawn = draw(axes_or_new(ax), self.symbol, self.unit, self.grid, bands, self.flown, self.known, words=words)
        drawn.set_title(f"{self.name}: {CURVES[self.name].words}")
        drawn.legend(loc="best")
        return drawn

    @property
    def _over(self) -> str:
        """What it is over, with the unit as shown."""
        unit = shown_unit(self.unit)[1]
        return f"{self.symbol} [{unit}]" if unit else self.symbol

    def __repr__(self) -> str:
        """Curve, range and sizes."""
        scale, name = shown_unit(self.unit)
        low, high = (html.number(scale * float(end)) for end in (self.grid[0], self.grid[-1]))
        flown = " to ".join(html.number(scale * end) for end in self.flown)
        unit = f" {name}" if name else ""
        sizes = f"{self.grid.size} points, {len(self.draws)} draws"
        return f"Curve {self.name} over {self.symbol} from {low} to {high}{unit} (flown {flown}): {sizes}"

    def _repr_html_(self) -> str:
        """The band at a few points as a table."""
        rows = [
            (html.number(r.iloc[0]), html.number(r["median"]), f"{html.number(r['low'])} to {html.number(r['high'])}")
            for _, r in self.to_frame().iloc[:: max(1, self.grid.size // 6)].iterrows()
        ]
        head = (self._over, "median", f"central {100 * self.level:g} %")
        return html.table(repr(self), head, rows)


def _ends(draws: Array, level: float) -> tuple[Array, Array]:
    low, _, high = np.quantile(draws, central(level), axis=0)
    return low, high


def curve(
    name: str,
    posterior: Mapping[str, Array],
    prior: Mapping[str, Array] | None,
    ranges: Mapping[str, tuple[float, float]],
    known: Sequence[Mapping[str, Any]],
    level: float,
    points: int,
    over: tuple[float, float] | None,
    distance: float | None,
    speed: float,
    saturation: float | None = None,
) -> Curve:
    """A curve of a posterior; see `Posterior.curve`.

    Raises:
        InputError: If there is no such curve, no term of it, or a number makes no sense.
    """
    from bayeschute.aero.curves import Setting
    from bayeschute.study.aerodynamics.curve_bands import curve_draws, known_curves

    there = known_curves(list(posterior))
    if name not in CURVES:
        raise InputError(Fault("curve", repr(name), f"one of {', '.join(CURVES)}"))
    symbol, unit, _ = CURVES[name]
    if name not in there or symbol not in ranges:
        wanted = f"a curve of the posterior's terms: {', '.join(there) or 'it has none'}"
        raise InputError(Fault("curve", f"{name!r}, of which no term is in the posterior", wanted))
    faults = []
    if points < 2:
        faults.append(Fault("points", repr(points), "2 at least"))
    if over is not None and not 0.0 <= over[0] < over[1]:
        faults.append(Fault("over", repr(over), f"two increasing values of {symbol} from 0 [{unit}]"))
    if not speed > 0.0 or (distance is not None and not distance > 0.0):
        faults.append(Fault("distance, speed", f"{distance!r}, {speed!r}", "numbers > 0"))
    if faults:
        raise InputError(faults)
    low, high = over or ranges[symbol]
    made = curve_draws(name, posterior, prior, np.linspace(low, high, points), Setting(distance, speed, saturation))
    beside = tuple(k for k in known if k["kind"] == "curve" and k["target"] == name)
    return Curve(name, symbol, unit, made.grid, made.draws, made.prior, ranges[symbol], level, beside)
