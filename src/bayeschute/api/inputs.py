"""`Study`: flights, priors, noise and sizes of a study file; noise as such a file has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from bayeschute.api import html
from bayeschute.api.beliefs import Priors
from bayeschute.api.flight import Flight, Flights, flight_rows
from bayeschute.study.load import load_study
from bayeschute.study.schema.belief_schema import NoiseTable
from bayeschute.study.schema.schema_faults import validated
from bayeschute.study.schema.structure_schema import StructureTable
from bayeschute.study.schema.vehicle_schema import Vehicle
from bayeschute.study.study import Study as StudySpec
from bayeschute.study.templates import template


def noise(tables: Mapping[str, Any]) -> NoiseTable:
    """Noise of channels and latent disturbances, as ``[noise]`` of a study has them.

    Args:
        tables: By channel ``{"white": ..., "correlated": ..., "time_constant": ...}``, quantities with their units;
            latent disturbances such as ``wind`` likewise.

    Raises:
        InputError: With every fault.

    Example:
        >>> import bayeschute as bc
        >>> rate = {"white": "0.3 m/s", "correlated": "0.3 m/s", "time_constant": "3 s"}
        >>> bc.noise({"descent_rate": rate, "wind": {"vertical": "0.5 m/s", "time_constant": "30 s"}}).model
        'latent'
    """
    return validated(NoiseTable, "noise", dict(tables))


@dataclass(frozen=True, eq=False, repr=False)
class Study:
    """A validated study: flights, priors, noise model, sizes.

    Attributes:
        spec: Its tables, all numbers in SI.

    Example:
        >>> import bayeschute as bc
        >>> study = bc.Study.example()
        >>> study.flights["cdt-3-11"].roles
        ('structure', 'identify')
    """

    spec: StudySpec

    @classmethod
    def load(cls, path: Path | str, data: Path | str | None = None) -> Study:
        """Read a study file.

        Args:
            path: The file (TOML).
            data: Folder that replaces ``${DATA}`` in it.

        Raises:
            InputError: With every fault of the study, its vehicle and its records' paths.
        """
        return cls(load_study(path, data))

    @classmethod
    def example(cls) -> Study:
        """The virtual drop that comes with the package (`bayeschute init` copies its file)."""
        return cls(load_study(template("virtual.toml")))

    @property
    def title(self) -> str:
        """Its title."""
        return self.spec.title

    @cached_property
    def flights(self) -> Flights:
        """Its flights, by name or place."""
        return Flights([Flight.of_study(self.spec, flight) for flight in self.spec.flights])

    @property
    def vehicle(self) -> Vehicle | None:
        """The vehicle; None of a point mass."""
        return self.spec.vehicle

    @property
    def candidates(self) -> StructureTable | None:
        """Candidate terms and how they are searched; None of a point mass."""
        return self.spec.structure

    @property
    def priors(self) -> Priors:
        """Priors that the study gives from outside: risers, masses."""
        return Priors.of_study(self.spec)

    @property
    def noise(self) -> NoiseTable:
        """Noise of the channels and latent disturbances."""
        return self.spec.noise

    def quick(self) -> Study:
        """The study at small sizes, to see that all works; not for use."""
        from bayeschute.study.assembly.assemble import smaller

        return Study(smaller(self.spec))

    def __repr__(self) -> str:
        """Title, model and flights."""
        return f"Study({self.title!r}, {self.spec.model}, {len(self.flights)} flights, seed {self.spec.seed})"

    def _repr_html_(self) -> str:
        """The flights as a table."""
        head = ("flight", "roles", "record")
        return html.table(self.title, head, flight_rows(self.flights), f"model: {self.spec.model}")
