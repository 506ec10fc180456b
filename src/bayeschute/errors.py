"""What bad input looks like: every fault says where, what it got, what it wanted and what to do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One fault of one input.

    Attributes:
        where: File and place, e.g. ``models/studies/x.toml [prior.C_A0] sd``.
        got: What stands there.
        wanted: What would be accepted.
        do: What the reader can do about it; may be empty.
    """

    where: str
    got: str
    wanted: str
    do: str = ""

    def __str__(self) -> str:
        """One line: where, got, wanted, do."""
        line = f"{self.where}: got {self.got}; wanted {self.wanted}."
        return f"{line} {self.do}" if self.do else line


class InputError(ValueError):
    """Input that can't be used, with all its faults at once.

    Attributes:
        faults: Every fault found, in the order of the input.
    """

    def __init__(self, faults: Fault | Iterable[Fault]) -> None:
        """Collect the faults; a single one may be given alone."""
        self.faults: tuple[Fault, ...] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))
