"""Results of ``other_flights.py`` as one file per set, each result with commit, command, date, machine and numerics."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

from bayeschute.study.evidence.numerics_compared import comparisons, identical_to
from bayeschute.study.evidence.numerics_hash import PACKAGE, engine, hash_of
from bayeschute.study.evidence.provenance import provenance

ROOT = Path(__file__).parents[1]
SCRIPT = "benchmarks/other_flights.py"


def made_now(letter: str, length: str | None, identify: int = 1) -> dict[str, Any]:
    """Provenance of a result that the present code is about to make.

    Args:
        letter: Of the set; of independent flights kind and seed.
        length: Of the window [s]; None for whole flights.
        identify: Number of the flight that is fitted.
    """
    which = f"--data ../shared/otherflights --sets {letter}" if len(letter) == 1 else f"--independent {letter}"
    window = f" --only-windows --windows {length}" if length else ""
    turned = f" --identify {identify}" if identify != 1 else ""
    return provenance(f"{SCRIPT} {which}{window}{turned}")


def made_at(commit: str, letter: str, length: str | None, date: str, identify: int = 1) -> dict[str, Any]:
    """Provenance of a result that does not tell its own: made by a commit, on this machine with these versions.

    Args:
        commit: Its name.
        letter: Of the set; of independent flights kind and seed.
        length: Of the window [s]; None for whole flights.
        date: When.
        identify: Number of the flight that is fitted.
    """
    code, whole = numerics_at(commit)
    return made_now(letter, length, identify) | {"commit": whole, "date": date, "numerics": code}


def numerics_at(commit: str) -> tuple[str, str]:
    """Hash of the numerics of a commit, as its own code tells it with the engine in use, and the commit's whole name.

    Args:
        commit: Its name.
    """
    whole, packed = (
        subprocess.run(["git", *words], cwd=ROOT, capture_output=True, check=True).stdout
        for words in (["rev-parse", f"{commit}^{{commit}}"], ["archive", commit, "src/bayeschute"])
    )
    tell = "from bayeschute.study.evidence.numerics_hash import numerics; print(numerics())"
    with tempfile.TemporaryDirectory() as place, tarfile.open(fileobj=io.BytesIO(packed)) as files:
        files.extractall(place, filter="data")
        there = os.environ | {"PYTHONPATH": str(Path(place) / "src")}
        told = subprocess.run([sys.executable, "-c", tell], env=there, capture_output=True, check=True).stdout
    return told.decode().strip(), whole.decode().strip()


def store(letter: str, folder: Path, stored: Path, commit: str | None = None) -> Path:
    """Merge the results of a set's working folder into its stored file: a result replaces its own kind only.

    Args:
        letter: Of the set; of independent flights kind and seed.
        folder: Holds ``results.json``.
        stored: Folder of the stored files.
        commit: That made those results that do not tell.

    Returns:
        The stored file.
    """
    source, path = folder / "results.json", stored / f"{letter}.json"
    held: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {"set": letter}
    text = source.read_text(encoding="utf-8")
    for place in (folder.absolute(), folder.resolve(), folder, ROOT):  # a reason of failure may name a file
        text = text.replace(json.dumps(f"{place}/")[1:-1], "")
    date = datetime.fromtimestamp(source.stat().st_mtime, UTC).strftime("%Y-%m-%d")
    for name, result in json.loads(text, parse_constant=lambda _: None).items():  # infinity is no JSON
        if result.pop("quick", False):
            continue
        number = name.removeprefix("from_") if name.startswith("from_") else ""
        length = None if number or name == "whole" else name.split("_")[-1].removesuffix("s")
        if "provenance" not in result:
            if commit is None:
                raise SystemExit(f"{source}: {name} does not tell what made it: --made-at COMMIT says so")
            result["provenance"] = made_at(commit, letter, length, date, int(number or 1))
        kept = {key: value for key, value in result.items() if key != "key"}
        if number:
            held.setdefault("turned", {})[number] = kept
        elif length is None:
            held["whole"] = kept
        else:
            held.setdefault("windows", {})[length] = kept
    stored.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(held, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path


def present(made: Mapping[str, Any]) -> bool:
    """Whether the code that made a result computes as the present code does but for rounding, on the engine it had.

    Args:
        made: Provenance of the result.
    """
    return made["numerics"] in _present_on(engine(made["versions"]))


@cache
def _present_on(engine_of: str) -> frozenset[str]:
    return identical_to(hash_of(PACKAGE, engine_of), comparisons())
