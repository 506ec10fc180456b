"""Promises: which intervals a campaign of replicates may speak for, each judged with its standard error.

A nominal 90 % interval is ``kept`` where its coverage is shown to be sufficient: the one-sided 95 % lower confidence
limit of its share lies above the lower bound, and the share is not clearly above the upper one. It is ``too narrow``
or ``too wide`` where the opposite limit lies outside. In between the replicates do not decide, and nothing is promised.
(A true coverage of 82 % is called kept with 100 replicates about one time in a hundred.) A term that less than half of
the replicates fitted, since the search seldom keeps it, is judged by none: whoever keeps it has no promise about it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

NOMINAL = 0.9
WANTED = (0.85, 0.95)
"""Shares between which a nominal 90 % counts as kept."""
ENOUGH = 100
"""Replicates below which nothing is claimed."""
ENOUGH_FLIGHTS = 20
"""Held-out flights below which nothing is claimed."""
MOST_FAILED = 0.05
"""Share of failed replicates above which nothing is claimed: those that could be fitted are then a selection."""
ONE_SIDED = 1.645
"""Standard errors of a one-sided confidence limit of 95 %."""
KEPT, NARROW, WIDE, OPEN = "kept", "too narrow", "too wide", "undecided"
SELDOM = "fitted by too few replicates"


class Promise(NamedTuple):
    """Coverage of one kind of interval over replicates.

    Attributes:
        share: Of nominal 90 %; the lowest, where several flights of a role have it.
        standard_error: Of that share.
        verdict: See `judge`.
    """

    share: float
    standard_error: float
    verdict: str

    @property
    def words(self) -> str:
        """Share and standard error."""
        return f"{100.0 * self.share:.0f} ± {100.0 * self.standard_error:.0f} %"


def judge(share: float, standard_error: float) -> str:
    """``kept``, ``too narrow``, ``too wide`` or ``undecided``: see the module."""
    low, high = share - ONE_SIDED * standard_error, share + ONE_SIDED * standard_error
    if high < WANTED[0]:
        return NARROW
    if low > WANTED[1]:
        return WIDE
    return KEPT if low >= WANTED[0] else OPEN


def enough(summary: Mapping[str, Any]) -> str:
    """Why a campaign supports no verdict at all: too few replicates or too many failed; empty where it does."""
    made, failed = int(summary["replicates"]), len(summary["failed"])
    if made < ENOUGH:
        return "too few replicates"
    return "too many failed" if failed > MOST_FAILED * (made + failed) else ""


def verdict(summary: Mapping[str, Any], name: str) -> str:
    """Verdict on the coverage of a name of `promised`, or why the campaign supports none."""
    entry, made = _tables(summary)[name], int(summary["replicates"])
    if name in summary["parameters"] and 2 * (entry.get("replicates", made) + entry.get("left_out", 0)) < made:
        return SELDOM
    return enough(summary) or judge(entry["share"], entry["standard_error"])


def _tables(summary: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Entries of all tables by name; those of parameters and bands take their shares from ``coverage``."""
    made: dict[str, Mapping[str, Any]] = {}
    for table in ("parameters", "bands"):
        for name, entry in summary[table].items():
            found = {"share": summary["coverage"][name], "standard_error": summary["standard_error"][name]}
            made[name] = {**entry, **found}
    return made | dict(summary.get("modes", {})) | dict(summary.get("statistics", {}))


def shown(name: str) -> str:
    """A name of `promised` in words."""
    role, _, what = name.partition("/")
    words = what.replace("_", " ")
    return f"{words} of {'fitted' if role == 'identify' else 'unseen'} flights" if what else name


def promised(summary: Mapping[str, Any]) -> list[str]:
    """Names of all intervals that a campaign judges: parameters, bands, modes and statistics of flights."""
    return list(_tables(summary))


def promises(summary: Mapping[str, Any]) -> dict[str, Promise]:
    """Coverage by what a run shows, whatever its flights are called.

    Args:
        summary: As written by ``bayeschute calibrate``.

    Returns:
        Parameter names, and ``role/what`` for bands, modes and statistics; role is that of the flight, ``identify`` or
        ``predict``. Of several flights of a role, the one with the lowest share.
    """
    made: dict[str, Promise] = {}
    for name, entry in _tables(summary).items():
        key = f"{entry['role']}/{name.split('/', 1)[1]}" if "role" in entry else name
        one = Promise(entry["share"], entry["standard_error"], verdict(summary, name))
        if key not in made or one.share < made[key].share:
            made[key] = one
    return made


def is_headline(name: str, requirements: Sequence[str] = ()) -> bool:
    """Whether a level is lost where the intervals of this name do not have their coverage.

    True of aerodynamic parameters, bands of flights that were not fitted, and what requirements refer to. Others are
    named as not promised.

    Args:
        name: As in `promises`.
        requirements: Names of the statistics that requirements refer to.
    """
    role, _, what = name.partition("/")
    return name in requirements or (not what and "[" in role) or (role == "predict" and " " not in what)
