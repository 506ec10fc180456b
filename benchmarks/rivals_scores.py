"""Lines of a script, and what an answer is worth against the truth."""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from other_scores import History, score

Array = NDArray[np.float64]
LEVELS = (0.05, 0.5, 0.95)
_SILENT = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)


def lines(source: str) -> int:
    """Lines of a script that a user has to write: neither blank, nor comment, nor docstring.

    Args:
        source: Of the script.
    """
    told = set[int]()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _SILENT:
            told.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef) and ast.get_docstring(node) is not None:
            said = node.body[0]
            told -= set(range(said.lineno, (said.end_lineno or said.lineno) + 1))
    return len(told)


def split_rhat(chains: Array) -> float:
    """Largest split R-hat of chains (chain, draw, parameter); NaN where there are too few draws."""
    half = chains.shape[1] // 2
    if half < 2 or chains.shape[2] == 0:
        return float("nan")
    x = np.concatenate([chains[:, :half], chains[:, half : 2 * half]])
    within, between = x.var(axis=1, ddof=1).mean(axis=0), x.mean(axis=1).var(axis=0, ddof=1)
    return float(np.sqrt((half - 1) / half + between / np.maximum(within, 1e-300)).max())


def parameter_scores(names: Iterable[str], chains: Array, truth: Mapping[str, float]) -> dict[str, Any]:
    """Per parameter: mean, sd, error over the truth's own size, whether the central 90 % interval holds the truth.

    Args:
        names: Of the parameters.
        chains: Draws (chain, draw, parameter).
        truth: By name.
    """
    if not chains.size:
        return {}
    flat = chains.reshape(-1, chains.shape[-1])
    made = {}
    for name, x in zip(names, flat.T, strict=True):
        if name in truth:
            low, high = np.quantile(x, [LEVELS[0], LEVELS[-1]])
            size = 1.0 if name.startswith("log_") else abs(truth[name])  # an error of a logarithm is relative already
            made[name] = {
                "mean": float(x.mean()), "sd": float(x.std()), "truth": truth[name],
                "error": float((x.mean() - truth[name]) / size), "held": bool(low <= truth[name] <= high),
            }  # fmt: skip
    return made


def band_scores(time: Array, draws: Array, truth: Array, noise: Array | None = None, seed: int = 0) -> dict[str, Any]:
    """What the 90 % band of draws holds of a history; with noise, the band of what would be recorded.

    Args:
        time: (T,) [s].
        draws: Motion (N, T).
        truth: (T,).
        noise: Standard deviation of white noise with each draw (N,).
        seed: Of that noise.
    """
    if noise is not None:
        draws = draws + noise[:, None] * np.random.default_rng(seed).standard_normal(draws.shape)
    sound = draws[np.isfinite(draws).all(axis=1)]
    if len(sound) < 2:
        return {"failed_draws": int(len(draws) - len(sound))}
    one = score(time, np.quantile(sound, LEVELS, axis=0), [History(time, truth)])
    return {
        "held": one.held, "width": one.width, "bias": one.bias, "wis": one.wis,
        "failed_draws": int(len(draws) - len(sound)),
    }  # fmt: skip
