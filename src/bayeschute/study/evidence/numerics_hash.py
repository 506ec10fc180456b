"""Hash of the numerics: the code that computes results, without comments and docstrings, and the engine it runs on.

Stored replicates speak for the code that made them. A version string does not know whether a line of it has changed.
"""

from __future__ import annotations

import ast
import hashlib
import io
import tokenize
from collections.abc import Mapping
from functools import cache
from importlib.metadata import version
from pathlib import Path

PACKAGE = Path(__file__).parents[2]
ROOMS = (
    "aero", "atmosphere", "compiler", "core", "dynamics", "likelihood", "posterior", "prediction", "records",
    "regression", "structure", "virtual", "study/assembly", "study/run", "calibration", "study/replicate.py",
)  # fmt: skip
"""Folders and files of the package whose code results depend on."""
NO_NUMBERS = (
    "core/errors.py", "core/pace.py", "core/version.py", "prediction/data_dictionary.py", "study/run/log.py",
    "study/run/stage_report.py", "study/run/failure.py", "study/run/stages.py", "calibration/label.py",
    "calibration/domain.py", "calibration/promises.py", "calibration/campaign.py", "calibration/workers.py",
    "calibration/replicate_rows.py", "records/plausibility",
)  # fmt: skip
"""Files and folders of these without numerics of a fit or a prediction."""
ENGINE = ("jax", "numpy", "scipy")


def code_of(text: str) -> str:
    """Python source without comments, blank lines and docstrings."""
    dropped = set[int]()
    for node in ast.walk(ast.parse(text)):
        body = getattr(node, "body", None)
        if isinstance(body, list) and body and isinstance(body[0], ast.Expr):
            first = body[0].value
            if isinstance(first, ast.Constant) and isinstance(first.value, str):
                dropped |= set(range(body[0].lineno, (body[0].end_lineno or body[0].lineno) + 1))
    lines = text.splitlines()
    if "#" in text:
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type == tokenize.COMMENT:
                row, column = token.start
                lines[row - 1] = lines[row - 1][:column]
    kept = (line.rstrip() for number, line in enumerate(lines, 1) if number not in dropped)
    return "\n".join(line for line in kept if line)


def hash_of(package: Path, on: str) -> str:
    """SHA-256 of the numerics of a package.

    Args:
        package: Its folder.
        on: What its code runs on, from `engine`.
    """
    made = hashlib.sha256(on.encode())
    left_out = [package / name for name in NO_NUMBERS]
    for room in ROOMS:
        place = package / room
        for path in [place] if place.is_file() else sorted(place.rglob("*.py")):
            if not any(path.is_relative_to(one) for one in left_out):
                made.update(f"\n{path.relative_to(package).as_posix()}\n{code_of(path.read_text('utf-8'))}".encode())
    return made.hexdigest()


def engine(versions: Mapping[str, str]) -> str:
    """The libraries that compute, with their minor versions.

    Args:
        versions: Of packages, by name.
    """
    return ", ".join(f"{name} {'.'.join(versions[name].split('.')[:2])}" for name in ENGINE)


@cache
def numerics() -> str:
    """Hash of the numerics in use: code, and the minor versions of the libraries that compute."""
    return hash_of(PACKAGE, engine({name: version(name) for name in ENGINE}))
