"""Result of the structure selection for one coefficient as plain values: the entry of ``structure.json``."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.errors import InputError
from bayeschute.regression.collinearity import collinearity
from bayeschute.regression.equation_error import EquationErrorFit, fit
from bayeschute.regression.fit_statistics import null_models
from bayeschute.regression.propagation import Propagated
from bayeschute.regression.residuals import autocorrelation, press
from bayeschute.regression.selection import Row, Selection
from bayeschute.regression.stacked import Stack
from bayeschute.structure.check_entry import check_entries
from bayeschute.structure.confusable_terms import rivals
from bayeschute.structure.search import CEILINGS, Identified, Search

Array = NDArray[np.float64]
_FOLDS = 10  # of PRESS: number of blocks of each series, left out in turn
_LAGS = 200  # autocorrelations stored at most
_MOST_TERMS = 12  # of the structures stored by ceiling
_WHOLE = 30  # candidates at most that are fitted all together
_OFTEN = 0.05  # share of the replicates from which a term's frequency is reported


def entry(
    identified: Identified,
    names: Sequence[str],
    how: Search,
    dt: float,
    *,
    checks: Mapping[str, Stack],
    truth: Mapping[str, float] | None = None,
    pressure: Array | None = None,
    units: Sequence[str] | None = None,
    propagated: Propagated | None = None,
) -> dict[str, Any]:
    """The entry of one coefficient.

    Args:
        identified: The identified model.
        names: Candidates.
        how: How it was searched for.
        dt: Sample interval [s].
        checks: Regressions of canopies and flights that were not used, by label.
        truth: Coefficients that the flights of `checks` were flown with, by term; None if unknown.
        pressure: Dynamic pressure of the rows [Pa], for the constant-force null model of C_A.
        units: Unit of each candidate's coefficient; None: all 1.
        propagated: Effect of the positions' noise.

    Returns:
        Plain values, NaN and infinities as None.
    """
    found, fitted, stack = identified.found, identified.fit, identified.stack
    columns = list(found.columns)
    whole = _whole(stack, names)
    nulls = null_models(stack.z, pressure, components=stack.components)
    report = {
        "selected": _selected(identified, units, propagated),
        "left_out": _left_out(whole, fitted.names),
        "together": _together(whole, names, stack.X),
        "covariance": fitted.covariance,
        "ranking": ranking(found.selection),
        "candidates": list(names),
        "snr": _signal_to_noise(identified, propagated),
        "sigma_max2": found.selection.ceiling.value,
        "noise": found.level._asdict() | {"factor": how.sigma_max},
        "penalty_factor": how.penalty_factor,
        "pse_minimum_at": found.selection.minimum,
        "exchange": _exchanged(identified),
        "sensitivity": _sensitivity(found.selection),
        "frequency": _frequency(identified),
        "structures": [s._asdict() for s in identified.structures],
        "collinearity": _collinearity(stack.X[:, columns], fitted.names),
        "rivals": [r._asdict() for r in rivals(stack.X, list(names), columns, fitted.estimate, found.level.variance)],
        "null_model": {"name": nulls[-1].name, "r2": nulls[-1].r2, "rms": nulls[-1].rms},
        "null_models": [{"name": n.name, "r2": n.r2, "rms": n.rms} for n in nulls],
        "r2": fitted.r2,
        "residual": _residual(identified, dt),
        "press": _press(stack, columns),
        "samples": int(np.sum(fitted.used)),
        "check": check_entries(identified, names, checks, truth),
    }
    if propagated is not None:
        report["differentiation"] = {k: getattr(propagated, k) for k in ("position_sd", "response_sd", "replicates")}
    return dict(plain(report))


def _whole(stack: Stack, names: Sequence[str]) -> EquationErrorFit | None:
    """All candidates fitted together that are ever other than zero.

    None for a large pool, or where the record can't separate some of them.
    """
    known = np.nanmax(np.abs(np.where(np.isfinite(stack.X), stack.X, np.nan)), axis=0) > 0.0
    kept = [name for name, there in zip(names, known, strict=True) if there]
    if len(names) > _WHOLE or not kept:
        return None
    try:
        return fit(
            stack.X[:, known], stack.z, kept, components=stack.components, blocks=stack.blocks, groups=stack.groups
        )
    except InputError:
        return None


def _left_out(whole: EquationErrorFit | None, chosen: Collection[str]) -> list[dict[str, Any]]:
    """Estimates of the candidates that were not selected, all candidates fitted together."""
    if whole is None:
        return []
    rows = enumerate(whole.names)
    return [{"term": n, "estimate": whole.estimate[k], "se": whole.se[k]} for k, n in rows if n not in chosen]


def _together(whole: EquationErrorFit | None, names: Sequence[str], X: Array) -> dict[str, Any]:
    """Sizes of all regressors; and all candidates fitted together, estimates and their colored covariance."""
    sizes = np.sqrt(np.nanmean(np.where(np.isfinite(X), X, np.nan) ** 2, axis=0))
    known: dict[str, Array | None] = {"estimate": None, "covariance": None}
    if whole is not None:
        known = {"estimate": whole.estimate, "covariance": whole.covariance}
    return {"terms": names, "rms": sizes, "fitted": [] if whole is None else list(whole.names), **known}


def ranking(selection: Selection, most: int = 60) -> list[dict[str, Any]]:
    """Rows of the ranking as plain values, the first `most`."""
    return [{f.name: getattr(row, f.name) for f in fields(Row)} for row in selection.rows[:most]]


def plain(value: Any) -> Any:
    """A value for JSON: arrays as lists, NaN and infinities as None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(v) for v in value]
    if isinstance(value, str) or value is None:
        return value
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    return float(value) if np.isfinite(value) else None


