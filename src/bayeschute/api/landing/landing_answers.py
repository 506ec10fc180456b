"""Answers to questions about landings: a table, a figure and sentences each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING

import pandas as pd

from bayeschute.calibration.label import caveat
from bayeschute.core.errors import Fault, InputError
from bayeschute.landing.decisions.onset import Cell, placard_table
from bayeschute.landing.decisions.rare import Rare

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False, eq=False)
class Answer(ABC):
    """A table; sentences as its ``repr``, with what the posterior lacks.

    Attributes:
        table: The answer.
        failed_checks: Of the posterior: with one or more, nothing here has a level of trust.
        level: Of trust, of the posterior, as `Run.level` has it; empty: not asked.
    """

    table: pd.DataFrame
    failed_checks: tuple[str, ...] = field(default=(), kw_only=True)
    level: str = field(default="", kw_only=True)

    @property
    @abstractmethod
    def words(self) -> list[str]:
        """Sentences, the most important first."""

    def figure(self) -> Figure | None:
        """The whole answer as a figure of its own; None where there is none."""
        return None

    def __repr__(self) -> str:
        """All sentences, a line each."""
        return "\n".join(filter(None, (*self.words, caveat(self.failed_checks, self.level))))

    def _repr_html_(self) -> str:
        """The table."""
        doubt = caveat(self.failed_checks, self.level)
        table = self.table.to_html(index=False, float_format=lambda x: f"{x:.3g}")
        return f"{table}<p>{escape(doubt)}</p>" if doubt else str(table)


@dataclass(frozen=True, repr=False, eq=False)
class Sensitivity(Answer):
    """What drives landings: shares of the variance of every limited quantity, and of met or not met.

    Attributes:
        table: ``quantity``; ``kind``: ``first`` and ``total`` are Sobol's shares of groups (parameters, winds, start,
            gusts, canopies), ``shapley`` those of single parameters; ``source``; ``share``, NaN of a quantity that is
            the same in all landings; ``standard_error``, NaN where it is not known.
    """

    @property
    def words(self) -> list[str]:
        """Total shares, the greatest first, a line a quantity."""
        lines = []
        for name, part in self.table[self.table["kind"] == "total"].groupby("quantity", sort=False):
            if part["share"].isna().all():
                lines.append(f"{name}: the same in all landings, so that nothing drives it")
                continue
            some = part.sort_values("share", ascending=False)
            rows = zip(some["source"], some["share"], some["standard_error"], strict=True)
            lines.append(f"{name}, total shares: " + ", ".join(f"{s} {x:.2f} +- {e:.2f}" for s, x, e in rows))
        return lines

    def plot(self, quantity: str | None = None, kind: str = "total", ax: Axes | None = None) -> Axes:
        """Shares of one quantity, the greatest on top, on axes of your own or on new ones (``.figure``).

        Args:
            quantity: One of the table's; None: its first.
            kind: ``total``, ``first`` or ``shapley``.
            ax: Where to draw.

        Raises:
            InputError: If the table has no such rows.
        """
        from bayeschute.report.figures.canvas import axes_or_new
        from bayeschute.report.figures.landing_figures import tornado

        quantity = quantity or str(self.table["quantity"].iloc[0])
        part = self.table[(self.table["quantity"] == quantity) & (self.table["kind"] == kind)].set_index("source")
        if part.empty:
            known = ", ".join(dict.fromkeys(self.table["quantity"]))
            raise InputError(Fault("plot", f"{quantity!r}, {kind!r}", f"one of {known}; total, first or shapley"))
        errors = part["standard_error"].fillna(0.0).to_dict()
        return tornado(
            axes_or_new(ax), part["share"].to_dict(), errors, f"{quantity.replace('_', ' ')}: what drives it"
        )

    def figure(self) -> Figure:
        """Groups beside parameters, a row for each quantity."""
        from bayeschute.report.figures.landing_figures import drivers_figure

        return drivers_figure(self.table)


@dataclass(frozen=True, repr=False, eq=False)
class RareFailures(Answer):
    """P(a requirement is not met), however small.

    Attributes:
        table: ``requirement``, ``probability_not_met``, ``variation`` (its coefficient of variation), ``landings`` that
            were flown for it.
        found: The simulations, with the points that fail.
    """

    found: Mapping[str, Rare]

    @classmethod
    def of(cls, found: Mapping[str, Rare]) -> RareFailures:
        """From simulations by requirement."""
        rows = [(name, one.probability, one.variation, one.evaluations) for name, one in found.items()]
        table = pd.DataFrame(rows, columns=["requirement", "probability_not_met", "variation", "landings"])
        return cls(table, found)

    @property
    def words(self) -> list[str]:
        """A line a requirement."""
        rows = self.table.itertuples(index=False)
        return [f"{n}: P(not met) {p:.3g}, coefficient of variation {v:.2f}, {k} landings" for n, p, v, k in rows]


@dataclass(frozen=True, repr=False, eq=False)
class Placard(Answer):
    """P(pendulum) and go, no-go or can't tell by shear and payload.

    Attributes:
        table: A row a cell: verdict, P(pendulum) and P(met) of each requirement with their intervals.
        cells: A cell for each shear and payload.
    """

    cells: tuple[Cell, ...]

    @classmethod
    def of(cls, cells: Sequence[Cell]) -> Placard:
        """From cells."""
        return cls(placard_table(cells), tuple(cells))

    @property
    def words(self) -> list[str]:
        """A line a cell."""
        return [
            f"shear {c.shear:.3g} m/s, payload {c.capsule_mass:.5g} kg: {c.word}, pendulum {100 * c.pendulum.met:.0f} %"
            for c in self.cells
        ]

    def plot(self, ax: Axes | None = None) -> Axes:
        """The placard, on axes of your own or on new ones (``.figure``)."""
        from bayeschute.report.figures.canvas import axes_or_new
        from bayeschute.report.figures.landing_figures import onset_map

        return onset_map(axes_or_new(ax, 7.2, 1.4 + 0.7 * len({one.shear for one in self.cells})), self.cells)

    def figure(self) -> Figure:
        """The placard on a sheet of its own."""
        from bayeschute.report.figures.landing_figures import placard_figure

        return placard_figure(self.cells)


@dataclass(frozen=True, repr=False, eq=False)
class DropRanking(Answer):
    """Candidate drops, the most informative first.

    Attributes:
        table: ``candidate``; ``spread_now`` and ``spread_expected`` of P(met) over the posterior; ``shrinking``, one
            less their ratio; ``probit_sd_left``, the share of the standard deviation of P(met)'s probit that the drop
            would leave; ``information`` [nat]; for each parameter ``sd left of ...``, likewise of its own.
        interval: The parameter by whose interval they are ranked; None: by P(met).
        lost: Why other candidates can't be judged, by name.
    """

    interval: str | None = None
    lost: Mapping[str, str] = field(default_factory=dict)

    @property
    def words(self) -> list[str]:
        """A line a candidate."""
        lines = []
        for _, row in self.table.iterrows():
            left = ""
            if self.interval is not None:
                left = f", {100 * row[f'sd left of {self.interval}']:.0f} % of the sd of {self.interval} left"
            spread = f"spread of P(met) {row.spread_now:.3f} now, {row.spread_expected:.3f} expected after it"
            lines.append(f"{row.candidate}: {spread}{left}")
        return lines + [f"{name}: can't be judged: {why}" for name, why in self.lost.items()]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Expected shrinking by candidate, on axes of your own or on new ones (``.figure``)."""
        from bayeschute.report.figures.canvas import axes_or_new
        from bayeschute.report.figures.landing_figures import drop_values

        values, what = self._value
        return drop_values(axes_or_new(ax, 7.2, 1.2 + 0.35 * len(values)), values, what)

    def figure(self) -> Figure:
        """Expected shrinking by candidate on a sheet of its own."""
        from bayeschute.report.figures.landing_figures import design_figure

        return design_figure(*self._value)

    @property
    def _value(self) -> tuple[dict[str, float], str]:
        """What drops are ranked by, by candidate, and what it is of."""
        if self.interval is None:
            return dict(zip(self.table["candidate"], self.table["shrinking"], strict=True)), "spread of P(met)"
        left = self.table[f"sd left of {self.interval}"]
        return dict(zip(self.table["candidate"], 1.0 - left, strict=True)), f"sd of {self.interval}"
