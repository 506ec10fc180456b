"""The door for the shell: thin commands on public functions.

Exit codes: 0 all well, 1 a check of the result failed or the fit did, 2 the input is bad, 130 stopped by the user.
Whatever is slow to import is imported inside the commands, so that `--help` and `check` stay quick.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from bayeschute.console import Bars, place_for_json, say, told, write_json
from bayeschute.core.errors import Fault, InputError
from bayeschute.core.version import __version__

app = typer.Typer(
    name="bayeschute",
    help="Parachute cluster dynamics from flight records: posterior, honest bands, risk numbers.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode=None,
)


class Stage(StrEnum):
    """Stages of a run, in order."""

    INGEST = "ingest"
    STRUCTURE = "structure"
    PRIORS = "priors"
    FIT = "fit"
    CHECK = "check"
    PREDICT = "predict"
    RISK = "risk"
    REPORT = "report"


StudyPath = Annotated[Path, typer.Argument(metavar="STUDY", help="Study file (TOML).", show_default=False)]
DataDir = Annotated[
    Path | None, typer.Option("--data", metavar="DIR", help="Folder that ${DATA} stands for in the study.")
]
Seed = Annotated[int | None, typer.Option(min=0, max=2**32 - 1, help="Replaces the study's seed.")]
Workers = Annotated[int, typer.Option(min=1, max=1024, help="Local processes.")]
DaskAddress = Annotated[
    str | None, typer.Option("--dask", metavar="ADDRESS", help="Dask scheduler, in place of --workers.")
]


def _free_folder(out: Path) -> None:
    """Refuse an output path that is a file."""
    if out.exists() and not out.is_dir():
        raise InputError(Fault(f"--out {out}", "a file", "a folder, which may exist", "Choose another path."))


def _sound(study: Path, data: Path | None) -> None:
    """Refuse a study that has any fault, its records read in full and tried for their physics; say warnings."""
    from bayeschute.study.load import examine_study

    found = examine_study(study, data)
    for line in found.warnings:
        say(f"warning: {line}", error=True)
    if found.faults:
        raise InputError(found.faults)


@app.command()
def run(
    study: StudyPath,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Results.  [default: runs/NAME of the study]")] = None,
    until: Annotated[Stage | None, typer.Option(help="Last stage to run.")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on in the folder of an earlier run, reuse stages that read the same.")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Begin anew in the folder of an earlier run, its results removed first.")
    ] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Small sizes, to see that all works; not for use.")] = False,
    data: DataDir = None,
    seed: Seed = None,
    workers: Workers = 1,
    dask: DaskAddress = None,
) -> None:
    """Records and a study to posterior, bands and report; --workers and --dask share out the predictions."""
    folder = out or Path("runs") / study.stem
    again = f"`bayeschute run {study} --out {folder} --resume` goes on from the last finished stage."
    with told(again):
        _free_folder(folder)
        _sound(study, data)  # before anything slow is imported, and before anything is written
        from bayeschute.study.run.stages import run_study

        last = until.value if until else None
        with Bars() as bars:
            run_study(
                study, folder, until=last, resume=resume, quick=quick, data_dir=data, seed=seed, progress=bars,
                workers=workers, address=dask, force=force,
            )  # fmt: skip
        summary = _summary_of(folder)
        if last not in ("ingest", "structure", "priors"):
            _tell_of_no_fit(folder, summary)
        if last == "structure" and (folder / "structure.txt").is_file():
            say((folder / "structure.txt").read_text(encoding="utf-8"))
        say(f"Results are in {folder}")
        if (folder / "report.html").is_file() and last in (None, "report"):
            say(f"Report: {folder / 'report.html'}")
        label, failed = ("", []) if last not in (None, "report") else _told_by(summary)
        for name in _without_bands(summary) if last in (None, "predict", "risk", "report") else ():
            say(f"Bands of {name}: none, every simulation of its forecast failed.", error=True)
        if label:
            say(f"Intervals: {label}")
        if quick:
            say("Quick run: sizes too small for use.")
        elif failed:
            say(f"Checks that failed: {', '.join(failed)}. The report says what they mean.", error=True)
            raise typer.Exit(1)


@app.command()
def fit(
    study: StudyPath,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Where to.  [default: NAME.posterior.nc beside you]")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Small sizes, to see that all works; not for use.")] = False,
    data: DataDir = None,
    seed: Seed = None,
) -> None:
    """Fit a study's records and draw from the posterior: one file, which can be asked about other flights."""
    path = out or Path(f"{study.stem}.posterior.nc")
    with told():
        if path.exists() and not force:
            do = "Give another --out, or --force to overwrite it."
            raise InputError(Fault(f"--out {path}", "a file that is there already", "a new file", do))
        _sound(study, data)
        from bayeschute.api.inputs import Study
        from bayeschute.api.verbs import fit as fit_flights
        from bayeschute.api.verbs import sample
        from bayeschute.core.errors import FitError

        wanted = Study.load(study, data)
        try:
            with Bars() as bars:
                fitted = fit_flights(wanted.quick() if quick else wanted, seed=seed, progress=bars)
                posterior = sample(fitted, progress=bars)
        except FitError as error:
            say(f"No fit: {error.reason}", error=True)
            for line in error.tried:
                say(f"Tried: {line}", error=True)
            raise typer.Exit(1) from None
        posterior.save(path)
        say(str(posterior.summary()))
        say(f"Posterior: {path}")
        checks = posterior.checks()
        missed = list(checks.index[~checks["passed"].astype(bool)])
        if quick:
            say("Quick run: sizes too small for use.")
        elif missed:
            say(f"Checks that failed: {', '.join(missed)}", error=True)
            raise typer.Exit(1)


