"""What do ten thousand fits and a hundred million descents cost? Measured here, then multiplied, into docs/planning.md.

A fit is a whole replicate of the default study: two virtual flights of 90 s flown, structure selected, posterior drawn,
the unseen flight predicted and scored. The first one is made with an empty compilation cache, as by a worker on a new
machine; the others are what a worker makes from then on. A descent is simulated for 90 s, made three ways: as
states alone, in batches; with its outcome and its steps' error, as risk numbers need it; and as a record with the truth
beside, one by one, as `bayeschute simulate` makes it. Costs are times of the processor, over all threads, so a busy
machine changes them little; the walls are told, too.

    python benchmarks/planning.py [--fits 6] [--batches 20] [--drops 20] [--quick] [--out FILE] [--json]

With --quick fits are small: nothing is written unless --out says where, and nothing is for use.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import sys
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, NamedTuple

import numpy as np
from command import parser_of, print_result

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "planning.md"
FITS, DESCENTS, WORKERS = 10**4, 10**8, 100  # what the page tells; workers among whom fits are shared
SEED = 70_000
BATCH = 64


class Cost(NamedTuple):
    """Time of the processor and of the clock [s] of each of the things done."""

    cpu: list[float]
    wall: list[float]

    @property
    def mean(self) -> float:
        """Time of the processor [s]."""
        return float(np.mean(self.cpu))

    @property
    def error(self) -> float:
        """Standard error of `mean`; not a number for a single one."""
        return float(np.std(self.cpu, ddof=1) / np.sqrt(len(self.cpu))) if len(self.cpu) > 1 else float("nan")

    def over(self, count: int) -> Cost:
        """Where each was a batch of so many."""
        return Cost([t / count for t in self.cpu], [t / count for t in self.wall])

    def told(self) -> dict[str, Any]:
        """For JSON."""
        error = self.error if np.isfinite(self.error) else None
        return {
            "cpu_s": self.mean,
            "standard_error": error,
            "wall_s": float(np.mean(self.wall)),
            "repeats": len(self.cpu),
        }


def costs(work: Callable[[int], Any], numbers: range) -> Cost:
    """Do it once for each number."""
    cpu, wall = [], []
    for number in numbers:
        began, began_wall = process_time(), perf_counter()
        work(number)
        cpu.append(process_time() - began)
        wall.append(perf_counter() - began_wall)
    return Cost(cpu, wall)


def fits(count: int, quick: bool) -> tuple[Cost, Cost]:
    """The first fit, and the others."""
    from bayeschute.study.load import load_study
    from bayeschute.study.replicate import replicate

    study = load_study(ROOT / "models" / "studies" / "cdt-3-11.toml")

    def one(number: int) -> None:
        row = replicate(SEED + number, study, quick=quick)
        if not row["ok"]:
            raise SystemExit(f"a fit failed, so there is nothing to measure: {row['error']}")
        print(f"fit {number + 1} of {count}: {row['wall_s']:.0f} s on the clock", flush=True)

    return costs(one, range(1)), costs(one, range(1, count))


def descents(batches: int, drops: int) -> dict[str, Cost]:
    """Simulated descents by the three ways, first calls left out."""
    import jax
    from simulator_flights import PLAIN, SAMPLES, flights

    from bayeschute.compiler import compiled_model as kernel
    from bayeschute.dynamics.outcome import Outcome, simulate
    from bayeschute.study.load import load_study
    from bayeschute.study.run.simulate import fly_drop, wanted_drops

    given = flights(PLAIN, SAMPLES, BATCH)
    why = kernel.why_not_compiled(*given.all())
    print(f"states by {'machine code' if why is None else f'JAX, since there is no machine code: {why}'}")
    study = load_study(ROOT / "models" / "studies" / "cdt-3-11.toml")
    several = wanted_drops(study, study.flights[:1], drops + 1, SEED)

    def states(_: int) -> None:
        from bayeschute.compiler.integrate import trajectory_compiled

        made = kernel.states(*given.all())
        jax.block_until_ready(trajectory_compiled(*given.all()) if made is None else made)

    def judged(_: int) -> None:
        flown = jax.block_until_ready(simulate(*given.all()))
        if (np.asarray(flown.outcome) != Outcome.OK).any():
            raise SystemExit("flights of the benchmark failed, so there is nothing to measure")

    def drop(number: int) -> None:
        if not fly_drop(several[number], study).record:
            raise SystemExit("a drop failed, so there is nothing to measure")

    for first in (states, judged, drop):
        first(0)
    return {
        "states": costs(states, range(batches)).over(BATCH),
        "judged": costs(judged, range(batches)).over(BATCH),
        "drop": costs(drop, range(1, drops + 1)),
    }


def machine() -> dict[str, Any]:
    """What this was measured on."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")
    return {
        "cpu": model or platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "load_average": round(os.getloadavg()[0], 1),
        "python": platform.python_version(),
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
    }


def hours(made: dict[str, Any]) -> dict[str, float]:
    """Core hours of all fits and all descents."""
    first, warm = made["first_fit"]["cpu_s"], made["warm_fit"]["cpu_s"]
    found = {"fits": (WORKERS * first + (FITS - WORKERS) * warm) / 3600.0}
    return found | {name: DESCENTS * made[name]["cpu_s"] / 3600.0 for name in ("states", "judged", "drop")}


