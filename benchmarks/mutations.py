"""Of random small changes in the code, how many does the fast test suite catch?

Lines of code are drawn uniformly from the rooms, and one of each line's possible changes (`mutation_changes`). Every
change is made in a throwaway copy of the tree, and test files run there without the slow tests: the one that mirrors
the module, then the nearest that import it (`mutation_tests`), until one fails. A test file counts only if it passes
where nothing is changed but one unused name per module. A file that doesn't end in time, and needs less than half of it
where nothing is changed, counts as caught, and is told apart. Seed and source alone decide what is changed under which
number; a longer sample begins with the shorter one.

    python benchmarks/mutations.py --changes 200 --seed 1 [--workers 2] [--rooms likelihood records] [--list] [--json]

Rows are kept in ``--out``; the same command goes on where it was. Survivors are judged by a reader: those that change
nothing that anyone could see are left out of the shares by ``--harmless NUMBER ...``. ``--only NUMBER ...`` runs these
again, as after a test was added.

``--store FILE`` adds the sample to those of the file, drawn from other sources or by other seeds, or replaces it there.
``--survivors`` draws none: it tries the survivors of that file again, as far as their lines are still there.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import random
import signal
import sys
import tempfile
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from threading import Lock
from typing import Any

from mutation_changes import Change, applied, changes, shown, sound
from mutation_tests import Imports
from mutation_trials import Mutant, Trials

from bayeschute.prediction.binomial_limits import clopper_pearson
from bayeschute.study.evidence.provenance import provenance

ROOT = Path(__file__).parents[1]
ROOMS = (
    "aero", "atmosphere", "compiler", "core", "dynamics", "likelihood", "posterior", "prediction", "records",
    "regression", "structure", "study", "swing", "virtual",
)  # fmt: skip
"""Numerics, records, prediction and study."""
CONFIDENCE = 0.9


def modules(root: Path, rooms: Sequence[str]) -> dict[Path, str]:
    """Modules of rooms, and their rooms.

    Args:
        root: Folder that holds ``src``.
        rooms: Folders or files of the package, from its folder.
    """
    (package,) = (path.parent for path in (root / "src").glob("*/__init__.py"))
    found = dict[Path, str]()
    for room in rooms:
        place = package / room
        if not place.exists():
            raise SystemExit(f"--rooms {room}: no such folder or file in {package.name}")
        for path in [place] if place.is_file() else sorted(place.rglob("*.py")):
            found.setdefault(path, room)
    return found


def sample(root: Path, rooms: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """Draw changes: lines uniformly without repetition, one change of each.

    Args:
        root: Folder that holds ``src``.
        rooms: Folders or files of the package.
        count: How many; all lines where there are fewer.
        seed: Decides them, with the source.
    """
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(modules(root, rooms))}
    lines = dict[tuple[Path, int], list[Change]]()
    for path, text in texts.items():
        for change in changes(text):
            lines.setdefault((path, change.line), []).append(change)
    order = sorted(lines)
    random.Random(seed).shuffle(order)
    drawn, belongs = list[Mutant](), modules(root, rooms)
    for path, line in order:
        if len(drawn) == count:
            break
        file, text = path.relative_to(root).as_posix(), texts[path]
        rng, possible = random.Random(f"{seed} {file} {line}"), lines[path, line]
        for change in rng.sample(possible, len(possible)):
            choice = rng.choice(change.choices)
            changed = applied(text, change, choice)
            if sound(text, changed):
                before, after = shown(text, change, choice)
                drawn.append(Mutant(len(drawn) + 1, belongs[path], file, line, change.kind, before, after, changed))
                break
    return drawn


def source_hash(root: Path, rooms: Sequence[str]) -> str:
    """SHA-256 of the modules that a sample is drawn from."""
    made = hashlib.sha256()
    for path in sorted(modules(root, rooms)):
        made.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return made.hexdigest()


class Rows:
    """Rows on disk, one a line, each there as soon as it is known.

    Args:
        path: Of the file.
        what: Tells the sample; a file of another one is refused.
    """

    def __init__(self, path: Path, what: dict[str, Any]) -> None:
        self.path, self.lock = path, Lock()
        rows = list[dict[str, Any]]()
        text = path.read_text(encoding="utf-8") if path.is_file() else ""
        for line in text.split("\n"):
            try:
                rows.append(json.loads(line))
            except json.JSONDecodeError:
                continue  # empty, or cut short by a sudden end
        self.done = {row["number"]: row for row in rows if "number" in row}
        self.baseline = {row["baseline"]: row for row in rows if "baseline" in row}
        if rows and rows[0] != what:
            raise SystemExit(f"{path} holds rows of another sample or source: name another file by --out")
        path.parent.mkdir(parents=True, exist_ok=True)
        if text and not text.endswith("\n"):
            self._append("")
        if not rows:
            self._append(json.dumps(what))

    def keep(self, row: dict[str, Any]) -> None:
        """Add a row; of two about the same the later counts, and tells what the first one found."""
        with self.lock:
            before = self.done.get(row.get("number"))
            if before is not None:
                row["at_first"] = before.get("at_first", before["result"])
            self._append(json.dumps(row, ensure_ascii=False))
            if "baseline" in row:
                self.baseline[row["baseline"]] = row
            else:
                self.done[row["number"]] = row

    def _append(self, line: str) -> None:
        with self.path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")


def run(
    root: Path, sampled: Sequence[Mutant], rows: Rows, workers: int, most: int, limit: float, commit: str,
    again: Sequence[int] = (),
) -> None:  # fmt: skip
    """Try the changes that have no row yet.

    Args:
        root: The tree.
        sampled: The changes.
        rows: Takes the results.
        workers: How many at once.
        most: Test files tried besides the mirrored one.
        limit: Longest time of a test file [s].
        commit: That rows are made at.
        again: Numbers that are tried although they have a row.
    """
    todo = [one for one in sampled if one.number not in rows.done or one.number in again]
    imports = Imports.read(root)
    with tempfile.TemporaryDirectory(prefix="mutations-") as place:
        known = () if again else rows.baseline.values()  # a test that was mended since is to be tried again
        trials = Trials(root, Path(place), workers, limit, rows.keep, known)

        def one(mutant: Mutant) -> dict[str, Any]:
            return trials.judge(mutant, imports.nearest(root / mutant.file), most) | {"commit": commit}

        pool = ThreadPoolExecutor(workers)
        try:
            for future in as_completed([pool.submit(one, mutant) for mutant in todo]):
                row = future.result()
                rows.keep(row)
                print(line_of(row), flush=True)
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            trials.end()
            pool.shutdown()


def stored(path: Path) -> list[dict[str, Any]]:
    """Samples that a file holds: rows, numbers of harmless ones, provenance."""
    return list(json.loads(path.read_text(encoding="utf-8"))["samples"]) if path.is_file() else []


def store(path: Path, samples: Iterable[dict[str, Any]]) -> None:
    """Write samples into a file."""
    text = json.dumps({"samples": list(samples)}, indent=1, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def with_sample(samples: Iterable[dict[str, Any]], made: dict[str, Any]) -> list[dict[str, Any]]:
    """Samples with one more, which takes the place of an earlier part of itself."""
    return [*(one for one in samples if one["sample"] != made["sample"]), made]


def still_there(root: Path, row: dict[str, Any]) -> Mutant | None:
    """The change of a stored row, made in the present source; None where its line is gone, or is there twice."""
    path = root / row["file"]
    text = path.read_text(encoding="utf-8") if path.is_file() else ""
    changed = text.replace(row["before"], row["after"])
    if text.count(row["before"]) != 1 or not sound(text, changed):
        return None
    line = text[: text.index(row["before"])].count("\n") + 1
    told = {name: row[name] for name in ("number", "room", "file", "kind", "before", "after")}
    return Mutant(**told, line=line, text=changed)


def try_survivors(root: Path, samples: Iterable[dict[str, Any]], most: int, limit: float, commit: str) -> None:
    """Try stored survivors again that are not harmless, and change their rows.

    Args:
        root: The tree.
        samples: As stored.
        most: Test files tried besides the mirrored one.
        limit: Longest time of a test file [s].
        commit: That the results are made at.
    """
    imports = Imports.read(root)
    rows = [row for one in samples for row in one["rows"] if row["number"] not in one["harmless"]]
    with tempfile.TemporaryDirectory(prefix="mutations-") as place:
        trials = Trials(root, Path(place), 1, limit, lambda row: None)
        for row in rows:
            if row["result"] != "survived" or (mutant := still_there(root, row)) is None:
                continue
            found = trials.judge(mutant, imports.nearest(root / mutant.file), most)
            row |= found | {"at_first": row.get("at_first", row["result"]), "commit": commit}
            print(line_of(row), flush=True)
        trials.end()


def line_of(row: dict[str, Any]) -> str:
    """A row in words."""
    by = f" by {row['by']}" if row["by"] else f" ({len(row['passed'])} test files passed)"
    head = (
        f"{row['number']:4d} {row['result']:8s} {row['file']}:{row['line']} [{row['kind']}] in {row['seconds']:.0f} s"
    )
    return f"{head}{by}\n       - {row['before']}\n       + {row['after']}"


def shares(rows: Sequence[dict[str, Any]], harmless: Iterable[int] = ()) -> dict[str, dict[str, dict[str, Any]]]:
    """How many are caught, of all, by room and by kind, with limits of the share.

    Args:
        rows: Results.
        harmless: Numbers of survivors that are left out.
    """
    counted = [row for row in rows if row["result"] != "survived" or row["number"] not in set(harmless)]
    made: dict[str, dict[str, dict[str, Any]]] = {"all": {}, "room": {}, "kind": {}}
    for what, groups in made.items():
        for name in sorted({row.get(what, "all") for row in counted}):
            some = [row for row in counted if row.get(what, "all") == name]
            caught = sum(row["result"] != "survived" for row in some)
            limits = clopper_pearson(caught, len(some), CONFIDENCE)
            groups[name] = {
                "changes": len(some), "caught": caught, "timeouts": sum(row["result"] == "timeout" for row in some),
                "low": round(limits.low, 3), "high": round(limits.high, 3),
            }  # fmt: skip
    return made


def report(rows: Sequence[dict[str, Any]], harmless: Sequence[int], failing: Sequence[str]) -> dict[str, Any]:
    """Print totals and survivors, and give both.

    Args:
        rows: Results.
        harmless: Numbers of survivors that are left out.
        failing: Test files that were not counted.
    """
    totals = shares(rows, harmless)
    for what, groups in totals.items():
        for name, one in groups.items():
            share, limits = one["caught"] / one["changes"], f"{one['low']:.0%} to {one['high']:.0%}"
            count = f"{one['caught']:4d} of {one['changes']:4d}, {one['timeouts']} by time"
            print(f"{what if name == 'all' else f'{what} {name}':24s} {count}: {share:.0%} ({limits})")
    for test in failing:
        print(f"not counted, since it fails where nothing is changed, or is late: {test}")
    survivors = [row for row in rows if row["result"] == "survived"]
    for row in survivors:
        print(("harmless " if row["number"] in harmless else "") + line_of(row).lstrip())
    return {"totals": totals, "confidence": CONFIDENCE, "harmless": sorted(harmless), "not_counted": list(failing)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw, run, print; with ``--json`` totals, rows and provenance as the last line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--changes", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1, help="changes that are tried at once")
    parser.add_argument("--rooms", nargs="+", default=list(ROOMS), help="folders or files of the package")
    parser.add_argument("--only", nargs="+", type=int, metavar="NUMBER", help="try these, though they have a row")
    parser.add_argument("--harmless", nargs="+", type=int, default=[], metavar="NUMBER", help="survivors left out")
    parser.add_argument("--most-files", type=int, default=4, help="test files tried besides the mirrored one")
    parser.add_argument("--limit", type=float, default=300.0, help="longest time of a test file [s]")
    parser.add_argument("--out", type=Path, help="file of the rows (runs/mutations-SEED.jsonl)")
    parser.add_argument("--made-at", metavar="COMMIT", help="where there is no git to ask")
    parser.add_argument("--list", action="store_true", help="print the sample and run nothing")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--store", type=Path, metavar="FILE", help="keep rows, harmless numbers and provenance there")
    parser.add_argument("--survivors", action="store_true", help="try those of --store FILE again, and nothing else")
    given = parser.parse_args(arguments)
    if given.survivors and not given.store:
        parser.error("--survivors: wants --store FILE, whose survivors it tries")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # as an interrupt does: processes end, copies go
    rooms = "" if given.rooms == list(ROOMS) else " --rooms " + " ".join(given.rooms)
    told = provenance(f"python benchmarks/mutations.py --changes {given.changes} --seed {given.seed}{rooms}")
    told["commit"] = given.made_at or told["commit"] or "unknown"
    if given.survivors:
        samples = stored(given.store)
        try_survivors(ROOT, samples, given.most_files, given.limit, told["commit"])
        return store(given.store, samples)
    sampled = sample(ROOT, given.rooms, max(given.changes, *(given.only or [0])), given.seed)
    if given.only:
        sampled = [one for one in sampled if one.number in given.only]
    if given.list:
        for one in sampled:
            print(f"{one.number:4d} {one.file}:{one.line} [{one.kind}]\n       - {one.before}\n       + {one.after}")
        return
    what = {"seed": given.seed, "rooms": given.rooms, "source": source_hash(ROOT, given.rooms)}
    rows = Rows(given.out or ROOT / "runs" / f"mutations-{given.seed}.jsonl", what)
    run(ROOT, sampled, rows, given.workers, given.most_files, given.limit, told["commit"], given.only or ())
    made = [rows.done[one.number] for one in sampled]
    failing = sorted(name for name, row in rows.baseline.items() if not row["sound"])
    totals = report(made, given.harmless, failing)
    if given.store:
        kept = {"provenance": told, "sample": what, "harmless": sorted(given.harmless), "rows": made}
        store(given.store, with_sample(stored(given.store), kept))
    if given.json:
        print(json.dumps(totals | {"sample": what, "rows": made} | told, ensure_ascii=False))


if __name__ == "__main__":
    main()
