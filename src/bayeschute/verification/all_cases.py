"""All check cases, run one after the other."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from bayeschute.core.version import __version__
from bayeschute.verification import (
    bounce,
    capsule_cases,
    flyout,
    glide,
    limit_cycle,
    maypole,
    pendulum_cases,
    vertical_descent,
)
from bayeschute.verification.case_results import Result
from bayeschute.verification.catalogue import CheckCase, choose

RUNS: dict[str, Callable[[], list[Result]]] = {
    "1": vertical_descent.constant_density,
    "2": vertical_descent.exponential_density,
    "3a": vertical_descent.step_updraft,
    "3b": vertical_descent.ramp_downdraft,
    "3c": vertical_descent.depth_shear,
    "4": glide.steady_glide,
    "5": glide.horizontal_shear,
    "6a": pendulum_cases.free_swing,
    "6b": pendulum_cases.small_swing,
    "6c": pendulum_cases.stiff_swing,
    "7a": pendulum_cases.damped_swing,
    "7b": pendulum_cases.growing_swing,
    "8": maypole.orbit,
    "9a": pendulum_cases.conical,
    "9b": pendulum_cases.spherical,
    "9c": pendulum_cases.stiff_spherical,
    "10p": flyout.planar,
    "10n": flyout.orbiting,
    "11": capsule_cases.torque_free,
    "12": capsule_cases.hanging,
    "13": bounce.bouncing,
    "14": limit_cycle.pendulum_limit_cycle,
}


def verify(
    names: Sequence[str] = (), progress: Callable[[str, float, str], None] = lambda *_: None
) -> tuple[list[Result], float]:
    """Run check cases on both parameter sets, with nominal risers and risers ten times as stiff.

    Args:
        names: Cases (`bayeschute.verification.catalogue`); all where none is given.
        progress: Progress callback: stage, share done, a few words.

    Returns:
        Results in the order of the catalogue, and the time it took [s].

    Raises:
        InputError: If a name is no case.
    """
    cases, results, begun = choose(names), list[Result](), time.perf_counter()
    for i, case in enumerate(cases):
        progress("verify", i / len(cases), f"case {case.name}: {case.title}")
        results += RUNS[case.name]()
    took = time.perf_counter() - begun
    progress("verify", 1.0, verdict(results))
    return results, took


def verdict(results: Sequence[Result]) -> str:
    """How many cases passed, in words."""
    cases = {r.case for r in results}
    failed = {r.case for r in results if not r.passed}
    ordered = [case.name for case in choose(()) if case.name in failed]
    words = f"{len(cases) - len(failed)} of {len(cases)} cases passed"
    return words + (f"; failed: {', '.join(ordered)}" if failed else "")


def document(results: Sequence[Result], seconds: float) -> dict[str, Any]:
    """Results for machines: names, numbers and nothing that JSON can't hold.

    Args:
        results: What `verify` returned.
        seconds: Time it took [s].

    Returns:
        ``program``, ``version``, ``seconds``, ``passed``, ``cases`` (name, title, passed) and ``results`` (the fields
        of `Result`; an error that is no finite number is null).
    """

    def passed(case: CheckCase) -> bool:
        return all(r.passed for r in results if r.case == case.name)

    flown = [case for case in choose(()) if any(r.case == case.name for r in results)]
    return {
        "program": "bayeschute",
        "version": __version__,
        "seconds": round(seconds, 3),
        "passed": all(r.passed for r in results),
        "cases": [{"name": c.name, "title": c.title, "passed": passed(c)} for c in flown],
        "results": [{**r._asdict(), "error": r.error if math.isfinite(r.error) else None} for r in results],
    }
