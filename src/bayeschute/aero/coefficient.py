"""Names of aerodynamic coefficients as parameters: ``axial[alpha^2]``, and of one canopy ``axial[1]@drop.canopy2``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

KINDS = ("axial", "transverse")
APPARENT_MASS = "enclosed_air_factor"
"""The parameter that is a canopy's apparent mass over that of the air that the vehicle's canopies enclose."""
_NAME = re.compile(
    rf"(?P<kind>{'|'.join(KINDS)})\[(?P<term>[^\[\]]*)\](?:@(?P<flight>.+?))?(?:\.canopy(?P<canopy>[1-9]\d*))?"
)


class Terms(Protocol):
    """Names of the terms of both kinds of force."""

    @property
    def axial(self) -> Iterable[str]:
        """Of the axial force."""

    @property
    def transverse(self) -> Iterable[str]:
        """Of the transverse force."""


@dataclass(frozen=True)
class Coefficient:
    """A coefficient of a term of a canopy's force.

    Attributes:
        kind: One of `KINDS`.
        term: Name of the term, see `bayeschute.aero.terms`.
        flight: The flight whose own it is; None: all flights share it, or its flight is known from elsewhere.
        canopy: The canopy whose own it is, counted from 1; None: all canopies share it.
    """

    kind: str
    term: str
    flight: str | None = None
    canopy: int | None = None

    def __str__(self) -> str:
        """The parameter's name, which `parse` reads."""
        flight = "" if self.flight is None else f"@{self.flight}"
        canopy = "" if self.canopy is None else f".canopy{self.canopy}"
        return f"{self.kind}[{self.term}]{flight}{canopy}"

    @classmethod
    def parse(cls, name: str) -> Coefficient | None:
        """The coefficient that a parameter's name says; None of another parameter."""
        found = _NAME.fullmatch(name)
        if found is None:
            return None
        canopy = found["canopy"]
        return cls(found["kind"], found["term"], found["flight"], None if canopy is None else int(canopy))

    @property
    def shared(self) -> Coefficient:
        """The coefficient of all flights and canopies."""
        return Coefficient(self.kind, self.term)

    @property
    def is_shared(self) -> bool:
        """Whether it is that of all flights and canopies."""
        return self == self.shared

    def of(self, flight: str | None, canopy: int) -> Coefficient:
        """That of one canopy, counted from 1, of a flight."""
        return replace(self, flight=flight, canopy=canopy)


def is_coefficient(name: str) -> bool:
    """Whether a parameter is a coefficient, of one canopy or of all."""
    return Coefficient.parse(name) is not None


def shared_name(name: str) -> str:
    """Name of a coefficient without flight and canopy; names of other parameters are returned unchanged."""
    found = Coefficient.parse(name)
    return name if found is None else str(found.shared)


def coefficient_names(terms: Terms) -> list[str]:
    """Names of the coefficients of some terms, axial ones first."""
    return [str(Coefficient(kind, term)) for kind in KINDS for term in getattr(terms, kind)]


def terms_of(names: Sequence[str]) -> tuple[list[str], list[str], list[int]]:
    """Axial and transverse terms among parameters, and where their coefficients stand among these, in that order."""
    found: dict[str, list[tuple[str, int]]] = {kind: [] for kind in KINDS}
    for i, name in enumerate(names):
        one = Coefficient.parse(name)
        if one is not None and one.is_shared:
            found[one.kind].append((one.term, i))
    places = [i for kind in found.values() for _, i in kind]
    return [term for term, _ in found["axial"]], [term for term, _ in found["transverse"]], places
