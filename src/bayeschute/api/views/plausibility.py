"""Physical plausibility of a record: what `Flight.plausibility` returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import pandas as pd
import xarray as xr

from bayeschute.api import html
from bayeschute.records.plausibility.reading import accepts
from bayeschute.records.plausibility.verdict import Finding, Verdict
from bayeschute.report.wording import counted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLUMNS = ["law", "tests", "got", "wanted", "excess", "severity", "likely cause"]


@dataclass(frozen=True, eq=False, repr=False)
class Plausibility:
    """Physical laws tried on a record: kinematics, attitude, forces, air, wind, sizes.

    Attributes:
        name: The flight.
        verdict: Every law that could be tried, those that are broken, and the mistakes that explain it.
        record: The record that was judged, as read.
        accepted: Laws, or groups of them, that the flight may break.
        noise: Where the noise that a fit would begin with is far from what the record shows, and what to say instead;
            of a flight whose noise is not said yet, what the record shows.

    Example:
        >>> looked = bc.Study.example().flights[0].plausibility()
        >>> looked.causes
        ()
    """

    name: str
    verdict: Verdict
    record: xr.Dataset
    accepted: tuple[str, ...] = ()
    noise: tuple[str, ...] = ()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Laws that are broken, or nearly; faults first."""
        return self.verdict.findings

    @property
    def causes(self) -> tuple[str, ...]:
        """Mistakes that together explain what is broken, the one that explains most first."""
        return self.verdict.causes

    @property
    def ok(self) -> bool:
        """Whether no law is broken but those that the flight accepts."""
        return all(accepts(self.accepted, one.law) for one in self.verdict.faults)

    @property
    def table(self) -> pd.DataFrame:
        """Every law that could be tried, the worst first; excess 1 and more is a fault."""
        told = {one.law: one for one in self.findings}
        rows = [
            (r.law, r.tests, r.got, r.wanted, r.excess, told[r.law].severity if r.law in told else "",
             told[r.law].likely if r.law in told else "")
            for r in sorted(self.verdict.readings, key=lambda r: -r.excess)
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=_COLUMNS).set_index("law")

    def plot(self) -> Figure:
        """The record with what its laws compare, and how far each law is from its limit."""
        from bayeschute.report.figures.plausibility_figures import plausibility_figure

        return plausibility_figure(self.verdict)

    def __repr__(self) -> str:
        """What is wrong, in a line or two, and what is told of the noise."""
        noise = [f"  noise: {line}" for line in self.noise]
        if not self.findings:
            return "\n".join([f"Plausibility of {self.name}: {len(self.verdict.readings)} laws kept", *noise])
        faults, warnings = counted(len(self.verdict.faults), "fault"), counted(len(self.verdict.warnings), "warning")
        lines = [f"Plausibility of {self.name}: {faults}, {warnings}"]
        do = {one.likely: one.do for one in reversed(self.findings)}
        lines += [f"  likely: {cause}. {do.get(cause, '')}".rstrip() for cause in self.causes]
        lines += [f"  {one.severity}: {one.tests}: {one.got}, wanted {one.wanted}" for one in self.findings]
        return "\n".join([*lines, *noise])

    def _repr_html_(self) -> str:
        """The laws as a table."""
        table = self.table.reset_index()
        rows = [[html.number(x) if isinstance(x, float) else x for x in row] for row in table.itertuples(index=False)]
        note = f"likely: {'; '.join(self.causes)}" if self.causes else ""
        note = "; ".join(part for part in (note, *self.noise) if part)
        return html.table(f"Plausibility of {self.name}", list(table.columns), rows, note)
