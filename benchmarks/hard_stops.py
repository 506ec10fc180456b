"""Runs that are stopped the hard way, and resumed: do they end with the results of a run that nothing stopped?

    python benchmarks/hard_stops.py --kills 50 --seed 1 [--workers 2] [--stops kill ctrl-c disk] [--study STUDY]

Every try is a run with ``--quick`` in a folder of its own, stopped at a moment drawn uniformly over the time that the
reference took, then resumed, and compared with the reference to the last bit (`run_differences`). Stops: ``none``, for
comparison; ``kill``, signal 9, in one of four again while it resumes; ``ctrl-c``; ``disk`` that is full; ``read-only``
folder; ``memory`` that ends; ``clock``, killed and resumed at an earlier hour, its files dated ten years ahead or back;
``two-runs`` in the folder at once. Before a run resumes, no file may be half-written under its own name.

The default study is the template of descents with two made-up records: the shipped descents need records from
elsewhere, and a cluster takes longer. Rows are lines of JSON in ``--out``; the same command goes on. The exit code is 1
if a resumed run differs, files remain that were being written, or a user was shown a traceback.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import signal
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from run_differences import differences, unfinished
from stop_kinds import STOPS, NotTriedError, Place, Stopped, end_all
from stops_page import kept_stops

from bayeschute.atmosphere.standard import standard_density
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.evidence.provenance import provenance
from bayeschute.study.load import load_study
from bayeschute.study.study import study_hash
from bayeschute.study.templates import template

Row = dict[str, Any]
DRAGS = {"low": 0.155, "high": 0.160}  # C_D S/m of the made-up descents [m^2/kg]
SHOWN = 3  # differences of a row


def one(place: Place, what: str, number: int, seed: int) -> Row:
    """Stop a run, resume it, and compare it with the reference."""
    rng = np.random.default_rng([seed, [*STOPS].index(what), number])
    folder = place.work / f"{what}-{number}"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    try:
        with STOPS[what](place, folder, number, rng) as stopped:
            row = _resumed(place, stopped)
    except NotTriedError as error:
        row = {"ok": None, "how": f"not tried: {error}"}
    if row["ok"] is not False:  # else it is kept, to be looked at
        shutil.rmtree(folder, ignore_errors=True)
    return {"what": what, "number": number, "seed": seed} | row


def _resumed(place: Place, stopped: Stopped) -> Row:
    """The row of a run that was stopped: what was half-written, how it was resumed, and what differs then."""
    out, ended = stopped.out, stopped.ended
    half = list(differences(place.reference, out, partial=True)) if out.is_dir() else []
    if stopped.moment is None:
        again = ended
    else:
        again = place.begin(out, "--resume", zone=stopped.zone).end()
    unlike = list(differences(place.reference, out)) if out.is_dir() else ["the folder is missing"]
    left = unfinished(out)
    traceback = ended.traceback or again.traceback
    sound = stopped.sound and again.code == 0 and not traceback and not half and not unlike and not left
    return {
        "ok": sound, "moment_s": stopped.moment, "stage": stopped.stage, "how": stopped.how, "code": ended.code,
        "said": ended.said, "traceback": traceback, "half_written": half[:SHOWN], "resumed_code": again.code,
        "resumed_said": again.said, "identical": not unlike, "differences": len(unlike), "first": unlike[:SHOWN],
        "left": left, "resume_s": again.seconds, "of_reference": again.seconds / place.seconds,
    }  # fmt: skip


def made_up(folder: Path) -> Path:
    """The template of descents with two records of sondes at their terminal speed in gusty air; returns the study."""
    folder.mkdir(parents=True, exist_ok=True)
    rng, text = np.random.default_rng(11), template("descent.toml").read_text(encoding="utf-8")
    head, flight, rest = _split(text)
    flights = []
    for name, drag in DRAGS.items():
        altitude, gust, lines = 3000.0, 0.0, ["time_s,altitude_m"]
        for i in range(120):
            lines.append(f"{i},{altitude + 0.3 * rng.standard_normal():.3f}")
            gust += -gust / 30.0 + 0.4 * np.sqrt(2.0 / 30.0) * rng.standard_normal()
            altitude -= np.sqrt(2.0 * 9.80665 / (drag * float(standard_density(altitude)))) + gust
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
        flights.append(flight.replace("my-descent", name))
    path = folder / "descents.toml"
    path.write_text(head + "".join(flights) + rest, encoding="utf-8")
    return path


def _split(text: str) -> tuple[str, str, str]:
    """A study before its only flight, the flight, and what comes after it."""
    head, mark, tail = text.partition("[[flight]]")
    flight, given, rest = tail.partition("[priors.given]")
    return head, mark + flight, given + rest


def known(path: Path, identity: str) -> list[Row]:
    """Rows of a file that belong to a study and code; a line that was cut is left out."""
    rows = []
    for line in path.read_text(encoding="utf-8").splitlines() if path.is_file() else []:
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        if row.get("identity") == identity:
            rows.append(row)
    return rows


def add(path: Path, row: Row) -> None:
    """Append a row, on a line of its own even where the last one was cut."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        if file.tell():
            file.seek(-1, os.SEEK_END)
            if file.read(1) != b"\n":
                file.write(b"\n")
        file.write(json.dumps(row, ensure_ascii=False).encode() + b"\n")


