"""Mistaken signs, order and meaning of instrument channels: gyros, accelerometers, canopies, load cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from bayeschute.atmosphere.standard import STANDARD_GRAVITY
from bayeschute.records.plausibility.evidence import Evidence, conjugate, turned
from bayeschute.records.plausibility.mistake import Mistake, Undo, changed


def instrument_mistakes() -> Iterator[Mistake]:
    """Signs and axes of gyros and accelerometers, and gravity in the specific force."""
    for name, words in (("rate", "angular rate"), ("force", "specific force")):
        for axis, inverted in _inverted((name,)).items():
            do = f"Give the column of {name} {axis} scale = -1."
            yield Mistake(f"body axis {axis} of the {words} is inverted", do, inverted)
        for a, b in ((0, 1), (0, 2), (1, 2)):
            order = [0, 1, 2]
            order[a], order[b] = b, a
            pair = "xyz"[a] + " and " + "xyz"[b]
            yield Mistake(
                f"body axes {pair} of the {words} are swapped",
                "Swap their columns.",
                changed((name,), partial(np.take, indices=order, axis=1)),
                0.2,
            )
    for axis, inverted in _inverted(("rate", "force")).items():
        words, do = "is inverted in angular rate and specific force", f"Give the columns of {axis} scale = -1."
        yield Mistake(f"body axis {axis} {words}", do, inverted, 0.2)
    yield Mistake(
        "angular rates have the opposite sign",
        "Give their columns scale = -1.",
        changed(("rate",), np.negative),
    )
    yield Mistake(
        "specific force has the opposite sign: it is gravity less acceleration",
        "Give its columns scale = -1.",
        changed(("force",), np.negative),
    )

    def gravity(e: Evidence, share: float) -> Evidence | None:
        if e.force is None or e.attitude is None:
            return None
        weight = turned(conjugate(e.attitude), np.array([0.0, 0.0, STANDARD_GRAVITY]))
        return replace(e, force=e.force + share * weight)

    yield Mistake(
        "specific force is without gravity: it is the acceleration of the capsule",
        "Subtract gravity in body axes, or leave the channel out.",
        lambda e: gravity(e, -1.0),
    )
    yield Mistake(
        "specific force has gravity subtracted twice", "Add gravity in body axes once.", lambda e: gravity(e, 1.0), 0.2
    )
    for name, words in (("rate", "angular rates"), ("force", "specific forces")):
        yield Mistake(
            f"{words} are along earth axes, not body axes",
            "Turn them by the attitude, or leave the channel out.",
            partial(_from_earth, name=name),
            0.2,
        )


def _inverted(names: tuple[str, ...]) -> dict[str, Undo]:
    """Inverses of an inverted body axis, by axis."""
    signs = np.ones((3, 3)) - 2.0 * np.eye(3)
    return {axis: changed(names, partial(np.multiply, sign)) for axis, sign in zip("xyz", signs, strict=True)}


def _from_earth(e: Evidence, name: str) -> Evidence | None:
    if e.attitude is None or getattr(e, name) is None:
        return None
    return changed((name,), partial(turned, conjugate(e.attitude)))(e)


def canopy_mistakes() -> Iterator[Mistake]:
    """Origin, frame of reference and order of the canopies."""
    yield Mistake(
        "canopy positions are relative to the capsule",
        "Add the position of the capsule to them.",
        lambda e: (
            None if e.canopies is None or e.position is None else replace(e, canopies=e.canopies + e.position[:, None])
        ),
    )
    yield Mistake(
        "canopy positions are relative to the capsule, z up",
        "Turn their z, and add the position of the capsule.",
        lambda e: (
            None
            if e.canopies is None or e.position is None
            else replace(e, canopies=e.canopies * [1.0, 1.0, -1.0] + e.position[:, None])
        ),
        0.2,
    )
    yield Mistake(
        "canopy velocities are relative to the capsule",
        "Add the velocity of the capsule to them.",
        lambda e: (
            None
            if e.canopy_velocity is None or e.velocity is None
            else replace(e, canopy_velocity=e.canopy_velocity + e.velocity[:, None])
        ),
    )
    yield Mistake(
        "canopy positions and velocities are relative to the capsule",
        "Add position and velocity of the capsule to them.",
        lambda e: (
            None
            if e.canopies is None or e.canopy_velocity is None or e.position is None or e.velocity is None
            else replace(
                e,
                canopies=e.canopies + e.position[:, None],
                canopy_velocity=e.canopy_velocity + e.velocity[:, None],
            )
        ),
        0.15,
    )
    yield Mistake(
        "order of the canopies differs in positions and velocities (1 and 2 are swapped)",
        "Swap the columns of the velocities, or of the positions.",
        lambda e: (
            None
            if e.canopy_velocity is None or e.canopy_velocity.shape[1] != 2
            else replace(e, canopy_velocity=e.canopy_velocity[:, ::-1])
        ),
    )
    yield Mistake(
        "order of the canopies and of the load cells differs (1 and 2 are swapped)",
        "Swap the load cells, or the canopies.",
        lambda e: None if e.tension is None or e.tension.shape[1] != 2 else replace(e, tension=e.tension[:, ::-1]),
    )
