"""What a user would pick instead: aeroid, PINTS, numpyro with diffrax, emcee with SciPy, RocketPy, on the same records.

    python benchmarks/rivals.py [--python PYTHON] [--cases swing-gusts ...] [--seeds 1 2 3] [--limit 40] [--store PLACE]

Makes records by bayeschute's virtual flights (`rivals_records.py`), lets every script of ``benchmarks/rivals`` find
parameters and predict, each in a process of its own, and scores them against the truth (`rivals_scores.py`). PYTHON is
an interpreter that has the packages; without one an environment is made by venv and pip in a temporary folder. The
limit is told to a script, which stops in time; one that takes many times as long is ended and fails.
With ``--store`` the result of every case is one JSON file; ``rivals_page.py`` writes the page from these.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from statistics import mean
from time import time as clock
from typing import Any, NamedTuple

import numpy as np
from command import parser_of, print_result
from other_programs import interpreter
from rivals_records import CASES, Truth, make
from rivals_scores import band_scores, lines, parameter_scores, split_rhat

from bayeschute.study.evidence.provenance import provenance

ROOT = Path(__file__).parents[1]
SCRIPTS = Path(__file__).with_name("rivals")
PACKAGES = ("aeroid>=0.5,<0.6", "pints>=0.6,<0.7", "numpyro>=0.18", "diffrax>=0.7", "emcee>=3.1", "rocketpy>=1.13")
CLOCK = 3600.0  # seconds on the clock after which a script is ended


class Program(NamedTuple):
    """A program as a user would write it.

    Attributes:
        name: Shown.
        script: Stem of the script, less the case's kind.
        options: Of the script.
    """

    name: str
    script: str
    options: tuple[str, ...] = ()


PROGRAMS = (
    Program("bayeschute", "bayeschute"),
    Program("emcee with SciPy", "emcee"),
    Program("PINTS", "pints"),
    Program("PINTS, AR(1)", "pints", ("--ar1",)),
    Program("numpyro with diffrax", "numpyro_diffrax"),
    Program("numpyro with diffrax, AR(1)", "numpyro_diffrax", ("--ar1",)),
    Program("aeroid", "aeroid"),
    Program("RocketPy MonteCarlo", "rocketpy"),
)
CANNOT = {
    ("rocketpy", "swing"): "its parachute is a point with a drag area: it has no swing and no coefficients to find",
    ("rocketpy", "cluster"): "its parachute is a point with a drag area: it has no swing and no coefficients to find",
    ("aeroid", "swing"): "not written: it can express it, with emcee's likelihood and the start taken as known",
    ("aeroid", "cluster"): "not written: it can express it, with emcee's likelihood and the start taken as known",
    ("numpyro_diffrax --ar1", "descent"): "not written for the descent: PINTS' AR(1) stands for such a likelihood",
}


def script_of(program: Program, case: str) -> Path:
    """The script of a program for a case; rivals see a cluster as a planar dumbbell."""
    kind = case.partition("-")[0]
    own = SCRIPTS / f"{program.script}_{kind}.py"
    return own if own.is_file() or kind != "cluster" else SCRIPTS / f"{program.script}_swing.py"


def unable(program: Program, case: str) -> str:
    """Why a program can't be asked; empty where it can."""
    words = " ".join((program.script, *program.options))
    return CANNOT.get((words, case.partition("-")[0]), "")