@app.command()
def predict(
    posterior: Annotated[Path, typer.Argument(metavar="POSTERIOR", help="From `bayeschute fit`.", show_default=False)],
    flights: Annotated[
        Path, typer.Argument(metavar="FLIGHT", help="TOML with [[flight]] tables, as in a study.", show_default=False)
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Results.  [default: runs/NAME of the flight file]")
    ] = None,
    draws: Annotated[int | None, typer.Option(min=16, max=1_000_000, help="Draws of each flight.")] = None,
    data: DataDir = None,
    seed: Seed = None,
) -> None:
    """Bands of other flights by a stored posterior, and the requirements that they are to meet."""
    folder = out or Path("runs") / flights.stem
    with told():
        _free_folder(folder)
        from bayeschute.api.forecasting import predict_file

        with Bars() as bars:
            made = predict_file(posterior, flights, folder, draws, seed, data, bars)
        for line in made:
            say(line)
        say(f"Results are in {folder}")


def _summary_of(folder: Path) -> dict[str, Any]:
    """summary.json of a run; empty where there is none."""
    import json

    path = folder / "summary.json"
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}


def _tell_of_no_fit(folder: Path, summary: dict[str, Any]) -> None:
    """Say why a fit failed and what was tried, and end with exit code 1; nothing where the fit didn't fail."""
    fit: dict[str, Any] = summary.get("fit", {})
    if not fit.get("reason"):
        return
    say(f"No fit: {' '.join(str(fit['reason']).split())}", error=True)
    for line in fit.get("tried", ()):
        say(f"Tried: {' '.join(str(line).split())}", error=True)
    say(f"What is known all the same is in {folder}")
    say(f"Report: {folder / 'report.html'}")
    raise typer.Exit(1)


def _without_bands(summary: dict[str, Any]) -> list[str]:
    """Flights of whose forecast every simulation failed."""
    coverage: dict[str, dict[str, Any]] = summary.get("coverage", {})
    return [name for name, table in coverage.items() if any(entry.get("draws") == 0 for entry in table.values())]


def _told_by(summary: dict[str, Any]) -> tuple[str, list[str]]:
    """The label of the intervals in a summary, and names of the run's own checks that failed.

    What replicates of the configuration held is in the label; it is no failure of this run.
    """
    checks: dict[str, Any] = summary.get("checks", {})
    failed = [name for name, check in checks.items() if check.get("passed") is False and name != "calibration"]
    return summary.get("label", ""), failed


