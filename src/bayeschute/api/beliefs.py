"""`Structure` and `Priors`: the selected model structure and the prior distributions of a fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bayeschute.api import html
from bayeschute.likelihood.priors import Prior
from bayeschute.report.wording import shown_unit
from bayeschute.study.load import usual_study
from bayeschute.study.schema.belief_schema import GivenTable, PriorsTable
from bayeschute.study.schema.knowledge.knowledge_schema import KnowledgeTable
from bayeschute.study.schema.schema_faults import validated
from bayeschute.study.schema.structure_schema import StructureTable
from bayeschute.study.study import Study as StudySpec

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Structure:
    """Aerodynamic terms that equation error supports, how surely, and their estimates.

    Attributes:
        spec: The study it was selected for.
        found: Everything that is known of it, as ``structure.json`` of a run has it.
        text: Print-outs in the form of the report's section 7.

    Example:
        >>> structure = bc.Structure(study.spec, {"coefficients": {}}, "")
        >>> len(structure.table)
        0
    """

    spec: StudySpec
    found: Mapping[str, Any]
    text: str

    @property
    def table(self) -> pd.DataFrame:
        """The selected terms with estimate, standard error and the share of the replicates that select them."""
        rows = []
        for name, entry in self.found["coefficients"].items():
            shares = (entry.get("frequency") or {}).get("terms", {})
            for row in entry["selected"]:
                kept = {key: row[key] for key in ("term", "estimate", "se")}
                rows.append({"coefficient": name, **kept, "selected": shares.get(row["term"])})
        return pd.DataFrame(rows)

    @property
    def stability(self) -> dict[str, list[dict[str, Any]]]:
        """Whole structures that replicates of the record select, by coefficient, with their shares."""
        return {name: list(entry["structures"]) for name, entry in self.found["coefficients"].items()}

    def plot(self) -> Figure:
        """Predicted squared error over the number of terms, a panel per coefficient."""
        from bayeschute.report.figures.inference_figures import pse_figure

        return pse_figure(self.found["coefficients"])

    def __repr__(self) -> str:
        """The selected terms, a line per coefficient."""
        lines = (
            f"{name}: {', '.join(row['term'] for row in entry['selected'])}"
            for name, entry in self.found["coefficients"].items()
        )
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """The table."""
        rows = [(r.coefficient, r.term, html.number(r.estimate), html.number(r.se)) for r in self.table.itertuples()]
        return html.table("Structure", ("coefficient", "term", "estimate", "standard error"), rows)


@dataclass(frozen=True, eq=False, repr=False)
class Priors:
    """Priors of parameters, jointly Gaussian in their working coordinates (the value, or its logarithm).

    Attributes:
        parameters: One entry per parameter.
        table: Inflation, floor, and which parameters differ from drop to drop or canopy to canopy.
        candidates: Whether the fit searches over the terms of the structure or keeps them.
        found: Result of the structure selection that the priors were derived from, if any.
        known: External knowledge that these priors include (``[[knowledge]]`` with ``use = "prior"``).

    Example:
        >>> import bayeschute as bc
        >>> priors = bc.Study.example().priors
        >>> "riser_stiffness" in priors.names
        True
    """

    parameters: tuple[Prior, ...]
    table: PriorsTable
    candidates: StructureTable | None = None
    found: Mapping[str, Any] | None = None
    known: tuple[KnowledgeTable, ...] = ()

    @classmethod
    def from_structure(cls, structure: Structure, inflation: float | None = None) -> Priors:
        """Priors of aerodynamic coefficients by equation error, and by what the study says that others know.

        Args:
            structure: From `select_structure`.
            inflation: Times the standard errors of equation error; None: the study's.
        """
        from bayeschute.study.aerodynamics.known import informed
        from bayeschute.study.run.stage_data import of_structure

        table = structure.spec.priors
        table = table if inflation is None else table.model_copy(update={"inflation": float(inflation)})
        made = informed(
            structure.spec, of_structure(replace(structure.spec, priors=table), structure.found["coefficients"])
        )
        known = tuple(k for k in structure.spec.knowledge if k.use == "prior")
        return cls(tuple(made), table, structure.spec.structure, structure.found, known)

    @classmethod
    def of_study(cls, study: StudySpec) -> Priors:
        """Priors that a study gives from outside."""
        from bayeschute.study.run.stage_data import given_priors

        return cls(tuple(given_priors(study)), study.priors, study.structure)

    @classmethod
    def of(cls, *parameters: Prior) -> Priors:
        """Priors one by one.

        Example:
            >>> drag = bc.Prior("cds_over_mass", -2.0, 0.4, logarithmic=True, unit="m^2/kg", source="data sheet")
            >>> bc.Priors.of(drag).names
            ('cds_over_mass',)
        """
        return cls(parameters, PriorsTable())

    @classmethod
    def given(cls, *, source: str = "given", **parameters: Mapping[str, str | float]) -> Priors:
        """Priors in the units of their sources, as ``[priors.given]`` of a study file has them.

        Args:
            source: Where they come from, for tables and the report.
            **parameters: By name ``mean`` and ``sd``, or ``median`` and ``log_sd`` of a log-normal distribution, with
                their units. Riser stiffness and damping, `enclosed_air_factor` and `cds_over_mass` are log-normal with
                these moments, all others normal.

        Raises:
            InputError: With every fault.

        Example:
            >>> bc.Priors.given(cds_over_mass={"median": "0.13 m^2/kg", "log_sd": 0.4})
            cds_over_mass: 0.13 (0.06733 to 0.251) m^2/kg
        """
        from bayeschute.study.run.stage_data import given_priors

        table = PriorsTable(given=validated(GivenTable, "priors", parameters))
        made = given_priors(replace(usual_study("cluster"), priors=table))
        return cls(tuple(replace(p, source=source) for p in made), PriorsTable())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(p.name for p in self.parameters)

    def __or__(self, other: Priors) -> Priors:
        """Both; where a parameter is in both, the right one's."""
        kept = [p for p in self.parameters if p.name not in other.names]
        table = other.table.model_copy(update={"inflation": self.table.inflation, "floor": self.table.floor})
        candidates = self.candidates if self.candidates is not None else other.candidates
        known = (*self.known, *(k for k in other.known if k not in self.known))
        return Priors((*kept, *other.parameters), table, candidates, self.found or other.found, known)

    def __len__(self) -> int:
        """How many parameters."""
        return len(self.parameters)

    def _rows(self) -> list[tuple[str, str, str, str]]:
        rows = []
        for p in self.parameters:
            scale, unit = shown_unit(p.unit)
            ends = (float(p.value(np.asarray(p.centre + k * p.scale))) for k in (-1.645, 0.0, 1.645))
            low, middle, high = (html.number(scale * end) for end in ends)
            rows.append((p.name, middle, f"{low} to {high}", unit or "1"))
        return rows

    def __repr__(self) -> str:
        """A line per parameter."""
        rows = self._rows()
        return "\n".join(
            f"{name}: {middle} ({span}){'' if unit == '1' else ' ' + unit}" for name, middle, span, unit in rows
        )

    def _repr_html_(self) -> str:
        """Medians and central 90 % as a table."""
        return html.table("Priors", ("parameter", "median", "central 90 %", "unit"), self._rows())
