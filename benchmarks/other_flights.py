"""Flights of another program, identified and predicted by the installed command: does the model hold?

Each set of ``../shared/otherflights`` is a vehicle with physics that this program does not know of. Its first flight is
identified, from 5 s on, and the others are predicted by one study per set, all made by the same rules from the default
study (``other_studies.py``); of a predicted flight the program sees the opening by which it knows it, the wind by
altitude and the air's density. Bands are scored against true histories of the flight and of its replicates, or, where
there are none, against its own record, beside climatology: the constant band of what the identified record shows.

    python benchmarks/other_flights.py --data ../shared/otherflights [--sets P Q R S T U] [--windows 45 90 180]
        [--only-windows] [--identify 2] [--workdir DIR] [--resume] [--quick] [--json] [--store DIR [--made-at COMMIT]]
    python benchmarks/other_flights.py --independent two-mains-1 small-1 [--workdir DIR] [...]

``--independent`` takes sets that ``independent_flights.py`` makes, by kind and seed, in place of those of ``--data``.
``--identify 2`` turns the sets round: their second flight is identified, and the first is one of those predicted; sets
without a flight of that number are passed over. ``--windows`` also fits the first so many seconds of each flight, up to
the checks. With ``--resume`` finished results that ``--workdir`` holds for the same studies are taken as they are.
``--prepare`` only writes the studies. Processor seconds are those of the command and its children. ``--store`` merges
the results into one file per set, from which ``evidence_page.py`` makes a page; with ``--made-at`` nothing is run and
what ``--workdir`` holds is stored, results that do not tell what made them as of that commit.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import independent_flights
import numpy as np
from command import parser_of, print_result
from numpy.typing import NDArray
from other_records import DEGREE, LAYOUTS, climatology, flights_of, read_flight
from other_scores import LEVELS, History, constant, score, width_over_spread
from other_stored import made_now, store
from other_studies import flight_alone, write_set, write_window

if TYPE_CHECKING:
    import xarray as xr

Array = NDArray[np.float64]

QUANTITIES = {  # name here: name in a truth file, factor from the unit of predictions.nc, unit of the table
    "swing_angle": ("swing_angle_deg", 1.0 / DEGREE, "deg"),
    "sea_level_descent_rate": ("sea_level_descent_rate_mps", 1.0, "m/s"),
}
SIZES = {  # columns of a fitted channel, in order: so many, and so many a canopy
    "canopy_position": (0, 3), "capsule_velocity": (3, 0), "capsule_attitude": (3, 0), "descent_rate": (1, 0),
    "swing_angle": (1, 0), "riser_tension": (0, 1), "canopy_velocity": (0, 3),
}  # fmt: skip
_GROUPS = ("observed_data", "posterior_predictive")
KINDS = ("axial[", "transverse[")
_LETTER = "P"  # set whose layout independent flights have


def load(path: Path) -> dict[str, Any]:
    """A JSON file; empty where there is none."""
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}


def command() -> str:
    """The installed command, beside this Python or on the path."""
    beside = Path(sys.executable).with_name("bayeschute")
    found = str(beside) if beside.exists() else shutil.which("bayeschute")
    if found is None:
        sys.exit("no command bayeschute: install the package first")
    return found


def run(study: Path, out: Path, *options: str) -> dict[str, Any]:
    """Run a study in a process of its own, afresh; what it says is kept in a log beside the study.

    Args:
        study: Its file.
        out: Folder of the run; what was there goes.
        options: Of the command.

    Returns:
        ``exit``, ``processor_s``, ``wall_s``, ``traceback`` (whether it printed one), and ``last``, its last line.
    """
    shutil.rmtree(out, ignore_errors=True)
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), perf_counter()
    line = [command(), "run", str(study), "--out", str(out), *options]
    done = subprocess.run(line, capture_output=True, text=True, env=os.environ | {"COLUMNS": "200"}, check=False)
    wall, after = perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    study.with_suffix(".log").write_text(f"{' '.join(line)}\n{done.stdout}\n{done.stderr}", encoding="utf-8")
    said = [line.strip() for line in (done.stderr or done.stdout).replace("\r", "\n").splitlines() if line.strip()]
    return {
        "exit": done.returncode,
        "processor_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "wall_s": wall,
        "traceback": "Traceback (most recent call last)" in done.stderr,
        "last": said[-1] if said else "",
    }


def verdict(out: Path, ran: Mapping[str, Any]) -> dict[str, Any]:
    """Whether a run's fit converged, the reason where it did not or the run broke off, and checks that failed.

    Args:
        out: Folder of the run.
        ran: From `run`.
    """
    summary = load(out / "summary.json")
    checks: dict[str, Any] = summary.get("checks") or load(out / "checks.json").get("checks", {})
    told = summary.get("fit") or {}
    converged = checks.get("optimum", {}).get("passed") is True and told.get("converged") is not False
    reason = ""
    if ran["traceback"] or ran["exit"] not in (0, 1):
        reason = f"{'traceback' if ran['traceback'] else 'exit ' + str(ran['exit'])}: {ran['last']}"
    elif not converged:
        reason = str(told.get("reason") or ("its optimum did not converge" if checks else ran["last"]))
    failed = [name for name, one in checks.items() if one.get("passed") is False and name != "calibration"]
    left = {key: told[key] for key in ("tried", "residuals") if told.get(key) and not converged}
    made = {"converged": converged, "reason": reason, "label": summary.get("label", ""), "failed": failed}
    return made | ({"best_found": left} if left else {})


def terms(out: Path) -> list[str]:
    """Terms that were fitted."""
    for name in ("fit/priors.json", "priors.json"):
        if (out / name).is_file():
            priors = json.loads((out / name).read_text(encoding="utf-8"))
            return [p["name"] for p in priors if p["name"].startswith(KINDS)]
    return []


def residuals(out: Path, flight: str, noise: Mapping[str, Any], canopies: int) -> dict[str, dict[str, Any]]:
    """Root mean square residual of every fitted channel, beside the noise that the study told and that was found.

    The residual is of the mean posterior prediction; each component counts alike. Units: m, m/s, rad, N.

    Args:
        out: Folder of the run.
        flight: Name of the flight.
        noise: The study's table of that name.
        canopies: How many.
    """
    import xarray as xr

    if not (out / "posterior.nc").is_file():
        return {}
    with xr.open_datatree(out / "posterior.nc", engine="h5netcdf") as tree:
        if any(group not in tree.children or flight not in tree[group].ds for group in _GROUPS):
            return {}
        seen = np.asarray(tree["observed_data"].ds[flight])
        off = seen - np.asarray(tree["posterior_predictive"].ds[flight].mean(("chain", "draw")))
    found, made, first = load(out / "summary.json").get("noise", {}), {}, 0
    for name, (alone, each) in SIZES.items():
        if name not in noise:
            continue
        part = off[:, first : first + alone + each * canopies]
        first += alone + each * canopies
        made[name] = {
            "rms": float(np.sqrt(np.nanmean(part**2))),
            "told": {key: noise[name].get(key) for key in ("white", "correlated")},
            "found": {key: found.get(name, {}).get(key) for key in ("white", "correlated")},
        }
    return made if first == seen.shape[1] else {}


def histories(data: Path, flight: str, quantity: str) -> tuple[list[History], bool]:
    """True histories of a flight and its replicates, or its own record, and whether they are true."""
    key = QUANTITIES[quantity][0]
    made = []
    for path in sorted((data / "truth").glob(f"{flight}_*.npz")):
        with np.load(path) as file:
            made.append(History(np.asarray(file["time_s"], float), np.asarray(file[key], float)))
    if made:
        return made, True
    own = read_flight(data, flight)
    return [History(own.time, own.quantities()[quantity])], False


def foretold(out: Path, flight: str) -> xr.Dataset | None:
    """Bands of a flight that a run has predicted; None where it has not."""
    import xarray as xr

    if not (out / "predictions.nc").is_file():
        return None
    with xr.open_datatree(out / "predictions.nc", engine="h5netcdf") as tree:
        return tree[flight].to_dataset().load() if flight in tree.children else None


def by_posterior(data: Path, out: Path, flight: str) -> xr.Dataset | None:
    """Bands of a flight with another number of canopies, from the posterior of a run; None without one."""
    import bayeschute as bc

    if not (out / "posterior.nc").is_file():
        return None
    posterior = bc.Run(out, bc.Study.load(out / "study.toml")).posterior
    made = posterior.predict(flight_alone(data, flight, out.parent))
    return made.draws.quantile(list(LEVELS), "draw")


def scored(data: Path, first: str, flight: str, bands: xr.Dataset | None) -> dict[str, dict[str, Any]]:
    """Scores of a predicted flight by quantity; none where nothing was predicted.

    Args:
        data: Folder of the sets.
        first: The flight that was identified.
        flight: The flight.
        bands: Its quantities by ``quantile`` and ``time``, SI.
    """
    if bands is None:
        return {}
    usual, made = climatology(read_flight(data, first), LEVELS), {}
    time = bands["time"].values.astype(float)
    for name, (_, factor, unit) in QUANTITIES.items():
        if name not in bands or not np.isfinite(bands[name].values).all(axis=0).any():
            continue  # no band: every simulation failed
        band = factor * bands[name].sel(quantile=list(LEVELS), method="nearest").transpose("quantile", "time").values
        truth, true = histories(data, flight, name)
        ours, plain = score(time, band, truth), score(time, constant(usual[name], time), truth)
        made[name] = ours._asdict() | {
            "unit": unit,
            "against": f"{len(truth)} true histories" if true else "its own record",
            "true": true,
            "climatology": plain._asdict(),
            "wis_over_climatology": ours.wis / plain.wis,
            "width_over_replicates": width_over_spread(time, band, truth) if len(truth) > 1 else None,
        }
    return made


def turned(names: Sequence[str], number: int) -> list[str]:
    """Flights of a set, that of a number first."""
    return sorted(names, key=lambda name: (not name.endswith(f"_{number}"), name))


def by_canopies(data: Path, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Flights with as many canopies as the first, which one study holds, and the others."""
    numbers = {name: read_flight(data, name).meta["n_canopies"] for name in names}
    same = [name for name in names if numbers[name] == numbers[names[0]]]
    return same, [name for name in names if name not in same]