@app.command()
def check(
    study: StudyPath,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="Draw the records, before any fit (one HTML file).")
    ] = None,
    data: DataDir = None,
) -> None:
    """Name every fault of a study and its files at once, and whatever in its records can't be true."""
    with told():
        from bayeschute.study.load import examine_study

        found = examine_study(study, data)
        if report is not None:
            from bayeschute.report.record_page import write_record_page

            title = found.study.title if found.study is not None else study.stem
            faults = [str(one) for one in found.faults]
            write_record_page(report, title, found.verdicts, faults, found.windows, found.said, found.records)
            say(f"Report: {report}")
        for line in found.warnings:
            say(f"warning: {line}", error=True)
        if found.faults:
            raise InputError(found.faults)
        for line in found.said.values():
            say(line)
        say(f"{study}: no fault found")


@app.command()
def simulate(
    source: Annotated[Path, typer.Argument(metavar="STUDY_OR_VEHICLE", help="Study or vehicle file (TOML).")],
    out: Annotated[Path, typer.Option(metavar="FLIGHT", help="Folder for records and truth.", show_default=False)],
    draws: Annotated[int, typer.Option(min=1, max=100_000, help="Drops, each with winds and noise of its own.")] = 1,
    seed: Seed = None,
    workers: Workers = 1,
    dask: DaskAddress = None,
) -> None:
    """Fly virtual drops: records, and the truth beside."""
    with told("Finished drops are kept; the same command goes on."):
        _free_folder(out)
        from bayeschute.study.load import load_study_or_vehicle

        study = load_study_or_vehicle(source)
        if not any(flight.virtual for flight in study.flights):
            wanted = "a study with a [flight.virtual] table, or a vehicle"
            raise InputError(Fault(str(source), "a study of records only", wanted))
        from bayeschute.study.run.simulate import simulate_study

        with Bars() as bars:
            drops = simulate_study(study, out, draws=draws, seed=seed, progress=bars, workers=workers, address=dask)
        for path in drops.files[:10]:
            say(str(path))
        if len(drops.files) > 10:
            say(f"and {len(drops.files) - 10} more in {out}")
        if drops.kept:
            say(f"{drops.kept} were there already")
        say("Outcome: " + ", ".join(f"{words} {count}" for words, count in drops.outcomes.items()))
        if any(drops.step_error):
            place, speed = drops.step_error
            say(f"Errors due to steps, where ok: positions up to {place:.1g} m, velocities up to {speed:.1g} m/s")
        for name, what in list(drops.failed.items())[:10]:
            say(f"{name}: {what}", error=True)
        if drops.failed:
            raise typer.Exit(1)


@app.command()
def verify(
    case: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this case, such as 6a; may be given again.")
    ] = None,
    json: Annotated[
        str | None, typer.Option(metavar="FILE", help="Results for machines; - prints them in place of the table.")
    ] = None,
) -> None:
    """Fly the check cases and compare them with closed forms."""
    with told():
        from bayeschute.verification.catalogue import choose

        choose(case or ())  # what is wrong is told before anything slow is imported
        place_for_json(json)
        from bayeschute.verification.all_cases import document, verdict, verify
        from bayeschute.verification.case_results import table

        with Bars() as bars:
            results, seconds = verify(case or (), bars)
        if json is not None:
            write_json(document(results, seconds), json)
        if json != "-":
            say("\n".join(table(results)))
            say(f"{verdict(results)}, in {seconds:.0f} s")
        if not all(result.passed for result in results):
            raise typer.Exit(1)


