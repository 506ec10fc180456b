"""Errors: invalid input (every fault with where, got, wanted, do), and a fit that failed on valid input."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any
from unicodedata import category


@dataclass(frozen=True)
class Fault:
    """One fault of one input.

    Attributes:
        where: File and place, e.g. ``models/studies/x.toml [prior.C_A0] sd``.
        got: The value or state that was found.
        wanted: Values that are accepted.
        do: Advice for the reader; may be empty.
    """

    where: str
    got: str
    wanted: str
    do: str = ""

    def __str__(self) -> str:
        """One line: where, got, wanted, do."""
        line = f"{self.where}: got {self.got}; wanted {self.wanted}."
        return f"{line} {self.do}" if self.do else line


def harmless(text: str) -> str:
    """A text for terminals and logs: names of files and columns may hold characters that would command a terminal.

    Characters of control, of direction and those that can't be encoded are written as their codes; lines stay lines.
    """
    return "".join(ascii(c)[1:-1] if category(c) in ("Cc", "Cf", "Cs") and c not in "\n\t" else c for c in text)


class InputError(ValueError):
    """Input that can't be used, with all its faults at once.

    Attributes:
        faults: Every fault found, in the order of the input.
    """

    def __init__(self, faults: Fault | Iterable[Fault]) -> None:
        """Collect the faults; a single one may be given alone."""
        self.faults: tuple[Fault, ...] = (faults,) if isinstance(faults, Fault) else tuple(faults)
        super().__init__("\n".join(str(fault) for fault in self.faults))


class FitError(RuntimeError):
    """A fit of valid input that did not converge.

    Attributes:
        reason: Cause and advice, one sentence.
        tried: Attempts, one line each.
        paths: The best flights found (`bayeschute.posterior.best_path.BestPath`), one a record; may be empty.
        parameters: Name, value, standard error and unit at the best point; may be empty.
    """

    def __init__(
        self,
        reason: str,
        tried: Iterable[str] = (),
        paths: Iterable[Any] = (),
        parameters: Iterable[tuple[str, float, float, str]] = (),
    ) -> None:
        """Collect the results that are known despite the failure."""
        self.reason = reason
        self.tried: tuple[str, ...] = tuple(tried)
        self.paths: tuple[Any, ...] = tuple(paths)
        self.parameters: tuple[tuple[str, float, float, str], ...] = tuple(parameters)
        super().__init__(reason)
