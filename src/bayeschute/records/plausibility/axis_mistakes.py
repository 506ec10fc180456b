"""Mistaken axes: earth axes of vectors, winds, and attitudes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from bayeschute.records.foreign.attitudes import product
from bayeschute.records.plausibility.evidence import Array, Evidence, conjugate, continuous, turned
from bayeschute.records.plausibility.mistake import Mistake, Undo, changed, turned_attitude, turned_axes

_VECTORS = ("position", "velocity", "canopies", "canopy_velocity", "wind")
_UP = np.diag([1.0, 1.0, -1.0])
_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
_SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
_SECOND_THIRD, _FIRST_THIRD = np.eye(3)[[0, 2, 1]], np.eye(3)[[2, 1, 0]]
_NWU = np.diag([1.0, -1.0, -1.0])
_WHERE = " (in [conventions] for columns of the record, in the table of its file for a wind by altitude)"
_WEST, _SOUTH, _BACK = np.diag([1.0, -1.0, 1.0]), np.diag([-1.0, 1.0, 1.0]), np.diag([-1.0, -1.0, 1.0])
_HALF = float(np.sqrt(0.5))
_UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
_NED_OF_ENU = np.array([0.0, _HALF, _HALF, 0.0])  # half a turn about north-east
_NED_OF_NWU = np.array([0.0, 1.0, 0.0, 0.0])  # half a turn about north
_GROUPS = (
    (("position",), "capsule positions", 0.1),
    (("velocity",), "capsule velocities", 0.1),
    (("canopies",), "canopy positions", 0.1),
    (("canopy_velocity",), "canopy velocities", 0.1),
    (("velocity", "canopy_velocity"), "velocities of capsule and canopies", 0.15),
    (("canopies", "canopy_velocity"), "canopy positions and velocities", 0.15),
    (("position", "velocity"), "capsule positions and velocities", 0.15),
    (("position", "canopies"), "positions of capsule and canopies", 0.15),
    (("position", "velocity", "canopies"), "positions and velocities of capsule and canopies", 0.1),
    (("position", "velocity", "canopies", "canopy_velocity"), "all positions and velocities", 0.1),
    (("position", "velocity", "canopies", "wind"), "positions, velocities and winds", 0.1),
    (("position", "velocity", "canopies", "canopy_velocity", "wind"), "all positions, velocities and winds", 0.1),
)


def axis_mistakes() -> Iterator[Mistake]:
    """Earth axes of vectors, one channel or several, or all of it."""
    for names, words, doubt in _GROUPS:
        for matrix, told, do, more in (
            (_UP, "{}: z points up, not down", "Give their third axis as 'up', or take it back.", 0.0),
            (_ENU, "{} are east, north, up, read as north, east, down", "Say axes = 'ENU', or take it back.", 0.0),
            (_SWAP, "north and east are swapped in {}", "Swap their columns.", 0.05),
            (_NWU, "{} are north, west, up, read as north, east, down", "Say axes = 'NWU', or take it back.", 0.1),
            (_WEST, "{}: the second axis points west, not east", "Give it as 'west', or take it back.", 0.2),
            (_SOUTH, "{}: the first axis points south, not north", "Give it as 'south', or take it back.", 0.2),
            (_SECOND_THIRD, "east and down are swapped in {}", "Swap their columns.", 0.1),
            (_FIRST_THIRD, "north and down are swapped in {}", "Swap their columns.", 0.1),
        ):
            cause = told.format(words)
            yield Mistake(
                cause[0].upper() + cause[1:] if cause[0] == "n" else cause,
                do,
                partial(turned_axes, names=names, matrix=matrix),
                doubt + more,
            )
    for matrix, turn, told in ((_ENU, _NED_OF_ENU, "ENU"), (_NWU, _NED_OF_NWU, "NWU")):
        words = "east, north, up" if told == "ENU" else "north, west, up"
        only = turned_attitude(turn)

        def whole(e: Evidence, matrix: Array = matrix, only: Undo = only) -> Evidence | None:
            names = tuple(n for n in _VECTORS if getattr(e, n) is not None)
            made = turned_axes(e, names, matrix)
            return made if made is None or made.attitude is None else only(made)

        yield Mistake(
            f"all of it is {words}, read as north, east, down", f"Say axes = '{told}', or take it back.", whole
        )
        yield Mistake(
            f"the quaternion is of axes {words}, read as of north, east, down",
            f"Say axes = '{told}' for it, or take it back.",
            only,
        )


def wind_mistakes() -> Iterator[Mistake]:
    """Sense and axes of the wind, recorded or by altitude."""
    for matrix, told, do in (
        (_BACK, 'wind is "from", read as "towards"', f"Say wind_is = 'from'{_WHERE}, or take it back."),
        (_SWAP, "north and east are swapped in the wind", "Swap its columns."),
        (_ENU, "wind is east, north, up, read as north, east, down", "Say axes = 'ENU' for it, or take it back."),
        (
            _BACK @ _SWAP,
            'north and east are swapped in the wind, and it is "from"',
            f"Swap its columns; say wind_is = 'from'{_WHERE}.",
        ),
        (_WEST, "wind: the second axis points west, not east", "Give it as 'west', or take it back."),
        (_SOUTH, "wind: the first axis points south, not north", "Give it as 'south', or take it back."),
    ):
        doubt = 0.1 if do.startswith(("Say w", "Swap its columns.")) else 0.3
        yield Mistake(told, do, partial(turned_axes, names=("wind",), matrix=matrix), doubt)
        for target in ("wind", "profile"):

            def one(e: Evidence, m: Array = matrix, target: str = target) -> Evidence | None:
                if e.wind is None or e.profile is None or e.shear is None:
                    return None
                if target == "wind":
                    return replace(e, wind=e.wind @ m.T)
                return changed(("profile", "shear"), lambda values: values @ m.T)(e)

            words = "recorded wind" if target == "wind" else "wind by altitude"
            yield Mistake(told.replace("wind", words, 1), do, one, doubt + 0.05)
    yield Mistake(
        "the wind is missing",
        "Give columns for it, or [flight.wind_profile].",
        lambda e: None if _winds_of(e) or e.velocity is None else replace(e, wind=e.velocity * [1.0, 1.0, 0.0]),
    )


def _winds_of(e: Evidence) -> bool:
    return e.wind is not None or e.profile is not None


_LAST, _FIRST = [3, 0, 1, 2], [1, 2, 3, 0]
_ORDERS: tuple[tuple[str, str, Callable[[Array], Array], float], ...] = (
    (
        "the quaternion is scalar-last, read as scalar-first",
        "Give its fourth column as capsule_attitude.w.",
        lambda q: q[:, _LAST],
        0.1,
    ),
    (
        "the quaternion is scalar-first, read as scalar-last",
        "Give its first column as capsule_attitude.w.",
        lambda q: q[:, _FIRST],
        0.15,
    ),
    (
        "the quaternion is conjugated: it turns body onto earth axes, not earth onto body axes",
        "Say attitude = 'earth to body'.",
        conjugate,
        0.1,
    ),
    (
        "the quaternion is scalar-last and conjugated",
        "Give its fourth column as capsule_attitude.w; say attitude = 'earth to body'.",
        lambda q: conjugate(q[:, _LAST]),
        0.25,
    ),
)
_SAID = 0.05  # doubt more where earth axes of the quaternion's own were said


def _of_attitude(change: Callable[[Array], Array]) -> Undo:
    return changed(("attitude",), lambda q: continuous(change(q)))


def _order_mistakes() -> Iterator[Mistake]:
    """Order and sense of the quaternion, along the schema's earth axes and along those that a study may have said.

    Body axes that were said turned it when it was read: they are turned back before, and again after.
    """
    for told, do, change, doubt in _ORDERS:
        for earth in (_UNTURNED, _NED_OF_ENU, _NED_OF_NWU):

            def undo(e: Evidence, earth: Array = earth, change: Callable[[Array], Array] = change) -> Evidence | None:
                if e.attitude is None:
                    return None
                body = _UNTURNED if e.body_turn is None else e.body_turn
                raw = _times(_times(conjugate(earth), e.attitude), conjugate(body))
                return replace(e, attitude=continuous(_times(_times(earth, change(raw)), body)))

            yield Mistake(told, do, undo, doubt if earth is _UNTURNED else doubt + _SAID)


def _times(first: Array, second: Array) -> Array:
    """Products of quaternions (T, 4), one of which may be a single one (4,)."""
    return product(*np.broadcast_arrays(first, second))


def attitude_mistakes() -> Iterator[Mistake]:
    """Order, sense, norm and body axes of the quaternion."""
    yield from _order_mistakes()
    yield Mistake(
        "the quaternion is not of norm one",
        "Divide it by its norm.",
        _of_attitude(lambda q: q / np.linalg.norm(q, axis=1, keepdims=True)),
        0.3,
    )
    turns = {
        "z down, x forward, where the vehicle's x is up": [_HALF, 0.0, _HALF, 0.0],
        "x down": [0.0, 0.0, 1.0, 0.0],
        "turned by half a turn about x": [0.0, 1.0, 0.0, 0.0],
        "x up, where the vehicle's z is down": [_HALF, 0.0, -_HALF, 0.0],
    }
    for words, turn in turns.items():
        r = np.array(turn)

        def body(e: Evidence, r: Array = r, all_of_it: bool = True) -> Evidence | None:
            if e.attitude is None and e.force is None:
                return None
            change: dict[str, Any] = {}
            if e.attitude is not None:
                change["attitude"] = product(e.attitude, np.broadcast_to(r, e.attitude.shape))
            for name in ("rate", "force") if all_of_it else ():
                values = getattr(e, name)
                if values is not None:
                    change[name] = turned(np.broadcast_to(conjugate(r), (len(values), 4)), values)
            return replace(e, **change)

        do = "Say how they lie by body_axes."
        yield Mistake(
            f"body axes of the record have {words}"
            if "down" in words or "up" in words
            else f"body axes of the record are {words}",
            do,
            body,
            0.15,
        )
        yield Mistake(
            f"body axes of the quaternion, and not those of the gyros, are other ones ({words})",
            do,
            partial(body, all_of_it=False),
            0.3,
        )
