"""Equivariant aerodynamic terms: one definition for the regression along a record and for the simulator.

A term is a product written with ``*``. The axial force coefficient is a sum of scalar terms; the transverse force
coefficient, a vector across the canopy axis, is a sum of vector terms: exactly one vector factor times scalars.
Signs are such that a positive coefficient means what its name says: ``e`` and ``angle`` restore, ``rate`` damps,
``repulsion`` pushes canopies apart (the force on a canopy is q S (-C_A x + transverse)).

| factor | meaning |
|---|---|
| ``1`` | constant |
| ``alpha``, ``alpha^2``, ... | total angle of attack [rad], which may level off (below) |
| ``q`` | dynamic pressure over that at the reference speed in sea-level air |
| ``speed`` | airspeed over reference speed, minus one |
| ``proximity(k)`` | (k - D_prox) where positive, summed over the other canopies |
| ``closing`` | V_prox [1/s], summed over the other canopies |
| ``restoring(deg)`` | ((alpha_T - deg) where positive)^2 (7.4-1) |
| ``(e.rate)``, ``(e.c)``, ``(c.rate)`` | scalar products of V_perp/abs(V), r l/(2 abs(V)) and c (no sign turned) |
| ``e`` | vector: -V_perp/abs(V), of length sin(alpha_T) |
| ``angle`` | vector: the same direction, of length alpha_T |
| ``rate`` | vector: -r l/(2 abs(V)) |
| ``c`` | vector: away from the other canopy |
| ``repulsion(k)`` | vector: c (k - D_prox) where positive |
| ``side`` | turns the vector factor by 90 degrees about the axis: x cross v |

Polynomials say nothing of angles that no record has: a fit's ``-25 alpha^4`` turns a canopy over that flies a little
further than the fitted one did. Where `CanopyFlow.saturation` states an angle h, alpha^2 in the powers is divided by
(1 + (alpha/h)^8)^(1/4): it levels off at h^2. So is ``(e.rate)``, since ``e*(e.rate)`` is of second order in e: beyond
h, force and damping go on in proportion to e and rate. The law is smooth, as the search of a mode wants it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache

import numpy as np

from bayeschute.aero.airflow import CanopyFlow, Neighbour
from bayeschute.aero.term_names import is_pairwise, parse_term
from bayeschute.core.array_library import library_of
from bayeschute.core.vectors import Component, Vec3, cross, dot

_TINY = 1e-12


@cache
def _split(name: str) -> tuple[str, ...]:
    return parse_term(name)


def _argument(factor: str) -> float:
    match = re.fullmatch(r"\w+\((.*)\)", factor)
    assert match is not None, factor
    return float(match.group(1))


def _alpha(squared: Component) -> Component:
    return library_of(squared).sqrt(squared + _TINY**2)


def _levelled(value: Component, flow: CanopyFlow) -> Component:
    """What is of second order in the angle of attack, so that it levels off at `flow.saturation`, if that is stated."""
    if flow.saturation is None:
        return value
    sqrt = library_of(flow.alpha_squared).sqrt
    return value / sqrt(sqrt(1.0 + (flow.alpha_squared / flow.saturation**2) ** 4))


def _positive(value: Component) -> Component:
    return library_of(value).maximum(value, 0.0)


def _zero(flow: CanopyFlow) -> Component:
    return library_of(flow.cos_alpha).zeros_like(flow.cos_alpha)


def _power(flow: CanopyFlow, power: int) -> Component:
    squared = _levelled(flow.alpha_squared, flow)
    return squared ** (power // 2) * (_alpha(squared) if power % 2 else 1.0)


def _sine_ratio(flow: CanopyFlow) -> Component:
    """alpha/sin(alpha), smooth at zero."""
    a2 = flow.alpha_squared
    library, small = library_of(a2), a2 < 1e-4
    a = library.sqrt(library.where(small, 1.0, a2))
    return library.where(small, 1.0 + a2 / 6.0 + 7.0 * a2 * a2 / 360.0, a / library.sin(a))


def _scalar(factor: str, flow: CanopyFlow, other: Neighbour | None) -> Component:
    if factor == "1":
        return library_of(flow.cos_alpha).ones_like(flow.cos_alpha)
    if factor == "q":
        return flow.q_ratio
    if factor == "speed":
        return flow.speed_ratio
    if factor == "(e.rate)":
        return _levelled(dot(flow.e, flow.rate), flow)
    if factor.startswith("alpha"):
        return _power(flow, int(factor[6:]) if "^" in factor else 1)
    if factor.startswith("restoring("):
        return _positive(_alpha(flow.alpha_squared) - np.deg2rad(_argument(factor))) ** 2
    assert other is not None, factor
    if factor.startswith("proximity("):
        return _positive(_argument(factor) - other.distance)
    if factor == "closing":
        return other.closing
    return dot(other.away, flow.e if factor == "(e.c)" else flow.rate)


def _vector(factor: str, flow: CanopyFlow, other: Neighbour | None) -> Vec3:
    if factor == "e":
        return -flow.e
    if factor == "angle":
        return -flow.e * _sine_ratio(flow)
    if factor == "rate":
        return -flow.rate
    assert other is not None, factor
    if factor == "c":
        return other.away
    return other.away * _positive(_argument(factor) - other.distance)


_VECTORS = ("e", "angle", "rate", "c")


def _is_vector(factor: str) -> bool:
    return factor in _VECTORS or factor.startswith("repulsion(")


def axial_term(name: str, flow: CanopyFlow) -> Component:
    """One term of the axial force coefficient along a record or at a state.

    Args:
        name: The term, e.g. ``"alpha^2"``.
        flow: Airflow, arrays (canopy, ...).

    Returns:
        Its value [-], shape of the flow's scalars.
    """

    def product(other: Neighbour | None) -> Component:
        value = library_of(flow.cos_alpha).ones_like(flow.cos_alpha)
        for factor in _split(name):
            value = value * _scalar(factor, flow, other)
        return value

    if not is_pairwise(name):
        return product(None)
    return sum((product(other) for other in flow.neighbours), _zero(flow))


def transverse_term(name: str, flow: CanopyFlow) -> Vec3:
    """One term of the transverse force coefficient, a vector across the canopy axis (NED components).

    Args:
        name: The term, e.g. ``"e*alpha^2"``.
        flow: Airflow, arrays (canopy, ...).

    Returns:
        Its components [-].
    """

    def product(other: Neighbour | None) -> Vec3:
        factors = _split(name)
        (vector,) = (factor for factor in factors if _is_vector(factor))
        value = _vector(vector, flow, other)
        if "side" in factors:
            value = cross(flow.axis, value)
        for factor in factors:
            if factor not in ("side", vector):
                value = value * _scalar(factor, flow, other)
        return value

    if not is_pairwise(name):
        return product(None)
    zero = _zero(flow)
    return sum((product(other) for other in flow.neighbours), Vec3(zero, zero, zero))


def axial_coefficient(names: Sequence[str], values: Sequence[Component], flow: CanopyFlow) -> Component:
    """C_A: the weighted sum of its terms."""
    total = _zero(flow)
    for name, value in zip(names, values, strict=True):
        total = total + axial_term(name, flow) * value
    return total


def transverse_coefficient(names: Sequence[str], values: Sequence[Component], flow: CanopyFlow) -> Vec3:
    """Transverse force coefficient: the weighted sum of its vector terms (NED components)."""
    zero = _zero(flow)
    total = Vec3(zero, zero, zero)
    for name, value in zip(names, values, strict=True):
        total = total + transverse_term(name, flow) * value
    return total
