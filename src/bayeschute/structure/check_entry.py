"""Prediction test of a structure on data that were not fitted, as plain values, and the term that causes an error.

A prediction error has three parts: the residual of the same terms refitted to that record, the part explained by the
standard errors of the coefficients, and the rest. A term that only the fitted record supports is found by omitting each
term in turn and refitting the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.regression.stacked import Stack
from bayeschute.structure.cross_validation import PredictionTest, predict_record
from bayeschute.structure.search import Identified

Array = NDArray[np.float64]
_GAIN = 0.97  # decrease of the prediction error from which omitting a term is reported


def check_entries(
    identified: Identified,
    names: Sequence[str],
    checks: Mapping[str, Stack],
    truth: Mapping[str, float] | None = None,
) -> dict[str, dict[str, Any]]:
    """Predictions of canopies and flights that were not used.

    Args:
        identified: The identified model.
        names: Candidates.
        checks: Regressions of the other canopies and flights, by label.
        truth: True coefficients by term; None if unknown.

    Returns:
        By label: the numbers of `structure.cross_validation.PredictionTest`; ``without``, the term whose absence
        lowers the prediction error most and the ratio then, None where none lowers it by 3 %; ``true_ratio``, what the
        true coefficients leave over the rms of the fit (None if unknown or not among the candidates).
    """
    columns, fitted = list(identified.found.columns), identified.fit
    fewer = _without(identified.stack, columns)
    found = {}
    for label, other in checks.items():
        test = predict_record(fitted, other.X[:, columns], other.z, label=label, components=other.components)
        ratios = {names[j]: _rms(other, *model) / fitted.rms for j, model in fewer.items()} if fitted.rms > 0.0 else {}
        best = min(ratios, key=lambda term: ratios[term], default="")
        helps = bool(best) and ratios[best] < _GAIN * test.rms_ratio
        found[label] = {
            **_numbers(test),
            "without": {"term": best, "rms_ratio": ratios[best]} if helps else None,
            "true_ratio": _true_ratio(other, names, truth, fitted.rms),
        }
    return found


def _numbers(test: PredictionTest) -> dict[str, Any]:
    return {
        "rms_ratio": test.rms_ratio,
        "least_ratio": test.least_ratio,
        "expected_ratio": test.expected_ratio,
        "rms": test.rms,
        "r2": test.r2,
        "bias": test.bias,
        "theil": test.theil.coefficient,
        "extrapolated": test.extrapolated,
        "samples": test.samples,
    }


def _without(stack: Stack, columns: Sequence[int]) -> dict[int, tuple[list[int], Array]]:
    """For each column: the others, and their coefficients when they are fitted without it."""
    made: dict[int, tuple[list[int], Array]] = {}
    for j in columns if len(columns) > 1 else ():
        rest = [k for k in columns if k != j]
        X, used = stack.X[:, rest], _used(stack, columns)
        made[j] = rest, np.linalg.lstsq(X[used], stack.z[used], rcond=None)[0]
    return made


def _used(stack: Stack, columns: Sequence[int]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(stack.z) & np.isfinite(stack.X[:, list(columns)]).all(axis=1))


def _rms(stack: Stack, columns: Sequence[int], values: Array) -> float:
    used = _used(stack, columns)
    error = stack.z[used] - stack.X[used][:, list(columns)] @ values
    return float(np.sqrt(np.mean(error**2)))


def _true_ratio(stack: Stack, names: Sequence[str], truth: Mapping[str, float] | None, rms: float) -> float | None:
    if not truth or not set(truth) <= set(names) or not rms > 0.0:
        return None
    return _rms(stack, [list(names).index(term) for term in truth], np.array(list(truth.values()))) / rms