def rounded(value: float) -> str:
    """Two figures are all that such a product is worth."""
    return f"{float(f'{value:.2g}'):,.0f}" if value >= 1.0 else f"{value:.2g}"


def page(made: dict[str, Any], here: dict[str, Any], command: str) -> str:
    """The page, from what was measured."""

    def row(words: str, name: str, factor: float, unit: str) -> str:
        cost = made[name]
        error = "" if cost["standard_error"] is None else f" ± {factor * cost['standard_error']:.2g}"
        cpu, wall = factor * cost["cpu_s"], factor * cost["wall_s"]
        return f"| {words} | {cpu:.3g}{error} {unit} | {wall:.3g} {unit} | {cost['repeats']} |"

    cost, small = hours(made), " Sizes were cut (--quick): not for use." if made["quick"] else ""
    drop_tb = made["bytes_per_drop"] * DESCENTS / 1e12
    return f"""<!-- Written by `{command}`; run it again rather than edit. -->

# What a large campaign costs

Measured on {here["date"]} with bayeschute {made["version"]}, Python {here["python"]}, on {here["cpu"]}, {here["cores"]}
cores, load average {here["load_average"]} at the end.{small}

| measured | processor time | on the clock | repeats |
|---|---|---|---|
{row("`c_first`, a worker's first fit, nothing compiled yet", "first_fit", 1.0, "s")}
{row("`c_warm`, every other fit", "warm_fit", 1.0, "s")}
{row(f"`c_states`, 90 s descent, states only, batches of {BATCH}", "states", 1e3, "ms")}
{row("`c_judged`, the same with outcome and error of steps", "judged", 1e3, "ms")}
{row("`c_drop`, the same as record and truth (`simulate`)", "drop", 1e3, "ms")}

± is one standard error of the mean over the repeats. A process of fits took {made["peak_gb"]:.1f} GB of memory at most.
A fit is one replicate of `models/studies/cdt-3-11.toml`: two flights flown, one identified, one predicted, both scored.

## 10^4 fits: {rounded(cost["fits"])} core hours

    core hours = (w c_first + (n - w) c_warm)/3600,    n = {FITS:,}, w = {WORKERS} workers

that is {rounded(cost["fits"] / WORKERS)} hours on the clock with {WORKERS} cores, if all of them are kept busy.
`benchmarks/campaign_efficiency.py` measures what is lost from one worker to two. A compilation cache that workers share
(docs/cluster.md) makes `c_first` less.

## 10^8 descents: {rounded(cost["judged"])} core hours

    core hours = n c/3600,    n = {DESCENTS:,}

| descents as | core hours |
|---|---|
| states only | {rounded(cost["states"])} |
| with outcome and error of steps | {rounded(cost["judged"])} |
| records with truth, {drop_tb:.0f} TB of files | {rounded(cost["drop"])} |

A descent lasts 90 s at 10 Hz, to the end of a record and not to the ground; cost grows in proportion to the time flown.
Descents in such numbers are for rare events; `benchmarks/gpu.py` measures how many a GPU makes.

These are products of a measured cost and a number, not campaigns that were run. Other studies cost otherwise: a fit
goes with the length of the records, the number of flights and of draws.
"""


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """All costs."""
    import bayeschute
    from bayeschute.study.load import load_study
    from bayeschute.study.run.simulate import fly_drop, wanted_drops

    first, warm = fits(options.fits, options.quick)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e9
    flown = descents(options.batches, options.drops)
    study = load_study(ROOT / "models" / "studies" / "cdt-3-11.toml")
    drop = fly_drop(wanted_drops(study, study.flights[:1], 1, SEED)[0], study)
    return {
        "version": bayeschute.__version__,
        "quick": options.quick,
        "first_fit": first.told(),
        "warm_fit": warm.told(),
        **{name: cost.told() for name, cost in flown.items()},
        "peak_gb": peak,
        "bytes_per_drop": len(drop.record) + len(drop.truth),
    }


def main() -> None:
    """Measure, print, write the page, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("--fits", type=int, default=6, help="at least 2")
    parser.add_argument("--batches", type=int, default=20)
    parser.add_argument("--drops", type=int, default=20)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--out", type=Path, help=f"the page; default: {PAGE.relative_to(ROOT)}, none with --quick")
    options = parser.parse_args()
    if min(options.fits, options.batches + 1, options.drops + 1) < 2:
        parser.error("at least 2 fits, 1 batch and 1 drop")
    said = "".join(f" --{name} {vars(options)[name]}" for name in ("fits", "batches", "drops"))
    command = f"python benchmarks/planning.py{said}{' --quick' if options.quick else ''}"
    with tempfile.TemporaryDirectory(prefix="bayeschute-cache-") as cache:
        os.environ["BAYESCHUTE_CACHE"] = cache  # read when bayeschute is first imported
        made = measure(options)
    here = machine()
    text = page(made, here, command)
    print(text)
    out = options.out or (None if options.quick else PAGE)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(text, encoding="utf-8")
        print(f"written to {out}")
    cost = hours(made)
    ratios = {"core_hours_1e4_fits": cost["fits"], "core_hours_1e8_descents": cost["judged"]}
    print_result(options, ratios, {"measured": made, "machine": here, "core_hours": cost})


if __name__ == "__main__":
    main()
