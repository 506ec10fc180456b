"""Selection of terms at size: time, memory and agreement with naive versions; and the bootstrap against its formula.

Orthogonal functions on 5,000 candidates and 5,000 samples (column-major, correlated), the memory that the selection
adds to its matrix, the same selection by refitting every candidate on a size where that ends, one row of the path
against one pass over the matrix, and standard errors by moving blocks over the colored ones.

    python benchmarks/regression.py [--candidates 5000] [--samples 5000] [--terms 40] [--json]
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
from command import parser_of, print_result

from bayeschute.records.sensors import ornstein_uhlenbeck
from bayeschute.regression.bootstrap import block_bootstrap
from bayeschute.regression.equation_error import fit
from bayeschute.regression.orthogonal import select
from bayeschute.structure.exchange import exchange


def problem(samples: int, candidates: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Correlated candidates and a response of ten of them in noise."""
    X = np.asfortranarray(rng.normal(size=(samples, candidates)))
    X += rng.normal(size=(samples, 8)) @ rng.normal(size=(8, candidates))
    true = rng.choice(candidates, size=10, replace=False)
    return X, X[:, true] @ rng.uniform(0.5, 2.0, size=10) + rng.normal(size=samples)


def timed(call: Callable[[], Any], repeats: int = 1) -> tuple[Any, float]:
    """Result and least wall time [s]."""
    best, result = np.inf, None
    for _ in range(repeats):
        start = time.perf_counter()
        result = call()
        best = min(best, time.perf_counter() - start)
    return result, best


def naive(X: np.ndarray, z: np.ndarray, terms: int) -> list[int]:
    """Forward choice by refitting every candidate."""
    chosen: list[int] = []
    for _ in range(terms):
        squares = np.full(X.shape[1], np.inf)
        for j in set(range(X.shape[1])) - set(chosen):
            columns = X[:, [*chosen, j]]
            rest = z - columns @ np.linalg.lstsq(columns, z, rcond=None)[0]
            squares[j] = rest @ rest
        chosen.append(int(np.argmin(squares)))
    return chosen


def main() -> None:
    """Measure, print, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("--candidates", type=int, default=5000)
    parser.add_argument("--samples", type=int, default=5000)
    parser.add_argument("--terms", type=int, default=40)
    given = parser.parse_args()
    rng = np.random.default_rng(0)
    X, z = problem(given.samples, given.candidates, rng)
    size = X.nbytes / 2**20
    found, seconds = timed(lambda: select(X, z, noise_variance=1.0, max_terms=given.terms))
    _, one_pass = timed(lambda: X.T @ z, 5)
    tracemalloc.start()
    select(X, z, noise_variance=1.0, max_terms=given.terms)
    added = tracemalloc.get_traced_memory()[1] / 2**20
    tracemalloc.stop()
    print(f"{given.candidates} candidates x {given.samples} samples: matrix {size:.0f} MiB")
    print(f"orthogonal functions, {len(found.rows)} rows: {seconds:.2f} s, {added:.0f} MiB beside the matrix")
    print(
        f"one row takes {seconds / len(found.rows) / one_pass:.1f} passes over the matrix (of {1000 * one_pass:.0f} ms)"
    )
    changed, swap = timed(lambda: exchange(found, X, z))
    print(f"exchange of terms, {len(changed.terms)} terms: {swap:.2f} s")
    small_x, small_z = problem(400, 120, rng)
    fast, quick = timed(lambda: select(small_x, small_z, noise_variance=1.0, max_terms=8), 3)
    slow, plain = timed(lambda: naive(small_x, small_z, 8))
    same = list(fast.order) == slow
    print(f"120 candidates x 400 samples, 8 rows: {plain / quick:.0f} times as fast as refitting, same order: {same}")
    t = 0.1 * np.arange(1500)
    swings = np.column_stack([np.ones(1500), np.sin(0.44 * t), np.cos(0.27 * t)])
    ratios = []
    for _ in range(10):
        noisy = swings @ [1.0, 0.5, 0.2] + ornstein_uhlenbeck(0.1, 0.5, 0.1, (1500,), rng)
        ratios.append(block_bootstrap(swings, noisy, rng=rng, replicates=200).se / fit(swings, noisy).se)
    blocks = float(np.mean(ratios))
    print(f"standard errors by moving blocks over colored ones, mean of 10 records: {blocks:.2f}")
    named = {
        "mof_row_over_matrix_pass_time_ratio": seconds / len(found.rows) / one_pass,
        "mof_added_over_matrix_memory_ratio": added / size,
        "mof_over_refitting_speedup": plain / quick,
        "block_bootstrap_over_colored_se_ratio": blocks,
    }
    context = {"seconds": seconds, "exchange_s": swap, "rows": len(found.rows), "same_order_as_refitting": same}
    print_result(given, named, context | vars(given))


if __name__ == "__main__":
    main()