@app.command()
def calibrate(
    study: StudyPath,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Rows and results.  [default: runs/calibration/NAME]")
    ] = None,
    replicates: Annotated[int, typer.Option(min=2, help="Flights to fly, identify and predict.")] = 100,
    disturbance: Annotated[
        str, typer.Option(metavar="NAME", help="What is flown that the identification is not told; `list` names them.")
    ] = "none",
    noise: Annotated[
        str | None,
        typer.Option(metavar="MODEL", help="Replaces [noise] model: latent, ar1, ar1+white, sandwich, white."),
    ] = None,
    workers: Workers = 1,
    dask: DaskAddress = None,
    quick: Annotated[bool, typer.Option("--quick", help="Small sizes, to see that all works; not for use.")] = False,
) -> None:
    """Fly replicates of a study and count what its intervals and bands hold."""
    from bayeschute.study.evidence.scenarios import SCENARIOS

    if disturbance == "list":
        for name, kind in SCENARIOS.items():
            say(f"{name:14} {kind.says}")
        return
    folder = out or Path("runs") / "calibration" / study.stem
    with told("Finished replicates are kept; the same command goes on."):
        _free_folder(folder)
        _sound(study, None)
        from bayeschute.calibration.coverage_tables import lines
        from bayeschute.study.calibrate import calibrate as fly_replicates

        with Bars() as bars:
            result = fly_replicates(
                study, folder, replicates, disturbance, noise, workers, dask, quick,
                progress=lambda share, words: bars("calibrate", share, words),
            )  # fmt: skip
        say("\n".join(lines(result)))
        for seed, error in result["failed"].items():
            say(f"replicate {seed} failed: {error}", error=True)
        say(f"{result['replicates']} replicates, {len(result['failed'])} failed; results are in {folder}")
        if not result["replicates"]:
            raise typer.Exit(1)


@app.command()
def modes(
    record: Annotated[
        Path, typer.Argument(metavar="RECORD", help="Log of a descent: csv, csv.gz, parquet or nc.", show_default=False)
    ],
    column: Annotated[
        list[str] | None,
        typer.Option(
            metavar="QUANTITY=COLUMN:UNIT",
            help="Column of the log: time, capsule_rate, capsule_specific_force, pressure or altitude; "
            "* in its name stands for x, y and z. Again for each; none for nc.",
        ),
    ] = None,
    window: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="START END", help="Times of the descent [s].  [default: found in the log]"),
    ] = None,
    band: Annotated[
        tuple[float, float] | None, typer.Option(metavar="LOW HIGH", help="Where to look for the swing [Hz].")
    ] = None,
    free: Annotated[bool, typer.Option("--free", help="Swing that no gusts drive, for comparison.")] = False,
    seed: Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Of the draws.")] = 0,
    json: Annotated[
        str | None, typer.Option(metavar="FILE", help="Results for machines; - prints them in place of the table.")
    ] = None,
) -> None:
    """Frequency and damping of a body's swing under its parachute, from raw gyro and accelerometer."""
    with told():
        place_for_json(json)
        from bayeschute.study.swing_modes import document, find_modes, lines

        found = find_modes(record, column or (), window, band, not free, seed)
        if json is not None:
            write_json(document(found), json)
        if json != "-":
            say("\n".join(lines(found)))
        if not found.swing.fit.trusted:
            raise typer.Exit(1)


@app.command()
def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a run.", show_default=False)]) -> None:
    """Build report.html again from results."""
    with told():
        if not folder.is_dir():
            raise InputError(Fault(str(folder), "no such folder", "the folder of a run"))
        from bayeschute.report.page import build_report

        say(f"Report: {build_report(folder)}")


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where to put the files.", show_default=False)],
) -> None:
    """Copy files to begin one's own study with into DIR."""
    with told():
        from bayeschute.study.templates import copy_templates

        for path in copy_templates(folder):
            say(str(path))
        say(f"Try `bayeschute run {folder / 'virtual.toml'} --quick`; then read the top of the other studies.")


def _version(wanted: bool) -> None:
    if wanted:
        say(f"bayeschute {__version__}")
        raise typer.Exit()


@app.callback()
def _top(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Parachute cluster dynamics from flight records: posterior, honest bands, risk numbers."""


def main() -> None:
    """Entry point of the installed command."""
    app()


if __name__ == "__main__":
    main()
