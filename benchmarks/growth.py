"""How do time and memory of a fit grow with the number of flights, and with the length of a record?

    python benchmarks/growth.py [--flights 1 4 10] [--own 1 4 10] [--minutes 2.5 10] [--kept FILE] [--quick] [--json]

The identified flight of a study is flown several times, each time with other gusts and sensor errors, and all are
fitted together: with the parameters of the study, and (``--own``) with constant errors of every record's wind, canopy
positions and attitude as parameters of its own. And it is flown once for so many minutes. Each fit is a process of its
own. Told are processor seconds of the stage without those in which XLA compiled, the memory that the process took at
most beyond what it had before, and by which power of the size both grow (least squares of logarithms). The page
docs/growth.md is written from them. With ``--kept`` fits are kept in a file, and the same command goes on where it was.

With ``--quick`` fits are small: nothing is written unless ``--out`` says where, and nothing is for use.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from command import parser_of, print_result
from planning import machine

from bayeschute.study.evidence.provenance import provenance

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "models" / "studies" / "cdt-3-11.toml"
PAGE = ROOT / "docs" / "growth.md"
SIZES = {"flights": (1, 4, 10), "own": (1, 4, 10), "minutes": (2.5, 10.0)}
WORDS = {"flights": "flights", "own": "flights with errors of their own", "minutes": "minutes of one flight"}
_CLIMB = 9.0  # [m] that a flight begins higher for every second that it lasts longer: what it sinks in one, and a fifth
_PROBE = """
import json, resource, sys, time
from dataclasses import replace
from pathlib import Path

told = json.loads(sys.argv[1])
from bayeschute.study.load import load_study
from bayeschute.study.run import stages
from bayeschute.study.schema.belief_schema import Bias

import jax

compiling = 0.0

def heard(event, spent, **_):
    global compiling
    compiling += spent if event.endswith("backend_compile_duration") else 0.0

jax.monitoring.register_event_duration_secs_listener(heard)

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)

study = load_study(told["study"])
(flown,) = [flight for flight in study.flights if "identify" in flight.roles]
seconds = told["seconds"] or flown.virtual.duration
higher = told["climb"] * max(seconds - flown.virtual.duration, 0.0)
sized = flown.virtual.model_copy(update={"duration": seconds, "altitude": flown.virtual.altitude + higher})
flights = [replace(flown, virtual=sized)]
for number in range(2, told["flights"] + 1):
    flights.append(replace(flown, name=f"{flown.name}-{number}", roles=("identify",), virtual=sized))
priors = study.priors
if told["own"]:
    errors = {"wind_bias": 1.0, "canopy_position_bias": 0.5, "capsule_attitude_bias": 0.0087}
    given = priors.given.model_copy(update={name: Bias[float](sd=sd) for name, sd in errors.items()})
    priors = priors.model_copy(update={"given": given})
