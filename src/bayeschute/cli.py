"""Command line: thin commands on public functions.

Exit codes: 0 success, 1 a check of the result or the fit failed, 2 invalid input, 3 the system refused (a full disk,
rights, memory), 130 stopped by the user. Packages that are slow to import are imported inside the commands, so that
`--help` and `check` are quick.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from bayeschute.console import Bars, place_for_json, reporting_faults, say, write_json
from bayeschute.core.errors import Fault, InputError
from bayeschute.core.version import __version__

app = typer.Typer(
    name="bayeschute",
    help="Bayesian system identification of capsules under parachutes: posterior, predictive bands, risk.",
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


class Question(StrEnum):
    """What may be asked of landings beside their requirements."""

    SHARES = "shares"
    RARE = "rare"
    PLACARD = "placard"
    DESIGN = "design"


StudyPath = Annotated[Path, typer.Argument(metavar="STUDY", help="Study file (TOML).", show_default=False)]
PosteriorPath = Annotated[
    Path, typer.Argument(metavar="POSTERIOR", help="From `bayeschute fit`, or a run's folder.", show_default=False)
]
DataDir = Annotated[
    Path | None, typer.Option("--data", metavar="DIR", help="Folder that replaces ${DATA} in the study.")
]
Seed = Annotated[int | None, typer.Option(min=0, max=2**32 - 1, help="Random seed, in place of the study's.")]
Quick = Annotated[bool, typer.Option("--quick", help="Few draws, to test the set-up; results are not for use.")]
JsonFile = Annotated[
    str | None, typer.Option(metavar="FILE", help="Write results as JSON; - prints them instead of the table.")
]
Workers = Annotated[int, typer.Option(min=1, max=1024, help="Number of local processes.")]
DaskAddress = Annotated[
    str | None, typer.Option("--dask", metavar="ADDRESS", help="Dask scheduler to use instead of --workers.")
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
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder for the results.  [default: runs/NAME of the study]")
    ] = None,
    until: Annotated[Stage | None, typer.Option(help="Last stage to run.")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue an earlier run; stages whose inputs are unchanged are reused.")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="Remove the results of an earlier run in the folder and start again.")
    ] = False,
    quick: Quick = False,
    data: DataDir = None,
    seed: Seed = None,
    workers: Workers = 1,
    dask: DaskAddress = None,
) -> None:
    """Run a study: posterior, predictive bands, risk and report; --workers and --dask share out the predictions."""
    folder, last = out or Path("runs") / study.stem, until.value if until else None
    given = {"--until": last, "--data": data, "--seed": seed, "--workers": workers if workers > 1 else None}
    options = [str(part) for item in (given | {"--dask": dask}).items() if item[1] is not None for part in item]
    same = ["bayeschute", "run", study, "--out", folder, "--resume", *(["--quick"] if quick else []), *options]
    kept = "finished stages, and of a fit its terms with their optimum, and its draws"
    again = f"`{shlex.join(map(str, same))}` goes on; it keeps {kept}."
    with reporting_faults(again):
        _free_folder(folder)
        _sound(study, data)  # before anything slow is imported, and before anything is written
        from bayeschute.study.run.stages import run_study

        with Bars() as bars:
            summary = run_study(
                study, folder, until=last, resume=resume, quick=quick, data_dir=data, seed=seed, progress=bars,
                workers=workers, address=dask, force=force,
            )  # fmt: skip
        if last not in ("ingest", "structure", "priors"):
            _exit_if_fit_failed(folder, summary)
        if last == "structure" and (folder / "structure.txt").is_file():
            say((folder / "structure.txt").read_text(encoding="utf-8"))
        say(f"Results are in {folder}")
        if (folder / "report.html").is_file() and last in (None, "report"):
            say(f"Report: {folder / 'report.html'}")
        told = summary if last in (None, "report") else {}
        checks: dict[str, Any] = told.get("checks", {})
        # Coverage over replicates is part of the label; it does not make this run fail.
        failed = [name for name, one in checks.items() if one.get("passed") is False and name != "calibration"]
        if "bands" in checks:
            say(f"Failed check: {checks['bands']['detail']}.", error=True)
        if told.get("label"):
            say(f"Intervals: {told['label']}")
            for text in summary.get("claim", {}).get("sentences", ()):
                say(f"  {text}")
        _judged(quick, failed, ". The report explains them.")


@app.command()
def fit(
    study: StudyPath,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Output file.  [default: NAME.posterior.nc in the current folder]"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    quick: Quick = False,
    data: DataDir = None,
    seed: Seed = None,
    prior: Annotated[
        Path | None,
        typer.Option(metavar="POSTERIOR", help="Posterior of earlier drops, as for `predict`: this study's prior."),
    ] = None,
) -> None:
    """Fit the records of a study and sample the posterior, into one file from which other flights can be predicted."""
    path = out or Path(f"{study.stem}.posterior.nc")
    with reporting_faults():
        if path.exists() and not force:
            do = "Give another --out, or --force to overwrite it."
            raise InputError(Fault(f"--out {path}", "a file that is there already", "a new file", do))
        _sound(study, data)
        from bayeschute.api.inputs import Study
        from bayeschute.api.posterior import Posterior
        from bayeschute.api.verbs import fit as fit_flights
        from bayeschute.api.verbs import sample
        from bayeschute.core.errors import FitError

        wanted = Study.load(study, data)
        if seed is not None:
            wanted = Study(replace(wanted.spec, seed=seed))
        wanted = wanted.quick() if quick else wanted
        before = None if prior is None else Posterior.load(prior)
        try:
            with Bars() as bars:
                if before is None:
                    posterior = sample(fit_flights(wanted, progress=bars), progress=bars)
                else:
                    posterior = before.update(wanted, progress=bars)
        except FitError as error:
            _no_fit(error.reason, error.tried)
            raise typer.Exit(1) from None
        posterior.save(path)
        say(posterior.summary().to_string())
        if before is not None:
            lessons = posterior.taught()
            say(lessons[["prior_sd", "sd", "shift", "gain"]].to_string(float_format=lambda x: f"{x:.4g}"))
            for drop, gain in lessons.attrs["joint"].items():
                say(f"{drop} taught {gain:.4g} nats about all parameters together")
        say(f"Posterior: {path}")
        _judged(quick, posterior.failed_checks)


@app.command()
def predict(
    posterior: PosteriorPath,
    flights: Annotated[
        Path, typer.Argument(metavar="FLIGHT", help="TOML with [[flight]] tables, as in a study.", show_default=False)
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the results.  [default: runs/NAME of the flight file]"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite predictions that are there.")] = False,
    draws: Annotated[int | None, typer.Option(min=16, max=1_000_000, help="Posterior draws per flight.")] = None,
    like: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Fitted flight whose body flies, where each has parameters of its own."),
    ] = None,
    data: DataDir = None,
    seed: Seed = None,
) -> None:
    """Predict other flights from a stored posterior: bands, and probabilities of meeting requirements."""
    folder = out or Path("runs") / flights.stem
    with reporting_faults():
        _free_folder(folder)
        if (folder / "predictions.nc").exists() and not force:
            do = "Choose another folder, or --force to overwrite them."
            raise InputError(Fault(f"--out {folder}", "a folder with predictions", "one without predictions.nc", do))
        from bayeschute.api.forecasting import predict_file

        with Bars() as bars:
            made = predict_file(posterior, flights, folder, draws, seed, data, bars, like)
        for line in made:
            say(line)
        say(f"Results are in {folder}")


@app.command(name="land")
def land_command(
    posterior: PosteriorPath,
    campaign: Annotated[Path, typer.Argument(metavar="CAMPAIGN", help="Campaign file (TOML).", show_default=False)],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Results.  [default: runs/NAME of the campaign file]")
    ] = None,
    landings: Annotated[
        int | None, typer.Option(min=64, max=10_000_000, help="At most so many, in place of the campaign's number.")
    ] = None,
    also: Annotated[
        list[Question] | None,
        typer.Option(
            help="What drives it (shares), failures too rare to count (rare), go or no-go by shear and payload "
            "(placard), which drop next (design); may be given again."
        ),
    ] = None,
    jsbsim_draws: Annotated[
        int, typer.Option(min=0, help="Aerodynamics for JSBSim of so many draws, a file each, beside their mean's.")
    ] = 0,
    data: DataDir = None,
    workers: Workers = 1,
    dask: DaskAddress = None,
) -> None:
    """Landings to the ground by a stored posterior: how likely they meet their limits, and how sure that is."""
    folder = out or Path("runs") / campaign.stem
    with reporting_faults("Finished batches are kept; the same command continues."):
        _free_folder(folder)
        from bayeschute.study.landing_campaign.campaign_file import load_campaign

        load_campaign(campaign, data)  # before anything slow is imported
        from bayeschute.api.landing.landing_command import LandingOptions, land_file

        wanted = LandingOptions(
            landings, workers, dask, tuple(dict.fromkeys(one.value for one in also or ())), jsbsim_draws
        )
        with Bars() as bars:
            made = land_file(posterior, campaign, folder, wanted, data, bars)
        for line in made:
            say(line)
        say(f"Results are in {folder}")


def _no_fit(reason: str, tried: Iterable[str]) -> None:
    """Print why a fit failed and what was tried, a line each."""
    for what, text in (("No fit", reason), *(("Tried", line) for line in tried)):
        say(f"{what}: {' '.join(str(text).split())}", error=True)


def _judged(quick: bool, failed: Sequence[str], end: str = "") -> None:
    """Say what checks mean for the results; exit with code 1 where some failed of a run that isn't quick."""
    if quick:
        say("Quick run with few draws: the results are not for use.")
    elif failed:
        say(f"Failed checks: {', '.join(failed)}{end}", error=True)
        raise typer.Exit(1)