def _selected(
    identified: Identified, units: Sequence[str] | None, propagated: Propagated | None
) -> list[dict[str, Any]]:
    fitted, rows = identified.fit, []
    frequency = identified.frequency
    for k, column in enumerate(identified.found.columns):
        row = {
            "term": fitted.names[k],
            "estimate": fitted.estimate[k],
            "se": fitted.se[k],
            "white_se": fitted.white_se[k],
            "unit": "1" if units is None else units[column],
        }
        if identified.bootstrap is not None:
            row["bootstrap_se"] = identified.bootstrap.se[k]
        if frequency is not None:
            row["frequency"] = frequency.frequency[column]
        if propagated is not None:
            row["differentiation_sd"], row["differentiation_shift"] = propagated.sd[k], propagated.shift[k]
        rows.append(row)
    return rows


def _signal_to_noise(identified: Identified, propagated: Propagated | None) -> float:
    """Standard deviation of the data over that of their noise.

    Positions are smoothed before they are differentiated, so the response's own floor may be far below the noise that
    it carries; the larger of both counts.
    """
    z = identified.stack.z
    spread = np.sqrt(np.mean([np.nanvar(z[identified.stack.blocks == b]) for b in np.unique(identified.stack.blocks)]))
    return float(spread) / max(identified.noise.sd, 0.0 if propagated is None else propagated.response_sd)


def _exchanged(identified: Identified) -> dict[str, Any] | None:
    changed = identified.found.exchanged
    if changed is None:
        return None
    return {"pse": changed.pse, "pse_before": changed.start, "moves": [move._asdict() for move in changed.moves]}


def _sensitivity(selection: Selection) -> list[dict[str, Any]]:
    return [
        {"sigma_max2": s.sigma_max2, "low": s.low, "high": s.high, "terms": list(s.terms)}
        for s in selection.sensitivity()
        if s.n <= max(_MOST_TERMS, selection.minimum + _MOST_TERMS // 2)
    ]


def _frequency(identified: Identified) -> dict[str, Any] | None:
    """Shares of the replicates that keep each term, under the ceiling and multiples of it."""
    frequency = identified.frequency
    if frequency is None:
        return None
    often = np.flatnonzero(np.maximum(frequency.frequency, frequency.by_sigma_max.max(axis=0)) >= _OFTEN)
    return {
        "replicates": frequency.replicates,
        "terms": {frequency.names[j]: frequency.frequency[j] for j in often},
        "ceilings": list(CEILINGS),
        "by_ceiling": {frequency.names[j]: frequency.by_sigma_max[:, j] for j in often},
    }


def _collinearity(X: Array, names: Sequence[str]) -> dict[str, Any]:
    near = collinearity(X, list(names))
    return {
        "max_correlation": near.max_correlation,
        "pair": list(near.pair),
        "max_vif": near.max_vif,
        "condition_index": near.condition_index,
        "flagged": list(near.flags),
        "sentences": list(near.sentences),
    }


def _residual(identified: Identified, dt: float) -> dict[str, Any]:
    colored = autocorrelation(identified.fit.noise, dt)
    step = max(len(colored.lag) // _LAGS, 1)
    return {
        "rms": identified.fit.rms,
        "autocorrelation_time": colored.integrated_time,
        "lag": colored.lag[::step],
        "autocorrelation": colored.correlation[::step],
        "frequency": colored.frequency,
        "spectrum": colored.spectrum,
    }


def _press(stack: Stack, columns: list[int]) -> dict[str, Any]:
    """Prediction of tenths of the record from the rest (PRESS); the reason if it is not possible."""
    folds = np.empty(stack.z.size, dtype=np.intp)
    for block in np.unique(stack.blocks):
        rows = np.flatnonzero(stack.blocks == block)
        folds[rows] = stack.groups[block == stack.blocks][0] * _FOLDS + np.arange(rows.size) * _FOLDS // rows.size
    try:
        left_out = press(stack.X[:, columns], stack.z, folds=folds, components=stack.components)
    except InputError as error:
        return {"ratio": None, "r2": None, "reason": str(error)}
    return {"ratio": left_out.ratio, "r2": left_out.r2, "reason": None}
