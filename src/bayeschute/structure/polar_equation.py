"""Polar equation error: the report's C_A, C_Y and C_N on products of its explanatory variables (7.3-1 to -5).

The variables are evaluated along a reconstructed record (`bayeschute.records.reconstruct`); rates are those of the
airflow (6.1-8, -9). Where alpha_T vanishes its azimuth is undefined and rows are missing; the vector regression
(`bayeschute.regression.vector_equation`) has no such singularity.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayeschute.core.errors import Fault, InputError
from bayeschute.regression.stacked import Stack, stack_components
from bayeschute.structure.candidates import Pool, product_pool, spline
from bayeschute.structure.polar_names import OVERLAP, check_variable, factors, parse_spline

Array = NDArray[np.float64]
COEFFICIENTS = ("C_A", "C_Y", "C_N")


class PolarPool(NamedTuple):
    """The pool of candidates of one coefficient as given by a study.

    Attributes:
        variables: Explanatory variables, number 1 of the index first.
        order: Highest total order of their products.
        extra: Further products by name.
    """

    variables: tuple[str, ...]
    order: int = 2
    extra: tuple[str, ...] = ()


def polar_variables(made: xr.Dataset, canopy: int, length: float, speed: float) -> dict[str, Array]:
    """Explanatory variables of one canopy along a record.

    Args:
        made: Motion by `bayeschute.records.reconstruct`.
        canopy: From 0.
        length: Reference length l [m].
        speed: Reference speed V_o [m/s].

    Returns:
        Values by the names of `bayeschute.structure.polar_names`, (T,), NaN where they can't be had.
    """

    def of(name: str) -> Array:
        return np.asarray(made[name].values[:, canopy], dtype=np.float64)

    airspeed, alpha, distance, proximity = of("airspeed"), of("alpha_T"), of("D_prox"), of("phi_prox")
    with np.errstate(divide="ignore", invalid="ignore"):
        per_rate = length / (2.0 * airspeed)
    return {
        "speed": airspeed / speed - 1.0,
        "alpha": alpha,
        "alpha_rate": of("alpha_T_rate") * per_rate,
        "azimuth_rate": of("phi_a_rate") * np.sin(alpha) * per_rate,
        "q": of("dynamic_pressure"),
        "distance": distance,
        "closing": of("V_prox"),
        "overlap": spline(distance, 0.8, side="below"),
        "sin_proximity": np.sin(proximity),
        "cos_proximity": np.cos(proximity),
    }


def variable(name: str, values: Mapping[str, Array]) -> Array:
    """A variable or a spline of one, by its name.

    Raises:
        InputError: If the name is unknown.
    """
    if name in values:
        return np.asarray(values[name])
    wrong, made = check_variable(name), parse_spline(name)
    if wrong or made is None:
        raise InputError(Fault("polar variable", repr(name), wrong or "a known variable"))
    knot = float(np.deg2rad(made.knot)) if made.degrees else made.knot
    return np.asarray(spline(values[made.variable], knot, side=made.side, power=made.power))


def product(term: str, values: Mapping[str, Array]) -> Array:
    """A product of variables, by its name.

    Raises:
        InputError: If a factor is unknown.
    """
    try:
        parts = factors(term)
    except ValueError as error:
        raise InputError(Fault("polar term", repr(term), str(error))) from error
    some = next(iter(values.values()))
    out = np.ones_like(some)
    for base, power in parts:
        out = out * variable(base, values) ** power
    return out


def polar_candidates(pool: PolarPool, values: Mapping[str, Array]) -> Pool:
    """All candidates of a coefficient along a record.

    Args:
        pool: Variables, order and further terms.
        values: From `polar_variables`.

    Returns:
        The pool, whose indices are the report's.

    Raises:
        InputError: For unknown names, or the same variable twice (`overlap` and its spline among them).
    """
    named = {name: variable(name, values) for name in pool.variables}
    if len(named) < len(pool.variables) or {"overlap", OVERLAP} <= set(named):
        raise InputError(Fault("polar pool", "a variable twice", "each variable once"))
    return product_pool(named, pool.order, extra={term: product(term, values) for term in pool.extra})


def polar_problem(coefficient: str, pool: Pool, made: xr.Dataset, canopy: int) -> Stack:
    """Candidates and data of one polar coefficient of one canopy (from 0) as a regression.

    Raises:
        InputError: If the coefficient is unknown.
    """
    if coefficient not in COEFFICIENTS:
        raise InputError(Fault("polar coefficient", repr(coefficient), "one of " + ", ".join(COEFFICIENTS)))
    return stack_components(pool.matrix()[:, None, :], made[coefficient].values[:, canopy, None])