study = replace(study, flights=tuple(flights), priors=priors)
stages.run_study(study, told["out"], until="priors", quick=told["quick"])
before, began, compiled = peak(), time.process_time(), compiling
stages.run_study(study, told["out"], until="fit", resume=True, quick=told["quick"])
spent = time.process_time() - began
fitted = json.loads((Path(told["out"]) / "fit" / "priors.json").read_text(encoding="utf-8"))
Path(told["result"]).write_text(json.dumps({
    "parameters": len(fitted), "processor_s": spent, "compiling_s": compiling - compiled, "bytes": peak() - before,
}))
"""


def fitted(what: str, size: float, quick: bool, cache: Path) -> dict[str, Any]:
    """Cost of one fit, in a process of its own.

    Args:
        what: Key of `SIZES`.
        size: How many flights, or minutes.
        quick: Small sizes of everything.
        cache: Folder of compiled functions.

    Returns:
        Number of parameters, processor seconds of the fit and those in which XLA compiled, memory [byte], commit.

    Raises:
        SystemExit: If the fit fails, with what it said.
    """
    minutes = what == "minutes"
    with tempfile.TemporaryDirectory() as place:
        result = Path(place) / "result.json"
        told = {
            "study": str(STUDY), "out": str(Path(place) / "run"), "result": str(result), "quick": quick,
            "flights": 1 if minutes else int(size), "own": what == "own",
            "seconds": 60.0 * size if minutes else None, "climb": _CLIMB,
        }  # fmt: skip
        environment = os.environ | {"PYTHONPATH": str(ROOT / "src"), "BAYESCHUTE_CACHE": str(cache)}
        command = [sys.executable, "-c", _PROBE, json.dumps(told)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"{size:g} {WORDS[what]}: the fit failed.\n{done.stderr[-2000:]}")
        made: dict[str, Any] = json.loads(result.read_text(encoding="utf-8"))
    return made | {"commit": str(provenance("growth.py")["commit"])}


def kept(file: Path | None) -> dict[str, dict[float, dict[str, Any]]]:
    """Fits of an earlier run, by what grew and size."""
    found = dict[str, dict[float, dict[str, Any]]]()
    for line in file.read_text(encoding="utf-8").splitlines() if file is not None and file.exists() else ():
        one = json.loads(line)
        found.setdefault(one.pop("what"), {})[one.pop("size")] = one
    return {what: dict(sorted(found[what].items())) for what in SIZES if what in found}


def seconds(made: Mapping[str, Any]) -> float:
    """Processor seconds of a fit without those in which XLA compiled."""
    return float(made["processor_s"] - made["compiling_s"])


def exponent(costs: Mapping[float, float]) -> float:
    """By which power of the size costs grow: least squares of their logarithms.

    Args:
        costs: By size; two or more.
    """
    slope, _ = np.polyfit(np.log(list(costs)), np.log(list(costs.values())), 1)
    return float(slope)


def exponents(found: Mapping[str, Mapping[float, Mapping[str, Any]]]) -> dict[str, float]:
    """Of time and memory, by what grew."""
    made = dict[str, float]()
    for what, by_size in found.items():
        if len(by_size) > 1:
            made[f"time.{what}"] = exponent({size: seconds(one) for size, one in by_size.items()})
            made[f"memory.{what}"] = exponent({size: one["bytes"] for size, one in by_size.items()})
    return made


def row(what: str, size: float, made: Mapping[str, Any]) -> str:
    """A row of the table."""
    cost = f"{seconds(made):.0f} s | {made['compiling_s']:.0f} s | {made['bytes'] / 2**30:.2f} GiB"
    words = WORDS[what].replace("flights", "flight") if size == 1.0 else WORDS[what]
    return f"| {size:g} {words} | {made['parameters']:.0f} | {cost} | `{made['commit'][:7]}` |"


def page(found: Mapping[str, Mapping[float, Mapping[str, Any]]], here: Mapping[str, Any], command: str) -> str:
    """The page, from what was measured."""
    rows = "\n".join(row(what, size, made) for what, by_size in found.items() for size, made in by_size.items())
    told = exponents(found)
    powers = "\n".join(
        f"| {WORDS[what]} | {told[f'time.{what}']:.2f} | {told[f'memory.{what}']:.2f} |"
        for what in found
        if f"time.{what}" in told
    )
    return f"""<!-- Written by `{command}`; run it again rather than edit. -->

# How a fit grows with flights and records

Measured on {here["date"]}, Python {here["python"]}, on {here["cpu"]}, {here["cores"]} cores, load average
{here["load_average"]} at the end. The flights are those of `models/studies/cdt-3-11.toml`, 90 s at 10 Hz
where no length is told. Errors of their own are constant errors of each recorded wind, canopy positions, attitude.

| fitted together | parameters | processor | compiling, not counted | memory, beyond what the process had | made by |
|---|---|---|---|---|---|
{rows}

They grow by these powers of the size (one: in proportion):

| of | processor time | memory |
|---|---|---|
{powers}

How many iterations a fit takes differs from record to record.
"""


def main() -> None:
    """Fit, print the table, write the page."""
    parser = parser_of(__doc__)
    for name, sizes in SIZES.items():
        parser.add_argument(f"--{name}", nargs="*", type=float, default=sizes, help=f"default: {sizes}")
    parser.add_argument("--kept", type=Path, metavar="FILE", help="fits that are made, one JSON object per line")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, help=f"the page; default: {PAGE.relative_to(ROOT)}, none with --quick")
    given = parser.parse_args()
    found = kept(given.kept)
    with tempfile.TemporaryDirectory(prefix="bayeschute-cache-") as cache:
        for what in SIZES:
            for size in vars(given)[what]:
                if size not in found.setdefault(what, {}):
                    found[what][size] = fitted(what, size, given.quick, Path(cache))
                    if given.kept is not None:
                        with given.kept.open("a", encoding="utf-8") as file:
                            file.write(json.dumps({"what": what, "size": size, **found[what][size]}) + "\n")
                print(row(what, size, found[what][size]), flush=True)
    for name, value in exponents(found).items():
        print(f"{name:16s}{value:6.2f}")
    out = given.out or (None if given.quick else PAGE)
    if out is not None:
        said = " ".join(" ".join([f"--{what}", *(f"{size:g}" for size in vars(given)[what])]) for what in SIZES)
        command = f"python benchmarks/growth.py {said}{' --quick' if given.quick else ''}"
        out.write_text(page(found, machine(), command), encoding="utf-8")
    print_result(given, exponents(found), {"study": STUDY.name, "fits": found})


if __name__ == "__main__":
    main()