def referred(place: Place, rows: Sequence[Row], workers: int) -> Row:
    """The row of the reference: that of an earlier command, or of a run that is made now.

    As many as there are workers run at once, for the sake of the time that a run takes beside others.
    """
    for row in rows:
        if row["what"] == "reference" and (place.reference / "report.html").exists():
            return row
    beside = [place.work / f"beside-{i}" for i in range(1, workers)]
    for folder in (place.reference, *beside):
        shutil.rmtree(folder, ignore_errors=True)
    print("reference: begins", flush=True)
    every = [place.begin(folder) for folder in (place.reference, *beside)]
    ends = [run.end() for run in every]
    for folder in beside:
        shutil.rmtree(folder, ignore_errors=True)
    if ends[0].code or not (place.reference / "predictions.nc").exists():
        raise SystemExit(f"the reference has not come to its end (exit code {ends[0].code}): {ends[0].said}")
    size = sum(path.stat().st_size for path in place.reference.rglob("*") if path.is_file())
    return {"what": "reference", "number": 0, "seconds": ends[0].seconds, "size": size, "at_once": workers}


def tried(place: Place, todo: Sequence[tuple[str, int]], seed: int, workers: int) -> Iterator[Row]:
    """Rows as they come."""
    with ThreadPoolExecutor(workers) as pool:
        coming = [pool.submit(one, place, what, number, seed) for what, number in todo]
        try:
            for done in as_completed(coming):
                yield done.result()
        except BaseException:
            for future in coming:
                future.cancel()
            end_all()
            raise


def told(row: Row) -> str:
    """A row as a line of the table."""
    if row["ok"] is None:
        return f"{row['what']:9s} {row['number']:3d}  {row['how']}"
    moment = "" if row["moment_s"] is None else f"{row['moment_s']:.1f}"
    same = "yes" if row["identical"] else "NO"
    faults = [words for words in (
        "TRACEBACK" if row["traceback"] else "", f"left: {row['left'][0]}" if row["left"] else "",
        f"half-written: {row['half_written'][0]}" if row["half_written"] else "",
        f"first difference: {row['first'][0]}" if row["first"] else "",
        f"resumed with exit code {row['resumed_code']}: {row['resumed_said']}" if row["resumed_code"] else "",
    ) if words]  # fmt: skip
    return (
        f"{row['what']:9s} {row['number']:3d} {moment:>7s} {row['code']:4d} {same:>9s} {row['of_reference']:6.2f}  "
        f"{row['stage'][:60]:60s} {row['how']}\n{'':22s}said: {row['said'][:160]}"
        + "".join(f"\n{'':22s}{words}" for words in faults)
    )


def table(rows: Sequence[Row], what: Sequence[str]) -> list[str]:
    """All rows, and totals of every kind of stop."""
    made = [
        f"{'stop':9s} {'no.':>3s} {'at [s]':>7s} {'code':>4s} {'identical':>9s} {'resume':>6s}  {'under way':60s} how"
    ]
    made += [told(row) for row in rows]
    for name in what:
        some = [row for row in rows if row["what"] == name]
        good, ran = sum(row["ok"] is True for row in some), sum(row["ok"] is not None for row in some)
        same = sum(bool(row.get("identical")) for row in some)
        traces = sum(bool(row.get("traceback")) for row in some)
        made.append(
            f"{name}: {ran} tried, {same} identical after the resume, {traces} with a traceback, {good} without fault"
            + (f", {len(some) - ran} not tried" if len(some) > ran else "")
        )
    return made


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the rows that are missing, print all, and exit with 1 where one has a fault."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50, help="tries of the stop `kill`")
    parser.add_argument("--tries", type=int, default=4, help="of every other stop")
    parser.add_argument("--stops", nargs="+", choices=[*STOPS], default=[*STOPS])
    parser.add_argument("--study", type=Path, help="study file [default: two made-up descents]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1, help="runs at once")
    parser.add_argument("--out", type=Path, default=Path("runs/hard-stops.jsonl"), metavar="FILE")
    parser.add_argument("--json", action="store_true", help="print all rows as the last line")
    parser.add_argument("--store", type=Path, metavar="FILE", help="keep the totals of each kind of stop there")
    given = parser.parse_args(arguments)
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # of a shell's background, which runs would inherit
        signal.signal(signal.SIGINT, signal.default_int_handler)
    work = given.out.absolute().with_suffix("")
    study = given.study.absolute() if given.study else made_up(work / "study")
    inputs = json.dumps([study_hash(load_study(study)), numerics(), sys.version])
    identity = hashlib.sha256(inputs.encode()).hexdigest()[:16]
    place = Place(study, work / identity)
    rows = known(given.out, identity)
    reference = referred(place, rows, given.workers)
    if reference not in rows:
        rows = [row for row in rows if row["what"] != "reference"]
        reference |= {"identity": identity, "study": study.name} | provenance("benchmarks/hard_stops.py")
        add(given.out, reference)
    place = replace(place, seconds=reference["seconds"], size=reference["size"])
    print(f"reference: {study.name}, {place.seconds:.1f} s, {place.size / 1e6:.1f} MB", flush=True)
    counts = {"none": 1, "kill": given.kills}
    wanted = [(what, i) for what in STOPS if what in given.stops for i in range(counts.get(what, given.tries))]
    had = {(row["what"], row["number"]): row for row in rows if row.get("seed") == given.seed}
    todo = [pair for pair in wanted if pair not in had]
    for row in tried(place, todo, given.seed, given.workers):
        add(given.out, row | {"identity": identity})
        had[row["what"], row["number"]] = row
        print(told(row), flush=True)
    final = [had[pair] for pair in wanted]
    print("\n" + "\n".join(table(final, given.stops)))
    if given.store:
        kept_stops(given.store, reference, final)
    if given.json:
        print(json.dumps({"reference": reference, "rows": final}, ensure_ascii=False))
    if any(row["ok"] is False for row in final):
        raise SystemExit(1)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        end_all()
        raise SystemExit("Stopped. The same command goes on.") from None
