"""Tables of a study on the structure of the aerodynamics: `[structure]`, `[structure.polar]` and `[synthetic]`."""

from __future__ import annotations

from math import comb
from typing import Annotated, Literal, TypeVar

from pydantic import AfterValidator

from bayeschute.aero.published import COEFFICIENTS, published_names
from bayeschute.aero.term_names import check_axial, check_transverse
from bayeschute.structure.candidates import exponent_tuples, product_name
from bayeschute.structure.polar_names import canonical, check_term, check_variable
from bayeschute.study.schema.quantities import (
    Name,
    NoiseCeiling,
    NotNegativeTime,
    PositiveNumber,
    each,
    one_of,
    whole,
)
from bayeschute.study.schema.reading.strict import Strict, refuse, rule

T = TypeVar("T")
MOST_CANDIDATES = 20_000
POLAR = COEFFICIENTS["polar"]
Source = Literal["colored", "smoothing", "variance"]


def distinct(values: tuple[T, ...]) -> tuple[T, ...]:
    """At least one value, none twice."""
    if not values:
        refuse("one at least", "an empty list")
    if len(set(values)) < len(values):
        refuse("each only once", f"{max(values, key=values.count)!r} more than once")
    return values


def _distinct_variables(names: tuple[str, ...]) -> tuple[str, ...]:
    distinct(tuple(canonical(name) for name in names))
    return distinct(names)


_AXIAL = each(check_axial, "terms of the axial coefficient, such as 'alpha^2' or 'q'")
_TRANSVERSE = each(check_transverse, "terms of the transverse coefficient, such as 'e*alpha^2' or 'rate'")
_VARIABLES = each(check_variable, "polar variables such as 'alpha', 'q' or '(1.2-distance)_+'")
_PRODUCTS = each(check_term, "products of polar variables, such as 'alpha^3' or 'q*distance'")
PolarTerms = Annotated[tuple[str, ...], _PRODUCTS, AfterValidator(lambda terms: distinct(terms) if terms else terms)]


class PolarPoolTable(Strict):
    """Candidates of one polar coefficient: products of explanatory variables.

    Attributes:
        variables: Explanatory variables, splines among them; number 1 of the index first.
        order: Highest total order of their products.
        extra: Further products.
        first: Candidates that are selected first and always kept, such as the constant.
    """

    variables: Annotated[tuple[str, ...], _VARIABLES, AfterValidator(_distinct_variables)]
    order: Annotated[int, whole(0, 9)] = 2
    extra: PolarTerms = ()
    first: PolarTerms = ()

    @rule
    def _is_a_pool(self) -> None:
        count = comb(len(self.variables) + self.order, self.order) + len(self.extra)
        if count > MOST_CANDIDATES:
            got = f"{count:,} candidates"
            refuse(f"at most {MOST_CANDIDATES:,} candidates", got, "Lower the order or name fewer variables.")
        known = self.candidates()
        lacking = [term for term in self.first if canonical(term) not in known]
        if lacking:
            refuse("first terms that are candidates", f"{lacking}")
        doubled = [term for term in self.extra if canonical(term) in set(list(known)[: count - len(self.extra)])]
        if doubled:
            refuse("extra terms that the products don't hold already", f"{doubled}")

    def candidates(self) -> dict[tuple[tuple[str, int], ...], str]:
        """Names of all candidates by their canonical form."""
        products = (product_name(self.variables, row) for row in exponent_tuples(len(self.variables), self.order))
        return {canonical(name): name for name in (*products, *self.extra)}


class PolarTable(Strict):
    """Pools of the report's polar coefficients; one left out is not searched for."""

    C_A: PolarPoolTable | None = None
    C_Y: PolarPoolTable | None = None
    C_N: PolarPoolTable | None = None

    def pools(self) -> dict[str, PolarPoolTable]:
        """Pools by coefficient."""
        return {name: pool for name in POLAR if (pool := getattr(self, name)) is not None}


class SigmaTable(Strict):
    """Standard deviations of the noise that are given instead of found [unit of the coefficient: 1]."""

    axial: PositiveNumber | None = None
    transverse: PositiveNumber | None = None
    C_A: PositiveNumber | None = None
    C_Y: PositiveNumber | None = None
    C_N: PositiveNumber | None = None


CORE = ("axial[1]", "axial[alpha^2]", "transverse[e]", "transverse[e*alpha^2]", "transverse[rate]")
"""Drag, normal force and damping: the least model that swings, and that swings no further than it should."""


