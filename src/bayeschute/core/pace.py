"""Pace of long computations: share done of each of their stages, and the time that is left of it."""

from __future__ import annotations

import time

_WARM = 15.0  # time after which a stage's pace is told [s]
_SEEN = 0.02  # likewise its share


class Pace:
    """Shares done that never fall, and the time left if a stage goes on as fast as it went so far.

    Parts of a stage are not all as slow as each other, so the time left is about right, not more.

    Examples:
        >>> pace = Pace()
        >>> pace.at("fit", 0.5), pace.at("fit", 0.4)
        (0.5, 0.5)
    """

    def __init__(self) -> None:
        self._stages: dict[str, tuple[float, float]] = {}  # when it began, the largest share

    def at(self, stage: str, share: float) -> float:
        """Note a share that is done (0 to 1); returns the largest that was noted."""
        began, most = self._stages.get(stage, (time.perf_counter(), 0.0))
        most = min(max(share, most), 1.0)
        self._stages[stage] = began, most
        return most

    def left(self, stage: str) -> str:
        """Time left of a stage in words, such as ``about 3 min left``; empty where too little is done to tell."""
        began, share = self._stages.get(stage, (0.0, 1.0))
        passed = time.perf_counter() - began
        if share >= 1.0 or share < _SEEN or passed < _WARM:
            return ""
        seconds = passed * (1.0 - share) / share
        if seconds < 60.0:
            return "under 1 min left"
        minutes = round(seconds / 60.0)
        return f"about {minutes} min left" if minutes < 90 else f"about {seconds / 3600.0:.1f} h left"