def ask(program: Program, case: str, folder: Path, python: str, limit: float) -> dict[str, Any]:
    """One answer: how it ended, and what it told."""
    for old in folder.glob("answer.*"):
        old.unlink()
    script, ours = script_of(program, case), program.script == "bayeschute"
    command = [sys.executable if ours else python, str(script), str(folder), str(limit), *program.options]
    paths = os.pathsep.join(filter(None, (str(ROOT / "src"), os.environ.get("PYTHONPATH")))) if ours else ""
    began = clock()
    try:
        ran = subprocess.run(
            command, capture_output=True, text=True, timeout=CLOCK,
            env=os.environ | {"PYTHONPATH": paths, "PYTHONWARNINGS": "ignore"},
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return {"failed": f"did not end within {CLOCK:.0f} s on the clock"}
    if ran.returncode == -signal.SIGXCPU:
        return {"failed": "did not end within the processor time that ends any script"}
    told = folder / "answer.json"
    if ran.returncode or not told.is_file():
        said = [line for line in ran.stderr.splitlines() if line.strip()]
        return {"failed": plain(said[-1] if said else "no answer", folder), "wall_s": clock() - began}
    return {"wall_s": clock() - began, **json.loads(told.read_text(encoding="utf-8"))}


def plain(said: str, folder: Path) -> str:
    """An error's words without a module's path and without places on this machine."""
    for place in (folder, SCRIPTS, ROOT):
        said = said.replace(f"{place}/", "").replace(str(place), "")
    head, _, rest = said.partition(": ")
    return f"{head.rpartition('.')[2]}: {rest}" if rest else said


def scored(answer: dict[str, Any], truth: Truth, folder: Path) -> dict[str, Any]:
    """An answer with its scores against the truth.

    Args:
        answer: From `ask`.
        truth: Of the record.
        folder: Holds the draws.
    """
    if "failed" in answer:
        return answer
    with np.load(folder / "answer.npz") as drawn:
        chains, bands = drawn["chains"], {}
        for name, history in truth.motion.items():
            key, noise = f"motion.{name}", f"noise.{name}"
            if key not in drawn.files:
                continue
            absolute = truth.absolute and name == "swing_angle"
            motion = np.abs(drawn[key]) if absolute else drawn[key]
            bands[name] = band_scores(truth.time, motion, history)
            if noise in drawn.files and not absolute:
                bands[name]["with_noise"] = band_scores(truth.time, motion, history, drawn[noise])
    return answer | {
        "rhat": split_rhat(chains),
        "parameters": parameter_scores(answer["names"], chains, truth.parameters),
        "bands": bands,
    }


def summary(answers: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means over seeds of one program's answers."""
    sound = [a for a in answers if "failed" not in a]
    rows = [p for a in sound for p in a["parameters"].values()]
    made: dict[str, Any] = {"records": len(answers), "failed": len(answers) - len(sound)}
    made["processor_s"] = mean(a["processor_s"] for a in sound) if sound else None
    rhats = [a["rhat"] for a in sound if np.isfinite(a["rhat"])]
    made["worst_rhat"] = max(rhats) if rhats else None
    made["intervals"], made["intervals_held"] = len(rows), sum(p["held"] for p in rows)
    made["error"] = float(np.sqrt(mean(p["error"] ** 2 for p in rows))) if rows else None
    for name in sorted({q for a in sound for q in a["bands"]}):
        for kind in ("", "with_noise"):
            found = [a["bands"][name] for a in sound if name in a["bands"]]
            found = [b.get(kind, {}) if kind else b for b in found]
            found = [b for b in found if "held" in b]
            if found:
                keys = ("held", "width", "wis")
                made[f"{name}{'.' if kind else ''}{kind}"] = {k: mean(b[k] for b in found) for k in keys}
    return made


def run_case(
    case: str, seeds: Iterable[int], programs: Sequence[Program], python: str, limit: float, place: Path
) -> dict[str, Any]:
    """All programs on all records of a case."""
    answers: dict[str, dict[str, Any]] = {p.name: {} for p in programs if not unable(p, case)}
    for seed in seeds:
        folder = place / f"{case}-{seed}"
        truth = make(case, seed, folder)
        for program in programs:
            if program.name not in answers:
                continue
            if not script_of(program, case).is_file():
                continue
            one = scored(ask(program, case, folder, python, limit), truth, folder)
            answers[program.name][str(seed)] = one
            print(f"{case} {seed}  {program.name:28} {told(one)}", flush=True)
    counted = {
        p.name: {"lines": lines(script_of(p, case).read_text(encoding="utf-8")), "script": script_of(p, case).name}
        for p in programs
        if p.name in answers
    }
    return {
        "case": case, "limit_s": limit,
        "programs": {
            name: counted[name] | {"summary": summary(list(by_seed.values())), "seeds": by_seed}
            for name, by_seed in answers.items()
        },
        "unable": {p.name: why for p in programs if (why := unable(p, case))},
    }  # fmt: skip


def told(one: Mapping[str, Any]) -> str:
    """An answer on one line."""
    if "failed" in one:
        return f"failed: {one['failed'][:150]}"
    held = [p["held"] for p in one["parameters"].values()]
    bands = "  ".join(f"{q} {b.get('held', float('nan')):.0%}" for q, b in one["bands"].items())
    return f"{one['processor_s']:6.1f} s  R-hat {one['rhat']:.3f}  held {sum(held)}/{len(held)}  {bands}  {one['note']}"


def no_nan(value: Any) -> Any:
    """Numbers that JSON doesn't know as None."""
    if isinstance(value, dict):
        return {key: no_nan(v) for key, v in value.items()}
    return None if isinstance(value, float) and not np.isfinite(value) else value


def main() -> None:
    """Make, ask, score, print, store."""
    parser = parser_of(__doc__)
    parser.add_argument("--python", help="an interpreter with the rivals' packages; default: one is made")
    parser.add_argument("--packages", nargs="+", default=PACKAGES, help="for pip")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=CASES)
    parser.add_argument("--seeds", nargs="+", type=int, default=[1, 2, 3])
    parser.add_argument("--programs", nargs="+", help=f"of: {', '.join(p.name for p in PROGRAMS)}")
    parser.add_argument("--limit", type=float, default=40.0, help="processor seconds of a fit that a script may take")
    parser.add_argument("--store", type=Path, help="folder of the stored results")
    given = parser.parse_args()
    programs = [p for p in PROGRAMS if given.programs is None or p.name in given.programs]
    only = f" --programs {' '.join(json.dumps(p.name) for p in programs)}" if given.programs else ""
    results = {}
    with tempfile.TemporaryDirectory() as name:
        python = interpreter(given.python, given.packages, Path(name))
        for case in given.cases:
            results[case] = run_case(case, given.seeds, programs, python, given.limit, Path(name))
            seeds = " ".join(map(str, given.seeds))
            made = provenance(
                f"benchmarks/rivals.py --cases {case} --seeds {seeds} --limit {given.limit:g}{only}"
                " --store models/reference/rivals"
            )
            result = no_nan(results[case]) | {"provenance": made}
            if given.store:
                given.store.mkdir(parents=True, exist_ok=True)
                text = json.dumps(result, indent=1, ensure_ascii=False) + "\n"
                (given.store / f"{case}.json").write_text(text, encoding="utf-8")
    print_result(given, {c: {n: p["summary"] for n, p in r["programs"].items()} for c, r in results.items()}, {})


if __name__ == "__main__":
    main()
