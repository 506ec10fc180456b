"""What a first run of a study costs: with an empty cache of compiled functions, and again with what it left there.

    python benchmarks/first_run.py [--study models/studies/cdt-3-11.toml] [--beside CHECKOUT] [--json]

Each run is a process of its own. Of every run: processor seconds and wall seconds, functions that XLA compiled and the
seconds that it took, programs of the code generator, processor seconds of every stage. ``--beside`` runs the code of
another checkout in the same way, by the same interpreter, turn about, and prints ratios.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from command import parser_of, print_result

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "models" / "studies" / "cdt-3-11.toml"
STAGES = ("ingest", "structure", "priors", "fit", "check", "predict", "risk", "report")
_PROBE = """
import json, sys, time
from pathlib import Path

study, out, result = map(Path, sys.argv[1:])
from bayeschute.study.load import load_study
from bayeschute.study.run import stages

import jax

counted = {"compilations": 0, "compile_s": 0.0, "kept": 0}

def heard(event, seconds, **_):
    if event.endswith("backend_compile_duration"):
        counted["compilations"] += 1
        counted["compile_s"] += seconds
    counted["kept"] += event.endswith("cache_retrieval_time_sec")

jax.monitoring.register_event_duration_secs_listener(heard)
began, spent = time.perf_counter(), []

def progress(stage, share, words):
    if not spent or spent[-1][0] != stage:
        spent.append((stage, time.process_time()))

stages.run_study(load_study(study), out, progress=progress)
ends = [at for _, at in spent[1:]] + [time.process_time()]
result.write_text(json.dumps({
    **counted, "processor_s": time.process_time(), "wall_s": time.perf_counter() - began,
    "stages": {stage: end - at for (stage, at), end in zip(spent, ends)},
}))
"""


def measured(source: Path, study: Path, cache: Path) -> dict[str, Any]:
    """One run of a study by the code under a checkout's ``src``, with compiled functions kept in `cache`.

    Args:
        source: The checkout.
        study: The study.
        cache: Folder of compiled functions.

    Returns:
        Counts and seconds.

    Raises:
        subprocess.CalledProcessError: If the run fails.
    """
    with tempfile.TemporaryDirectory() as place:
        result = Path(place) / "result.json"
        environment = os.environ | {"PYTHONPATH": str(source / "src"), "BAYESCHUTE_CACHE": str(cache)}
        command = [sys.executable, "-c", _PROBE, str(study), str(Path(place) / "run"), str(result)]
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
        made: dict[str, Any] = json.loads(result.read_text(encoding="utf-8"))
    return made | {"programs": sum(1 for _ in (cache / "kernels").glob("*.o"))}


def main() -> None:
    """Run, print the table, and the ratios to the other checkout."""
    parser = parser_of(__doc__)
    parser.add_argument("--study", type=Path, default=STUDY)
    parser.add_argument("--beside", type=Path, metavar="CHECKOUT", help="other code, run in the same way")
    given = parser.parse_args()
    sources = {"here": ROOT} | ({"beside": given.beside.resolve()} if given.beside else {})
    found: dict[str, dict[str, dict[str, Any]]] = {name: {} for name in sources}
    with tempfile.TemporaryDirectory() as place:
        for state in ("empty", "filled"):
            for name, source in sources.items():
                found[name][state] = measured(source, given.study.resolve(), Path(place) / name)
                print(_row(name, state, found[name][state]), flush=True)
    ratios = {f"{name}.empty_over_filled": _ratio(one["empty"], one["filled"]) for name, one in found.items()}
    for state in ("empty", "filled") if given.beside else ():
        ratios[f"here_over_beside.{state}"] = _ratio(found["here"][state], found["beside"][state])
    for name, value in ratios.items():
        print(f"{name:28s}{value:6.2f}")
    print_result(given, ratios, {"study": given.study.name, "runs": found})


def _ratio(one: dict[str, Any], other: dict[str, Any]) -> float:
    return float(one["processor_s"] / other["processor_s"])


def _row(name: str, state: str, made: dict[str, Any]) -> str:
    stages = ", ".join(f"{stage} {made['stages'].get(stage, 0.0):.1f}" for stage in STAGES)
    return (
        f"{name:8s}cache {state:8s}{made['processor_s']:7.1f} s of processor, {made['wall_s']:6.1f} s of wall; "
        f"{made['compilations'] - made['kept']} functions compiled by XLA in {made['compile_s']:.1f} s, "
        f"{made['programs']} programs; of the stages [s]: {stages}"
    )


if __name__ == "__main__":
    main()
