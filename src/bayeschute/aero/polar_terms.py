"""Terms of the report's polar form (7.3-2..5), evaluated on the airflow of canopies.

Signs are those of section 6.3.3: C_A and C_N are positive for drag and restoring force, C_Y along y = z cross x. The
angle of proximity runs from the airflow across the axis to the direction away from the other canopy (6.1-13).

| factor | meaning |
|---|---|
| ``1`` | constant |
| ``q`` | dynamic pressure [Pa] |
| ``speed`` | airspeed over reference speed, minus one |
| ``alpha`` | alpha_T [rad] |
| ``alpha_rate`` | alpha_T' l/(2 V) |
| ``azimuth_rate`` | phi_a' sin(alpha_T) l/(2 V) |
| ``distance`` | D_prox |
| ``overlap`` | (0.8 - D_prox) where positive |
| ``sin_proximity``, ``cos_proximity`` | of the angle of proximity |

``^2`` squares a factor. With several other canopies, products with a factor of proximity are summed over them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import jax.numpy as jnp

from bayeschute.aero.polar import angle_rates, wind_axes
from bayeschute.aero.published import split_polar
from bayeschute.air.airflow import CanopyFlow, Neighbour
from bayeschute.air.vector import Component, dot, norm

_PAIRWISE = ("distance", "overlap", "sin_proximity", "cos_proximity")
_NEAR = 0.8  # D_prox below which canopies repel (7.3-5)
_TINY = 1e-9


@cache
def _factors(term: str) -> tuple[tuple[str, int], ...]:
    found = split_polar(term)
    if found is None:
        raise ValueError(f"{term!r} is no term of the polar form")
    return found


def _single(factor: str, flow: CanopyFlow) -> Component:
    if factor == "1":
        return jnp.ones_like(flow.cos_alpha)
    if factor == "q":
        return flow.q
    if factor == "speed":
        return flow.speed_ratio
    if factor == "alpha":
        return jnp.sqrt(flow.alpha_squared + _TINY**2)
    return angle_rates(flow)[0 if factor == "alpha_rate" else 1]


def _pair(factor: str, flow: CanopyFlow, other: Neighbour) -> Component:
    if factor == "distance":
        return other.distance
    if factor == "overlap":
        return jnp.maximum(_NEAR - other.distance, 0.0)
    axes = wind_axes(flow)
    along = axes.side if factor == "sin_proximity" else axes.normal
    return dot(other.away, along) / norm(other.away, _TINY)


def polar_term(term: str, flow: CanopyFlow) -> Component:
    """One term along a record or at a state.

    Args:
        term: Factors joined by ``*``.
        flow: Airflow, arrays (canopy, ...).

    Returns:
        Its value, shape of the flow's scalars.

    Raises:
        ValueError: If a factor is unknown.
    """
    parts = _factors(term)
    value = jnp.ones_like(flow.cos_alpha)
    for factor, power in parts:
        if factor not in _PAIRWISE:
            value = value * _single(factor, flow) ** power
    pairs = [(f, power) for f, power in parts if f in _PAIRWISE]
    if not pairs:
        return value
    total = jnp.zeros_like(value)
    for other in flow.neighbours:
        product = jnp.ones_like(value)
        for factor, power in pairs:
            product = product * _pair(factor, flow, other) ** power
        total = total + product
    return value * total


def polar_sum(terms: Sequence[str], values: Sequence[Component], flow: CanopyFlow) -> Component:
    """A coefficient: the weighted sum of its terms."""
    total = jnp.zeros_like(flow.cos_alpha)
    for term, value in zip(terms, values, strict=True):
        total = total + polar_term(term, flow) * value
    return total


def constant_force_axial(weight: Component, count: int, area: Component, q: Component) -> Component:
    """C_A of an axial force that always carries the weight: W/(n q S), the null model of any fitted C_A(q).

    About 97 % of what the C_A of Table 7.3-1 explains is explained by this alone.

    Args:
        weight: Of capsule and dry canopies [N].
        count: Number of canopies.
        area: S of one canopy [m^2].
        q: Dynamic pressure [Pa].
    """
    return weight / (count * area * q)