def _exit_if_fit_failed(folder: Path, summary: dict[str, Any]) -> None:
    """Say so and exit with code 1; return if the fit did not fail."""
    fit: dict[str, Any] = summary.get("fit", {})
    if not fit.get("reason"):
        return
    _no_fit(fit["reason"], fit.get("tried", ()))
    say(f"Results that need no fit are in {folder}")
    say(f"Report: {folder / 'report.html'}")
    raise typer.Exit(1)


@app.command()
def check(
    study: StudyPath,
    report: Annotated[
        Path | None, typer.Option("--report", metavar="FILE", help="Draw the records, before any fit (one HTML file).")
    ] = None,
    data: DataDir = None,
) -> None:
    """Check a study and its files, list all faults at once, and test the records against physical laws."""
    with reporting_faults():
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
    draws: Annotated[
        int, typer.Option(min=1, max=100_000, help="Number of drops, each with its own wind and noise.")
    ] = 1,
    seed: Seed = None,
    workers: Workers = 1,
    dask: DaskAddress = None,
) -> None:
    """Simulate virtual drops: records with sensor errors, and the true motion."""
    with reporting_faults("Finished drops are kept; the same command continues."):
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
            say(f"{drops.kept} existed already")
        say("Outcome: " + ", ".join(f"{words} {count}" for words, count in drops.outcomes.items()))
        if any(drops.step_error):
            place, speed = drops.step_error
            say(f"Integration error of drops that are ok: up to {place:.1g} m in position, {speed:.1g} m/s in velocity")
        for name, what in list(drops.failed.items())[:10]:
            say(f"{name}: {what}", error=True)
        if drops.failed:
            raise typer.Exit(1)


