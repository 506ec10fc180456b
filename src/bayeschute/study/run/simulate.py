"""Virtual drops of a study, stored as records with the true motion; in this process or over Dask, the same files.

A drop is determined by its vehicle, its flight table and its seed, so its numbers do not depend on the worker. Its
files contain a hash of these, and drops that exist already are kept.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import xarray as xr

from bayeschute.calibration.workers import Lost, client_of, finished
from bayeschute.core.errors import Fault, InputError
from bayeschute.core.files import write_whole
from bayeschute.core.random import seed_of
from bayeschute.core.version import __version__
from bayeschute.dynamics.outcome import Outcome
from bayeschute.records.record import write_record
from bayeschute.study.assembly import assemble
from bayeschute.study.run.stage_data import flown, write_truth
from bayeschute.study.study import Flight, Study, canonical

HASH = "drop_hash"
"""Attribute of records and truths: the hash of the inputs of the drop."""
_AHEAD = 4  # drops per core submitted at once: results wait in workers' memory


class Drops(NamedTuple):
    """Result of `simulate_study`.

    Attributes:
        files: Records and truths, written now or kept.
        outcomes: Number of drops by outcome, in words.
        failed: Drops that aren't ok, with their outcome.
        step_error: Largest error due to the steps over drops that are ok: positions [m], velocities [m/s].
        kept: How many were there already.
    """

    files: list[Path]
    outcomes: dict[str, int]
    failed: dict[str, str]
    step_error: tuple[float, float]
    kept: int = 0


class Wanted(NamedTuple):
    """A drop to fly: name of its files, flight, seed, hash."""

    stem: str
    flight: Flight
    seed: int
    hash: str


class Flown(NamedTuple):
    """A simulated drop: attributes with its outcome; bytes of its files, none if it failed; faults."""

    facts: Mapping[str, Any]
    record: bytes = b""
    truth: bytes = b""
    faults: tuple[Fault, ...] = ()


def simulate_study(
    study: Study,
    out: Path | str,
    draws: int = 1,
    seed: int | None = None,
    progress: Callable[[str, float, str], None] | None = None,
    workers: int = 1,
    address: str | None = None,
) -> Drops:
    """Fly the virtual flights of a study, or the drop of a vehicle, and store records and truth.

    A drop that fails is counted, and leaves no files; it is flown again by the next call. Drops in `out` that are the
    same are kept; files of other drops under the same names are replaced.

    Args:
        study: The study.
        out: A folder; files are ``<flight>.nc`` and ``<flight>.truth.nc``, numbered where `draws` > 1.
        draws: Number of virtual drops of each flight, each with its own seed.
        seed: Replaces the study's.
        progress: Called with a name, the share done and words.
        workers: Local processes; 1: this one.
        address: Of a Dask scheduler, in place of local processes. Workers send files' bytes; they need not see `out`.

    Returns:
        The files, and the outcome of every drop; the same, except for `kept`, on any worker.

    Raises:
        InputError: If the study has no virtual flight, no drop stays finite, or Dask is not there or breaks off.
    """
    flights = [f for f in study.flights if f.virtual is not None]
    if not flights:
        raise InputError(
            Fault(str(study.path), "no virtual flight", "a [flight.virtual] table", "Add one, or use run.")
        )
    folder, wanted = Path(out), wanted_drops(study, flights, draws, seed)
    folder.mkdir(parents=True, exist_ok=True)
    known = {one.stem: Flown(facts) for one in wanted if (facts := _kept(folder, one)) is not None}
    todo, kept, began = [one for one in wanted if one.stem not in known], len(known), time.perf_counter()
    say = progress or (lambda name, share, words: None)
    if kept:
        say("simulate", kept / len(wanted), f"{kept} of {len(wanted)} kept from earlier")
    lost = sum(not _ok(one) for one in known.values())
    with client_of(workers if todo else 1, address if todo else None) as client:
        for done, (one, made) in enumerate(finished(partial(fly_drop, study=study), todo, client, _AHEAD), 1):
            drop = _broken(one.stem, f"worker lost: {made.why}") if isinstance(made, Lost) else made
            for name, content in _names(folder, one.stem, drop):
                write_whole(name, partial(Path.write_bytes, data=content))
            known[one.stem] = drop._replace(record=b"", truth=b"")
            lost += not _ok(drop)
            left = _spell((time.perf_counter() - began) / done * (len(todo) - done))
            say("simulate", (kept + done) / len(wanted), f"{kept + done} of {len(wanted)}, {lost} failed{left}")
    drops = Drops([], {}, {}, (0.0, 0.0), kept)
    for one in wanted:
        drops = _with_drop(drops, folder, one.stem, known[one.stem].facts)
    if not drops.files:
        raise InputError([fault for one in wanted for fault in known[one.stem].faults])
    return drops


def wanted_drops(study: Study, flights: Sequence[Flight], draws: int, seed: int | None = None) -> list[Wanted]:
    """All drops in order, by flight.

    Args:
        study: The study.
        flights: Virtual flights of it.
        draws: Of each flight; where it is 1, files bear the flight's name alone.
        seed: Replaces the study's.
    """
    wanted = []
    for flight in flights:
        said = canonical(replace(study, flights=(flight,)))
        said = {"vehicle": said["vehicle"]} | {key: said["flights"][0][key] for key in ("virtual", "capsule_mass")}
        for draw in range(draws):
            stem = flight.name if draws == 1 else f"{flight.name}.{draw:05d}"
            own = _seed_of(study, flight, draw, seed)
            text = json.dumps([said, flight.name, own, __version__], sort_keys=True)
            wanted.append(Wanted(stem, flight, own, hashlib.sha256(text.encode()).hexdigest()))
    return wanted


def fly_drop(wanted: Wanted, study: Study) -> Flown:
    """Simulate one drop; errors are returned, not raised, so that the others continue.

    Args:
        wanted: The drop.
        study: The study it is of.
    """
    try:
        record, truth = flown(study, wanted.flight, wanted.seed)
    except InputError as error:
        return Flown({"outcome": Outcome.DIVERGED.words, "why": error.faults[0].got}, faults=tuple(error.faults))
    except Exception as error:  # any error fails this drop only: it is counted and reported
        return _broken(wanted.stem, f"{type(error).__name__}: {' '.join(str(error).split())}"[:500])
    with tempfile.TemporaryDirectory(prefix="bayeschute-") as folder:
        mark = {HASH: wanted.hash}
        seen = write_record(record.assign_attrs(mark), Path(folder) / "record.nc")
        true = write_truth(truth.assign_attrs(mark), Path(folder) / "truth.nc")
        return Flown(_plain(truth), seen.read_bytes(), true.read_bytes())


def _broken(stem: str, why: str) -> Flown:
    """A drop lost to something else than its flight."""
    fault = Fault(f"drop {stem}", why, "a drop that is flown to its end")
    return Flown({"outcome": "error", "why": why}, faults=(fault,))


def _plain(truth: xr.Dataset) -> dict[str, Any]:
    """Attributes without the long ones."""
    return {name: value for name, value in truth.attrs.items() if name != "repairs"}


def _names(folder: Path, stem: str, drop: Flown) -> list[tuple[Path, bytes]]:
    """Files of a drop with their content; none of a drop that failed."""
    record, truth = _paths(folder, stem)
    return [(record, drop.record), (truth, drop.truth)] if drop.record else []


def _paths(folder: Path, stem: str) -> tuple[Path, Path]:
    return folder / f"{stem}.nc", folder / f"{stem}.truth.nc"


def _kept(folder: Path, one: Wanted) -> dict[str, Any] | None:
    """Attributes of a drop's files, if both exist and belong to this drop."""
    facts: dict[str, Any] = {}
    for path in _paths(folder, one.stem):
        try:
            with h5py.File(path) as file:
                if file.attrs.get(HASH) != one.hash:
                    return None
                facts = {key: v if isinstance(v, str) else np.ravel(v)[0].item() for key, v in file.attrs.items()}
        except OSError:
            return None  # none, or damaged: it is flown again
    return facts