def key_of(folder: Path, study: Path, quick: bool) -> str:
    """What a result depends on: study, vehicle and size of the run."""
    text = study.read_text(encoding="utf-8") + (folder / "vehicle.toml").read_text(encoding="utf-8")
    return hashlib.sha256(f"{text}{quick}".encode()).hexdigest()


def whole_flights(
    data: Path, study: Path, names: Sequence[str], others: Sequence[str], options: Sequence[str]
) -> dict[str, Any]:
    """Run a set's study and score what it foretells, and what its posterior does of flights with other canopies."""
    out, tables = study.parent / "run", tomllib.loads(study.read_text(encoding="utf-8"))
    ran = run(study, out, *options)
    told, count = verdict(out, ran), read_flight(data, names[0]).meta["n_canopies"]
    return {
        **{"processor_s": ran["processor_s"], "wall_s": ran["wall_s"], "exit": ran["exit"]}, **told,
        "terms": terms(out),
        "residuals": residuals(out, names[0], tables["noise"], count),
        "flights": {name: scored(data, names[0], name, foretold(out, name)) for name in names[1:]}
        | {name: scored(data, names[0], name, by_posterior(data, out, name)) for name in others},
    }  # fmt: skip


def independent(name: str, folder: Path, resume: bool) -> Path:
    """The folder of flights of `independent_flights`, by kind and seed such as ``two-mains-1``; made if need be."""
    kind, _, seed = name.rpartition("-")
    if kind not in independent_flights.KINDS or not seed.isdigit():
        kinds = ", ".join(independent_flights.KINDS)
        sys.exit(f"--independent {name}: kind and seed, such as two-mains-1; kinds are {kinds}")
    data = folder / "data"
    if not (resume and data.is_dir()):
        shutil.rmtree(data, ignore_errors=True)
        part = folder / "data.part"  # a set that was stopped half-way is none
        shutil.rmtree(part, ignore_errors=True)
        independent_flights.make_set(part, independent_flights.KINDS[kind], int(seed))
        part.rename(data)
    return data