@app.command()
def verify(
    case: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Only this case, such as 6a; may be repeated.")
    ] = None,
    json: JsonFile = None,
) -> None:
    """Verify the simulator: simulate the check cases and compare them with closed-form solutions."""
    with reporting_faults():
        from bayeschute.verification.catalogue import choose

        choose(case or ())  # raises on unknown names before anything slow is imported
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
        Path | None, typer.Option(metavar="DIR", help="Folder for the results.  [default: runs/calibration/NAME]")
    ] = None,
    replicates: Annotated[int, typer.Option(min=2, help="Replicates to simulate, identify and predict.")] = 100,
    disturbance: Annotated[
        str,
        typer.Option(metavar="NAME", help="Misspecification scenario of the simulated flights; `list` prints them."),
    ] = "none",
    noise: Annotated[
        str | None,
        typer.Option(
            metavar="MODEL", help="Noise model, in place of the study's: latent, ar1, ar1+white, sandwich, white."
        ),
    ] = None,
    workers: Workers = 1,
    dask: DaskAddress = None,
    quick: Quick = False,
    ranks: Annotated[
        str | None,
        typer.Option(
            metavar="TRUTHS",
            help="Rank tests of the inference instead (simulation-based calibration); truths from posterior or prior.",
        ),
    ] = None,
) -> None:
    """Measure the coverage of intervals and bands over replicates of a virtual study."""
    from bayeschute.study.evidence.scenarios import SCENARIOS

    if disturbance == "list":
        for name, kind in SCENARIOS.items():
            say(f"{name:14} {kind.says}")
        return
    folder = out or Path("runs") / "calibration" / study.stem
    with reporting_faults("Finished replicates are kept; the same command continues."):
        _free_folder(folder)
        _sound(study, None)
        if ranks is not None:
            _rank_tests(study, folder, replicates, ranks, workers, dask)
            return
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


