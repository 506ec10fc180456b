"""Records in, draws out: what every script of this folder shares, and what is not counted as lines of a user's own.

Knows nothing of bayeschute; NumPy alone. A folder holds ``problem.json``, ``record.csv``, ``next.csv``; a script adds
``answer.npz`` and ``answer.json``. SI throughout.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

WANTED = 1.05  # R-hat
MOTIONS = 200  # draws of the next flight
MOST = 600  # processor seconds after which a script is ended


def read() -> SimpleNamespace:
    """The problem of the folder named on the command line: its tables as arrays by column, its numbers by name.

    ``limit`` are the processor seconds that the script may spend, its imports included.
    """
    resource.setrlimit(resource.RLIMIT_CPU, (MOST, MOST + 5))
    folder = Path(sys.argv[1])
    told = json.loads((folder / "problem.json").read_text(encoding="utf-8"))
    made = SimpleNamespace(folder=folder, limit=float(sys.argv[2]), **told)
    for name in ("record", "next"):
        path = folder / f"{name}.csv"
        columns = path.read_text(encoding="utf-8").splitlines()[0].split(",")
        setattr(made, name, dict(zip(columns, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True)))
    return made


def left(limit: float) -> float:
    """Processor seconds left of a limit."""
    return limit - time.process_time()


def rhat(chains: Any) -> float:
    """Largest split R-hat of chains (chain, draw, parameter)."""
    x = np.asarray(chains)
    half = x.shape[1] // 2
    x = np.concatenate([x[:, :half], x[:, half : 2 * half]])
    within = x.var(axis=1, ddof=1).mean(axis=0)
    between = x.mean(axis=1).var(axis=0, ddof=1)
    return float(np.sqrt((half - 1) / half + between / np.maximum(within, 1e-300)).max())


def thinned(chains: Any) -> Any:
    """Draws for the next flight (MOTIONS, parameter), evenly out of chains."""
    flat = np.asarray(chains).reshape(-1, np.shape(chains)[-1])
    return flat[np.linspace(0, len(flat) - 1, MOTIONS).astype(int)]


def write(
    problem: SimpleNamespace,
    packages: Sequence[str],
    names: Sequence[str],
    chains: Any,
    motion: Mapping[str, Any],
    noise: Mapping[str, Any],
    note: str = "",
) -> None:
    """Keep the answer.

    Args:
        problem: From `read`.
        packages: Whose versions are told.
        names: Of the parameters that have a prior.
        chains: Their draws (chain, draw, parameter); no draws where nothing was identified.
        motion: Draws of the next flight, by quantity (N, T).
        noise: Standard deviation of the residuals with each of these draws, by quantity (N,); none where not known.
        note: What a reader must know.
    """
    used = resource.getrusage(resource.RUSAGE_SELF)
    arrays = {f"motion.{k}": v for k, v in motion.items()} | {f"noise.{k}": v for k, v in noise.items()}
    np.savez(problem.folder / "answer.npz", chains=np.asarray(chains, float), **arrays)
    told = {
        "names": list(names), "note": note, "processor_s": used.ru_utime + used.ru_stime,
        "versions": {name: version(name) for name in packages},
    }  # fmt: skip
    (problem.folder / "answer.json").write_text(json.dumps(told), encoding="utf-8")
