"""The check cases by name (report, Table 6.3.4-1, and four more); free of JAX."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from bayeschute.core.errors import Fault, InputError


class CheckCase(NamedTuple):
    """A check case: its name and what it is about."""

    name: str
    title: str


CASES = (
    CheckCase("1", "constant density descent"),
    CheckCase("2", "exponential density descent"),
    CheckCase("3a", "vertical wind: a step"),
    CheckCase("3b", "vertical wind: a ramp in time"),
    CheckCase("3c", "vertical wind: a shear with depth"),
    CheckCase("4", "steady glide"),
    CheckCase("5", "horizontal wind shear"),
    CheckCase("6a", "pendulum without aerodynamic stiffness"),
    CheckCase("6b", "small pendulum and its pivot point"),
    CheckCase("6c", "large pendulum"),
    CheckCase("7a", "damped pendulum"),
    CheckCase("7b", "growing pendulum"),
    CheckCase("8", "maypole"),
    CheckCase("9a", "conical pendulum"),
    CheckCase("9b", "spherical pendulum"),
    CheckCase("9c", "spherical pendulum with aerodynamic stiffness"),
    CheckCase("10p", "flyout in a plane"),
    CheckCase("10n", "flyout with orbit"),
    CheckCase("11", "torque-free symmetric top"),
    CheckCase("12", "hang angle"),
    CheckCase("13", "slack and taut bounces"),
    CheckCase("14", "limit cycle of the pendulum"),
)


def choose(names: Sequence[str]) -> tuple[CheckCase, ...]:
    """The cases of some names, in the order of the catalogue; all where no name is given.

    Args:
        names: Names; a number alone stands for all cases of that number.

    Raises:
        InputError: If a name is no case.
    """
    known = {case.name for case in CASES} | {case.name.rstrip("abcnp") for case in CASES}
    faults = [
        Fault(f"--case {name}", "no such case", f"one of {', '.join(case.name for case in CASES)}")
        for name in names
        if name not in known
    ]
    if faults:
        raise InputError(faults)
    return tuple(case for case in CASES if not names or {case.name, case.name.rstrip("abcnp")} & set(names))