def _rank_tests(study: Path, folder: Path, replicates: int, truths: str, workers: int, dask: str | None) -> None:
    """Run rank tests and print their table; exit with code 1 where ranks are not uniform."""
    from bayeschute.calibration.rank_tables import rank_lines
    from bayeschute.study.rank_tests import rank_tests

    with Bars() as bars:
        result = rank_tests(
            study, folder, replicates, truths, workers, dask, lambda share, words: bars("ranks", share, words)
        )
    say("\n".join(rank_lines(result)))
    say(f"Results are in {folder}")
    if not result["passed"]:
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
            help="Column of the log for time, capsule_rate, capsule_specific_force, pressure or altitude; "
            "* in the name stands for x, y and z. Repeat for each quantity; not needed for nc.",
        ),
    ] = None,
    window: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="START END", help="Start and end of the descent [s].  [default: detected in the log]"),
    ] = None,
    band: Annotated[
        tuple[float, float] | None, typer.Option(metavar="LOW HIGH", help="Frequency band of the swing [Hz].")
    ] = None,
    free: Annotated[bool, typer.Option("--free", help="Model without gust excitation, for comparison.")] = False,
    seed: Annotated[int, typer.Option(min=0, max=2**32 - 1, help="Random seed of the draws.")] = 0,
    json: JsonFile = None,
) -> None:
    """Estimate frequency and damping of the swing under a parachute from raw gyro and accelerometer data."""
    with reporting_faults():
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
    """Rebuild report.html from the results of a run."""
    with reporting_faults():
        if not folder.is_dir():
            raise InputError(Fault(str(folder), "no such folder", "the folder of a run"))
        from bayeschute.report.page import build_report

        say(f"Report: {build_report(folder)}")


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the files.", show_default=False)],
) -> None:
    """Copy a vehicle, example studies and a campaign of landings into DIR as a starting point."""
    with reporting_faults():
        from bayeschute.study.templates import copy_templates

        for path in copy_templates(folder):
            say(str(path))
        say(f"Try `bayeschute run {folder / 'virtual.toml'} --quick`; then read the comments in the other studies.")


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
    """Bayesian system identification of capsules under parachutes: posterior, predictive bands, risk."""


def main() -> None:
    """Entry point of the installed command."""
    app()