def set_results(data: Path, letter: str, folder: Path, given: argparse.Namespace, name: str = "") -> dict[str, Any]:
    """All results of a set, kept as they come in ``results.json`` of its folder.

    Args:
        data: Folder of the flights.
        letter: By which their files and layout go.
        folder: Of studies, runs and results.
        given: Options.
        name: By which results are told; empty: the letter.
    """
    called = name or letter
    kept, others = by_canopies(data, turned(flights_of(data, letter), given.identify))
    study, path = write_set(data, kept, folder), folder / "results.json"
    options = ["--quick"] if given.quick else []
    results = load(path) if given.resume else {}

    def get(name: str, of: Path, make: Any, length: str | None = None) -> dict[str, Any]:
        known, key = results.get(name, {}), key_of(folder, of, given.quick)
        if known.get("key") != key:
            told = made_now(called, length, given.identify)  # before: files may be changed while it runs
            results[name] = known = make() | {"key": key, "provenance": told, "quick": given.quick}
            path.write_text(json.dumps(results, indent=1), encoding="utf-8")
        return dict(known)

    made: dict[str, Any] = {"windows": {}}
    if not given.only_windows:
        name = "whole" if given.identify == 1 else f"from_{given.identify}"
        made["whole"] = get(name, study, lambda: whole_flights(data, study, kept, others, options))
    for length in given.windows:
        part = write_window(data, kept[0], length, folder)
        if part is None:
            made["windows"][f"{length:g}"] = {"skipped": "the record is shorter"}
            continue

        def fit(part: Path = part) -> dict[str, Any]:
            out = folder / part.stem
            ran = run(part, out, "--until", "check", *options)
            return {"processor_s": ran["processor_s"], "wall_s": ran["wall_s"], **verdict(out, ran)}

        made["windows"][f"{length:g}"] = get(part.stem, part, fit, f"{length:g}")
    return made