def _ok(drop: Flown) -> bool:
    return bool(drop.facts["outcome"] == Outcome.OK.words)


def _spell(seconds: float) -> str:
    """Time left, in words; nothing at the end."""
    if seconds <= 0.0:
        return ""
    return f", about {seconds / 60.0:.0f} min left" if seconds > 90.0 else f", about {seconds:.0f} s left"


def _with_drop(drops: Drops, folder: Path, stem: str, facts: Mapping[str, Any]) -> Drops:
    """Counts with one more drop, described by its attributes."""
    words = facts["outcome"]
    drops = drops._replace(outcomes={**drops.outcomes, words: drops.outcomes.get(words, 0) + 1})
    if "why" not in facts:
        drops.files.extend(_paths(folder, stem))
    if words != Outcome.OK.words:
        why = facts.get("why") or f"{words} at {facts['failed_at_s']:.1f} s"
        return drops._replace(failed={**drops.failed, stem: why})
    place, speed = (float(facts[f"step_error_{name}"]) for name in ("position_m", "velocity_m_per_s"))
    return drops._replace(step_error=(max(drops.step_error[0], place), max(drops.step_error[1], speed)))


def _seed_of(study: Study, flight: Flight, draw: int, seed: int | None) -> int:
    """Seed of a draw of a flight; the first draw has that of the flight drawn alone."""
    first = study.seed if seed is None else seed
    if not draw:
        return assemble.flight_seed(replace(study, seed=first), flight)
    return seed_of(first, "further virtual flight", flight.name, draw)
