"""How much sooner are two workers done than one, and do they find the same?

The same campaign of `bayeschute calibrate` on the default study is run three times, by processes of their own: to fill
the compilation cache, by one worker on one core, and by two on two (one left to itself would use some of the second
core). Efficiency is the time of one worker over twice that of two, the start of the processes included. Rows and tables
must be the same, but for times. What is lost is told apart: replicates that take longer beside another one (memory,
clock rate, other users of the cores), and the rest: starting, JAX's tracing in each process, waiting for the last one.

    python benchmarks/campaign_efficiency.py [--replicates 24] [--full] [--json]

Needs Linux, two idle cores and the extra `dask`. Replicates are quick ones unless --full is given. `identical` false is
exit code 1.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

from command import parser_of

from bayeschute.calibration.replicate_rows import read_rows

ROOT = Path(__file__).parents[1]
STUDY = ROOT / "models" / "studies" / "cdt-3-11.toml"
WARM = 8  # replicates that fill the compilation cache
COMMAND = "import os; os.sched_setaffinity(0, {cores}); from bayeschute.cli import main; main()"


class Made(NamedTuple):
    """A campaign: time on the clock [s], rows by seed and tables without times, times of the replicates [s] by seed."""

    wall: float
    rows: dict[int, dict[str, Any]]
    tables: dict[str, Any]
    each: dict[int, float]


def campaign(folder: Path, workers: int, replicates: int, full: bool) -> Made:
    """Run a campaign in a process of its own, on as many cores as it has workers, and read what it left."""
    cores = sorted(os.sched_getaffinity(0))[:workers]
    sizes = [] if full else ["--quick"]
    told = ["--out", str(folder), "--workers", str(workers), "--replicates", str(replicates), *sizes]
    began = perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", COMMAND.format(cores=cores), "calibrate", str(STUDY), *told],
        capture_output=True, text=True,
    )  # fmt: skip
    wall = perf_counter() - began
    if done.returncode:
        raise SystemExit(f"the campaign of {workers} workers ended with {done.returncode}: {done.stderr[-2000:]}")
    (kept,) = folder.glob("*.rows")
    rows = read_rows(kept)
    (result,) = folder.glob("*.json")
    tables = json.loads(result.read_text(encoding="utf-8"))
    tables.pop("wall_s")
    each = {seed: row.pop("wall_s") for seed, row in rows.items()}
    return Made(wall, rows, tables, each)


def main() -> None:
    """Run, print, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("--replicates", type=int, default=24, help="even, so that two workers share them")
    parser.add_argument("--full", action="store_true", help="replicates as in use, minutes each")
    options = parser.parse_args()
    if options.replicates < 4 or options.replicates % 2:
        parser.error("--replicates: an even number from 4 is wanted")
    with tempfile.TemporaryDirectory(prefix="bayeschute-") as place:
        os.environ["BAYESCHUTE_CACHE"] = str(Path(place) / "compiled")
        asked = (2, min(options.replicates, WARM)), (1, options.replicates), (2, options.replicates)
        warm, one, two = (campaign(Path(place) / str(i), *sizes, options.full) for i, sizes in enumerate(asked))
    identical = one.rows == two.rows and one.tables == two.tables
    failed = sum(not row["ok"] for row in two.rows.values())
    efficiency = one.wall / (2.0 * two.wall)
    later = sorted(one.each)[2:]  # the first of each process is traced too
    slower = sum(two.each[seed] for seed in later) / sum(one.each[seed] for seed in later)
    print(f"{options.replicates} {'full' if options.full else 'quick'} replicates, {failed} failed")
    print(f"filling the cache {warm.wall:.0f} s, 1 worker {one.wall:.0f} s, 2 workers {two.wall:.0f} s")
    print(f"efficiency from 1 to 2 workers: {100.0 * efficiency:.0f} %")
    print(f"a replicate takes {slower:.2f} times as long beside another one; that alone leaves {100.0 / slower:.0f} %")
    print(f"rows and tables are {'the same' if identical else 'NOT the same'}")
    if options.json:
        context = {
            "replicates": options.replicates,
            "full": options.full,
            "failed": failed,
            "cores": os.cpu_count(),
            "load_average": round(os.getloadavg()[0], 1),
            "wall_s": {"filling": warm.wall, "1": one.wall, "2": two.wall},
            "slower_beside_another": slower,
        }
        print(json.dumps({"efficiency_1_to_2": efficiency, "identical": identical, "context": context}))
    if not identical:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