def _number(value: Any) -> str:
    return value if isinstance(value, str) else "?" if value is None else f"{value:.3g}"


def _words(one: Mapping[str, Any]) -> str:
    return ", ".join(filter(None, ("converged" if one["converged"] else "NOT CONVERGED", one["reason"])))


def lines(letter: str, made: Mapping[str, Any]) -> list[str]:
    """A set's results in words."""
    said = []
    if "whole" in made:
        said += _whole_lines(letter, made["whole"])
    for length, one in made["windows"].items():
        if "skipped" in one:
            said.append(f"{letter}  {length} s: {one['skipped']}")
            continue
        words = _words(one)
        failed = f"; checks failed: {', '.join(one['failed'])}" if one["failed"] else ""
        said.append(f"{letter}  {length} s: {words}; {one['processor_s']:.0f} s processor{failed}")
        said += _best_found(one.get("best_found", {}))
    return said


def _best_found(left: Mapping[str, Any]) -> list[str]:
    """What a fit that failed has tried, and the residuals of the best flights it found."""
    said = [f"   tried: {words}" for words in left.get("tried", ())]
    for flight, outputs in left.get("residuals", {}).items():
        rows = [f"{name} {_number(one['rms'])} (noise {_number(one['noise'])})" for name, one in outputs.items()]
        said.append(f"   best {flight} found, residual rms: {', '.join(rows)}")
    return said


def _whole_lines(letter: str, whole: Mapping[str, Any]) -> list[str]:
    words = _words(whole)
    clock = f"{whole['processor_s']:.0f} s processor, {whole['wall_s']:.0f} s wall, exit {whole['exit']}"
    said = [f"{letter}  {words}; {clock}; checks failed: {', '.join(whole['failed']) or 'none'}"]
    said += _best_found(whole.get("best_found", {}))
    said += [f"   {whole['label']}"] if whole["label"] else []
    said.append(f"   {len(whole['terms'])} terms: {', '.join(whole['terms'])}")
    for name, one in whole["residuals"].items():
        told, found = (" + ".join(_number(one[k][p]) for p in ("white", "correlated")) for k in ("told", "found"))
        said.append(f"   {name}: residual rms {one['rms']:.3g}; noise told {told}, found {found} (SI)")
    for flight, quantities in whole["flights"].items():
        if not quantities:
            said.append(f"   {flight}: not predicted")
        for name, s in quantities.items():
            spread = "" if s["width_over_replicates"] is None else f" ({s['width_over_replicates']:.2f} of replicates')"
            said.append(
                f"   {flight} {name:<22} [{s['unit']}] held {100 * s['held']:3.0f} %, width {s['width']:.2f}{spread}, "
                f"bias {s['bias']:+.2f}, WIS {s['wis']:.3f}, climatology {s['climatology']['wis']:.3f}, "
                f"ratio {s['wis_over_climatology']:.2f}; {s['against']}"
            )
    return said


