"""Predictions of one flight averaged over model structures in proportion to their weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bayeschute.core.errors import Fault, InputError
from bayeschute.prediction.bands import Prediction

BETWEEN = "structure"  # source of the variance between structures


def mix(parts: Sequence[Prediction]) -> Prediction:
    """One prediction from those of several structures, each with as many draws as its weight gives it.

    The variance of the mixture is that within structures, on average over draws, plus that of the structures' means;
    the latter is a separate source among the shares.

    Args:
        parts: Predictions of the same flight, draws in proportion to the weights.

    Returns:
        All draws together; the prediction itself where there is only one.

    Raises:
        InputError: If there is none, or times or quantities differ.
    """
    if not parts:
        raise InputError(Fault("mixture of predictions", "none", "one at least"))
    first = parts[0]
    for other in parts[1:]:
        if not np.array_equal(other.time, first.time) or set(other.draws) != set(first.draws):
            raise InputError(Fault("mixture of predictions", "times or quantities that differ", "one flight's"))
    if len(parts) == 1:
        return first
    draws = {name: np.concatenate([p.draws[name] for p in parts]) for name in first.draws}
    shares = {name: _shares(name, parts) for name in first.draws}
    last = np.concatenate([p.last for p in parts])
    why = "; ".join(dict.fromkeys(p.why for p in parts if p.why))
    return Prediction(first.time, draws, last, sum(p.failed for p in parts), shares, why)


def _shares(name: str, parts: Sequence[Prediction]) -> Mapping[str, float]:
    """Shares of a quantity's variance by source, averaged over the flight, the structures' among them."""
    weight = np.array([np.isfinite(p.draws[name]).all(axis=1).sum() for p in parts], float)
    used = [(w, p) for w, p in zip(weight / max(weight.sum(), 1.0), parts, strict=True) if w > 0.0]
    if not used:
        return {**dict.fromkeys(parts[0].shares[name], 0.0), BETWEEN: 0.0}
    means = np.array([np.nanmean(p.draws[name], axis=0) for _, p in used])
    by = np.array([w for w, _ in used])
    between = float(np.mean(by @ (means - by @ means) ** 2))
    within = {source: 0.0 for source in parts[0].shares[name]}
    for w, p in used:
        variance = float(np.mean(np.nanvar(p.draws[name], axis=0)))
        for source, share in p.shares[name].items():
            within[source] = within.get(source, 0.0) + w * variance * share
    total = between + sum(within.values())
    found = {**within, BETWEEN: between}
    return {source: value / total if total > 0.0 else 0.0 for source, value in found.items()}