class StructureTable(Strict):
    """Selection of the aerodynamic structure.

    Attributes:
        canopies: Canopies it is identified on, from 1; the others check it. May be left out where there is only one.
        axial: Candidate terms of the axial coefficient.
        transverse: Candidate terms of the transverse coefficient.
        sigma_max: Noise ceiling sigma_max^2 of the predicted squared error, as a multiple of sigma^2.
        noise: Where sigma^2 comes from: residuals and their memory, Fourier smoothing, or the data's own variance.
        sigma: Standard deviations that are given instead, by coefficient.
        penalty_factor: f of the predicted squared error; the report's equation has 1, its printed table fits 2 only.
        exchange: Whether terms are exchanged after the selection as long as that lowers the predicted squared error.
        fit: What the simulated flight is fitted with: ``selected`` terms, and those left out that it then asks for; or
            the whole ``pool``, for a small one: what a record can't tell apart then widens intervals, whichever terms
            equation error took; or ``search``: all candidates are fitted to the flight once, and those are kept that
            its evidence asks for, whatever equation error selected.
        saturate: Where powers of the angle of attack level off in all terms, at an angle that few samples of the record
            exceed: a polynomial says nothing of angles that are hardly flown. ``always``; ``auto``, in a ``search``:
            where simulations of the fitted flights with the whole library are lost; None: nowhere.
        core: Terms that ``search`` always keeps, ``axial[...]`` and ``transverse[...]``.
        replicates: Moving-block bootstrap replicates for the selection stability; 0 for none.
        stack: How many structures are fitted to the flight, the selected one and those that replicates select most
            often; predictions mix them by weight. None: the selected one alone.
        polar: Pools of the report's polar coefficients, searched besides.
    """

    canopies: Annotated[tuple[Annotated[int, whole(1, 12)], ...], AfterValidator(distinct)] = (1,)
    axial: Annotated[tuple[str, ...], _AXIAL, AfterValidator(distinct)]
    transverse: Annotated[tuple[str, ...], _TRANSVERSE, AfterValidator(distinct)]
    sigma_max: NoiseCeiling = 25.0
    noise: Source = "colored"
    sigma: SigmaTable = SigmaTable()
    penalty_factor: PositiveNumber = 2.0
    exchange: bool = False
    fit: Literal["search", "pool", "selected"] = "selected"
    saturate: Literal["auto", "always"] | None = None
    core: Annotated[tuple[str, ...], AfterValidator(distinct)] = CORE
    replicates: Annotated[int, whole(0, 100_000)] = 100
    stack: Annotated[int, whole(2, 20)] | None = None
    polar: PolarTable = PolarTable()

    @rule
    def _can_saturate(self) -> None:
        if self.saturate == "auto" and self.fit != "search":
            do = 'Say fit = "search", or saturate = "always".'
            refuse('fit = "search" beside saturate = "auto"', f'saturate = "auto" with fit = "{self.fit}"', do)

    @rule
    def _can_stack(self) -> None:
        if self.stack is not None and self.fit != "selected":
            do = 'Say fit = "selected", or remove stack.'
            refuse("a stack of selected structures", f'stack together with fit = "{self.fit}", one structure', do)
        if self.stack is not None and self.replicates == 0:
            refuse("replicates, which select the structures of the stack", "stack together with replicates = 0")


class SnrTable(Strict):
    """Root mean square of the sum of terms over the standard deviation of the noise, by polar coefficient."""

    C_A: PositiveNumber | None = None
    C_Y: PositiveNumber | None = None
    C_N: PositiveNumber | None = None

    @rule
    def _has_one(self) -> None:
        if not self.by_name():
            refuse("one at least of C_A, C_Y, C_N", "an empty table")

    def by_name(self) -> dict[str, float]:
        """Ratios by coefficient."""
        return {name: value for name in POLAR if (value := getattr(self, name)) is not None}


class SyntheticTable(Strict):
    """Simulation study: synthetic data with published terms on a flight's motion, to test the structure selection.

    Attributes:
        published: Name of a published polar set, see `bayeschute.aero.published`.
        reading: Reading of its signs.
        flight: Flight whose variables are used; None: the first with the role ``structure``.
        canopy: Canopy whose variables are used, from 1.
        snr: Signal-to-noise ratios.
        time_constant: Of the noise [s]; 0 for white noise.
        replicates: Number of replicates, each with independent noise.
    """

    published: Annotated[str, one_of(*published_names())]
    reading: Name = "conventional"
    flight: Name | None = None
    canopy: Annotated[int, whole(1, 12)] = 1
    snr: SnrTable
    time_constant: NotNegativeTime
    replicates: Annotated[int, whole(2, 100_000)] = 50