def ratios(results: Mapping[str, Any]) -> dict[str, float | None]:
    """Shares over all sets; what no fit that converged has foretold is not better than climatology."""
    wholes = [one["whole"] for one in results.values() if "whole" in one]
    windows = [w for one in results.values() for w in one["windows"].values() if "converged" in w]
    flights = [flight if whole["converged"] else {} for whole in wholes for flight in whole["flights"].values()]
    pairs = [s for flight in flights for s in flight.values()]

    def share(values: Sequence[bool], of: int) -> float | None:
        return sum(values) / of if of else None

    def held(name: str) -> float | None:
        true = [flight[name] for flight in flights if name in flight and flight[name]["true"]]
        return float(np.average([s["held"] for s in true], weights=[s["samples"] for s in true])) if true else None

    expected = len(QUANTITIES) * len(flights)
    made = {
        "converged_share": share([w["converged"] for w in wholes], len(wholes)),
        "windows_converged_share": share([w["converged"] for w in windows], len(windows)),
        "predicted_share": share([True] * len(pairs), expected),
        "pooled_swing_coverage": held("swing_angle"),
        "pooled_descent_coverage": held("sea_level_descent_rate"),
        "better_than_climatology_share": share([s["wis_over_climatology"] < 1.0 for s in pairs], expected),
    }
    return {name: value for name, value in made.items() if value is not None}


def context(results: Mapping[str, Any]) -> dict[str, Any]:
    """What stands beside the ratios: everything, and scores over climatology's by flight and quantity."""
    over = {
        flight: {name: s["wis_over_climatology"] for name, s in quantities.items()}
        for one in results.values()
        for flight, quantities in one.get("whole", {}).get("flights", {}).items()
    }
    return {"wis_over_climatology_ratio": over, "sets": dict(results)}


def main() -> None:
    """Run, print the table, and with ``--json`` one object as the last line."""
    parser = parser_of(__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/otherflights"), help="folder of the sets")
    parser.add_argument("--sets", nargs="+", choices=list(LAYOUTS), default=list(LAYOUTS))
    parser.add_argument(
        "--independent", nargs="+", default=[], metavar="KIND-SEED", help="flights of independent_flights.py instead"
    )
    parser.add_argument("--windows", type=float, nargs="*", default=[], metavar="S", help="lengths to be fitted too")
    parser.add_argument("--only-windows", action="store_true", help="leave the whole flights out")
    parser.add_argument("--identify", type=int, default=1, metavar="N", help="number of the flight that is fitted")
    parser.add_argument("--workdir", type=Path, help="studies, runs and results  [default: a temporary folder]")
    parser.add_argument("--resume", action="store_true", help="take what the working folder holds")
    parser.add_argument("--prepare", action="store_true", help="write the studies and stop")
    parser.add_argument("--quick", action="store_true", help="small sizes, to see that all works")
    parser.add_argument("--store", type=Path, metavar="DIR", help="keep the results there, a file per set")
    parser.add_argument("--made-at", metavar="COMMIT", help="run nothing: store what the working folder holds")
    given = parser.parse_args()
    if given.windows and given.identify != 1:
        sys.exit("--windows are of the first flight: leave --identify out")
    if given.store and given.quick:
        sys.exit("--store keeps no results of small sizes: leave --quick out")
    if given.made_at:
        if given.store is None or given.workdir is None:
            sys.exit("--made-at stores what --workdir holds into --store: name both")
        for name in given.independent or given.sets:
            print(store(name, given.workdir / name, given.store, given.made_at))
        return
    if not given.independent and not given.data.is_dir():
        sys.exit(f"{given.data}: no such folder; --data says where the flights are")
    if not given.independent:
        given.sets = [one for one in given.sets if f"{one}_{given.identify}" in flights_of(given.data, one)]
    if not given.sets:
        sys.exit(f"no set of {given.data} that was asked for has a flight of number {given.identify}")
    if given.prepare and given.workdir is None:
        sys.exit("--prepare writes into --workdir: name one")
    with tempfile.TemporaryDirectory() as temporary:
        place = given.workdir or Path(temporary)
        results = {}
        for name in given.independent or given.sets:
            letter, data = name, given.data
            if given.independent:
                letter, data = _LETTER, independent(name, place / name, given.resume)
            if given.prepare:
                names = turned(flights_of(data, letter), given.identify)
                print(write_set(data, by_canopies(data, names)[0], place / name))
                continue
            results[name] = made = set_results(data, letter, place / name, given, name)
            print("\n".join(lines(name, made)), flush=True)
            if given.store:
                print(store(name, place / name, given.store))
    if given.prepare:
        return
    shares = ratios(results)
    print("all sets: " + ", ".join(f"{name.replace('_', ' ')} {value:.2f}" for name, value in shares.items()))
    wholes = [one["whole"] for one in results.values() if "whole" in one]
    if wholes:
        print("all sets converged" if all(w["converged"] for w in wholes) else "NOT all sets converged")
    print_result(given, shares, context(results))


if __name__ == "__main__":
    main()
