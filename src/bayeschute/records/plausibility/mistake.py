"""A mistake made with records, its inverse, and the changes that inverses are composed of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from bayeschute.records.foreign.attitudes import product
from bayeschute.records.plausibility.evidence import Array, Evidence, Nominal

Undo = Callable[[Evidence], Evidence | None]


@dataclass(frozen=True)
class Mistake:
    """A mistake and its inverse.

    Attributes:
        cause: In words, as a message tells it.
        do: What to do about it.
        undo: The evidence without it; None where there is no such channel or the mistake would change nothing.
        doubt: What it costs against others that explain as much: rare or far-fetched mistakes cost more.
    """

    cause: str
    do: str
    undo: Undo
    doubt: float = 0.1

    def undone(self, e: Evidence) -> Evidence | None:
        """The evidence without it, and the wind by altitude at the heights that its positions then say."""
        made = self.undo(e)
        if made is None or all(
            getattr(made, name) is getattr(e, name) for name in ("position", "canopies", "altitude")
        ):
            return made
        return made.with_winds()


def scaled(e: Evidence, names: tuple[str, ...], factor: float) -> Evidence | None:
    """Channels times a factor; the wind takes its profile along."""
    return changed(names, lambda values: factor * values)(e)


def with_profile(names: tuple[str, ...], e: Evidence) -> tuple[str, ...]:
    """Recorded wind, and the wind by altitude where that says the same."""
    if "wind" not in names:
        return names
    rest = tuple(name for name in names if name != "wind")
    winds = tuple(name for name in ("wind", "profile", "shear") if getattr(e, name) is not None)
    return rest + winds


def other_heights(e: Evidence, read: Callable[[Array], Array]) -> Evidence | None:
    """The wind by altitude where its file gives another altitude for the true one; None where there is none."""
    aloft = e.aloft
    return None if aloft is None else replace(e, aloft=lambda height: aloft(read(height))).with_winds()


def turned_axes(e: Evidence, names: tuple[str, ...], matrix: Array) -> Evidence | None:
    """Vectors along other earth axes; None where one isn't there."""
    names = with_profile(names, e)
    return changed(names, lambda values: values @ matrix.T)(e) if names else None


def turned_attitude(turn: Array) -> Undo:
    """An inverse that turns the earth axes of the attitude by a quaternion (4,)."""
    return changed(("attitude",), lambda q: product(np.broadcast_to(turn, q.shape), q))


def changed(names: tuple[str, ...], change: Callable[[Array], Array]) -> Undo:
    """An inverse that changes the values of channels; None where one isn't there."""

    def undo(e: Evidence) -> Evidence | None:
        found: dict[str, Any] = {n: change(getattr(e, n)) for n in names if getattr(e, n) is not None}
        if len(found) < len(names):
            return None
        aloft = e.aloft
        if "profile" in found and aloft is not None:
            found["aloft"] = lambda height: change(aloft(height))
        return replace(e, **found)

    return undo


def of_vehicle(change: Callable[[Nominal], Mapping[str, Any] | None]) -> Undo:
    """An inverse that changes numbers of the vehicle; None where there is none, or where `change` gives none."""

    def undo(e: Evidence) -> Evidence | None:
        made = None if e.vehicle is None else change(e.vehicle)
        return None if e.vehicle is None or made is None else replace(e, vehicle=replace(e.vehicle, **made))

    return undo
