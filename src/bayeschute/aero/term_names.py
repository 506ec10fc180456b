"""Syntax of the names of aerodynamic terms, free of JAX (meanings: `bayeschute.aero.terms`)."""

from __future__ import annotations

import re

VECTOR_FACTORS = (r"e", r"angle", r"rate", r"c", r"repulsion\(\d*\.?\d+\)")
SCALAR_FACTORS = (
    r"1",
    r"alpha(\^[1-9])?",
    r"q",
    r"speed",
    r"proximity\(\d*\.?\d+\)",
    r"closing",
    r"restoring\(\d*\.?\d+\)",
    r"\(e\.rate\)",
    r"\(e\.c\)",
    r"\(c\.rate\)",
)
_PAIRWISE = ("proximity(", "closing", "repulsion(", "(e.c)", "(c.rate)")
_VECTOR = re.compile("|".join(f"(?:{p})" for p in VECTOR_FACTORS))
_SCALAR = re.compile("|".join(f"(?:{p})" for p in SCALAR_FACTORS))


def parse_term(name: str) -> tuple[str, ...]:
    """Split a term into its factors.

    Args:
        name: For example ``"e*alpha^2"``.

    Returns:
        The factors, in the order written.

    Raises:
        ValueError: If a factor is unknown; the message names it.
    """
    factors = tuple(part.strip() for part in name.split("*"))
    for factor in factors:
        if factor != "side" and not _VECTOR.fullmatch(factor) and not _SCALAR.fullmatch(factor):
            raise ValueError(f"{factor!r} in {name!r} is no factor of an aerodynamic term")
    return factors


def is_pairwise(name: str) -> bool:
    """Whether a term tells of two canopies: of their distance, direction or closing."""
    return any(f == "c" or f.startswith(_PAIRWISE) for f in parse_term(name))


def rate_factors(name: str) -> int:
    """How often the transverse rate enters a term; more than once is not linear in it."""
    return sum("rate" in factor for factor in parse_term(name))


def check_axial(name: str) -> str | None:
    """Error in the name of an axial term, in words; None if it is valid."""
    try:
        factors = parse_term(name)
    except ValueError as error:
        return str(error)
    vectors = [f for f in factors if f == "side" or _VECTOR.fullmatch(f)]
    return f"{name!r} holds the vector factor {vectors[0]!r}; an axial term is a scalar" if vectors else None


def check_transverse(name: str) -> str | None:
    """Error in the name of a transverse term, in words; None if it is valid."""
    try:
        factors = parse_term(name)
    except ValueError as error:
        return str(error)
    vectors = [f for f in factors if _VECTOR.fullmatch(f)]
    if factors.count("side") > 1:
        return f"{name!r} turns its vector twice; 'side' may stand once"
    if len(vectors) != 1:
        return f"{name!r} holds {len(vectors)} vector factors; a transverse term holds exactly one"
    return None
