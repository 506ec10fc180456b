"""Pace of long computations: share done of each of their stages, and the time left of it where that can be known."""

from __future__ import annotations

import time
from bisect import bisect_right
from dataclasses import dataclass, field

_WARM = 15.0  # time after which a stage's pace is told [s]
_SEEN = 0.05  # likewise its share
_PARTS = (1.0, 0.5, 0.25, 0.125)  # last parts of the time that passed, whose paces are compared
_ALIKE = 1.5  # greatest ratio of paces that agree
_FASTER, _SLOWER = 0.8, 1.6  # what the rest of a stage may take, over what these paces say
_SAME = 1.25  # an end this much later than the one told last is taken for it
_FINE = 0.001  # of shares that are kept


@dataclass
class _Stage:
    """A stage under way.

    Attributes:
        began: When [s].
        times: Of `shares` [s].
        shares: As they grew.
        most: The largest so far.
        end: The longest time left that was told last [s].
        words: The time left as it was at the last message; empty where it is not known.
    """

    began: float
    times: list[float] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    most: float = 0.0
    end: float = float("inf")
    words: str = ""

    def note(self, now: float, share: float) -> float:
        """Note a share; returns the largest."""
        self.most = min(max(share, self.most), 1.0)
        if not self.shares or self.most >= self.shares[-1] + _FINE:
            self.times.append(now)
            self.shares.append(self.most)
        self.words = self._left(now)
        return self.most

    def _left(self, now: float) -> str:
        passed = now - self.began
        if not _SEEN <= self.most < 1.0 or passed < _WARM:
            return ""
        grown = [self._grown(now - part * passed) for part in _PARTS]
        if min(grown) <= 0.0:
            return ""
        ends = [part * passed * (1.0 - self.most) / more for part, more in zip(_PARTS, grown, strict=True)]
        least, most = _FASTER * min(ends), _SLOWER * max(ends)
        if max(ends) > _ALIKE * min(ends) or most > _SAME * self.end:
            return ""
        self.end = min(most, self.end)
        return _range(least, self.end)

    def _grown(self, since: float) -> float:
        """By how much the share has grown since a time [s]; one that jumps did so when it was told, not before."""
        before = bisect_right(self.times, since)
        return self.most - (self.shares[before - 1] if before else 0.0)


def percent(share: float) -> int:
    """A share that is done in percent; 100 only where all is done, however little is left.

    Example:
        >>> [percent(share) for share in (0.0, 0.504, 0.999, 1.0)]
        [0, 50, 99, 100]
    """
    return 100 if share >= 1.0 else min(round(100.0 * share), 99)


class Pace:
    """Shares done that never fall, and the time left of a stage, as a range, where its pace is steady.

    The pace is steady where the last half, quarter and eighth of the time that passed went about as fast as the whole.
    Shares of a stage with an unknown number of steps jump, so its pace seldom is, and no time left is told then. The
    end of the range never grows: where it would, none is told until it is below what was told last.

    Examples:
        >>> pace = Pace()
        >>> pace.at("fit", 0.5), pace.at("fit", 0.4)
        (0.5, 0.5)
        >>> pace.left("fit")  # too soon
        ''
    """

    def __init__(self) -> None:
        self._stages: dict[str, _Stage] = {}

    def at(self, stage: str, share: float) -> float:
        """Note a share that is done (0 to 1); returns the largest that was noted."""
        now = time.perf_counter()
        return self._stages.setdefault(stage, _Stage(now)).note(now, share)

    def left(self, stage: str) -> str:
        """Time left of a stage in words, such as ``about 3 to 5 min left``; empty where its pace doesn't tell."""
        found, now = self._stages.get(stage), time.perf_counter()
        if found is None or now - found.times[-1] > max(_WARM, _PARTS[-1] * (now - found.began)):
            return ""
        return found.words

    def told(self, stage: str) -> str:
        """Time left of a stage where its pace tells it, else the time that passed, such as ``3 min so far``."""
        left, found = self.left(stage), self._stages.get(stage)
        if left or found is None or found.most >= 1.0:
            return left
        passed = time.perf_counter() - found.began
        return f"{_words(passed)} so far" if passed >= 60.0 else ""


def _range(least: float, most: float) -> str:
    """A range of times left [s] in words."""
    if most >= 90.0 * 60.0:
        return f"about {least / 3600.0:.1f} to {most / 3600.0:.1f} h left"
    low, high = round(least / 60.0), max(round(most / 60.0), 1)
    if low == 0:
        return f"under {high} min left"
    return f"about {low} min left" if low == high else f"about {low} to {high} min left"


def _words(seconds: float) -> str:
    """A time [s] in words, in full minutes."""
    return f"{int(seconds / 60.0)} min" if seconds < 90.0 * 60.0 else f"{seconds / 3600.0:.1f} h"
