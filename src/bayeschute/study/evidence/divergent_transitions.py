"""Divergent transitions of NUTS on a density that nothing corrects, as that of a hierarchical model of drops.

A transition diverges where the leapfrog steps lose the energy: in the neck of a funnel, where the populations' standard
deviations are small (Betancourt and Girolami 2015). There draws are missing, and R-hat need not show it. The walk on a
fit's surrogate is not judged by them: every proposal of it is accepted or refused by the exact density.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bayeschute.study.assembly.populations import DIVERGING

MOST_DIVERGENT = 0.01
"""Share of the transitions that may diverge."""


def divergences_check(sample_stats: Mapping[str, ArrayLike]) -> dict[str, dict[str, Any]]:
    """The check `divergences`, of a posterior whose populations were drawn by NUTS alone.

    Args:
        sample_stats: Variables of the posterior's group, by name.

    Returns:
        The check by its name; empty where no populations were drawn.

    Examples:
        >>> divergences_check({"population_diverging": [[False] * 97 + [True] * 3]})["divergences"]["passed"]
        False
        >>> divergences_check({"diverging": [[True]]})
        {}
    """
    if DIVERGING not in sample_stats:
        return {}
    diverged = np.asarray(sample_stats[DIVERGING], bool)
    share = float(diverged.mean())
    detail = (
        f"{int(diverged.sum()):,} of {diverged.size:,} transitions of the populations' draws diverged: where their "
        "standard deviations are small draws may be missing"
    )
    passed = share <= MOST_DIVERGENT
    return {"divergences": {"passed": passed, "value": share, "bound": MOST_DIVERGENT, "detail": detail}}
