"""Functions of the public interface: reconstruct, select_structure, fit, sample, run, calibrate and others."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from bayeschute.api import html
from bayeschute.api.beliefs import Priors, Structure
from bayeschute.api.fitted import Fit
from bayeschute.api.fitting import chosen, drawn, fitted_flights, ingest, sampling, shown, spec_of
from bayeschute.api.flight import Flight
from bayeschute.api.inputs import Study
from bayeschute.api.posterior import Posterior
from bayeschute.api.run_folder import Run
from bayeschute.api.views.flight_motion import Motion
from bayeschute.api.workspace import workspace
from bayeschute.core.errors import Fault, InputError
from bayeschute.records.foreign.conventions import Conventions
from bayeschute.records.read import ColumnSpec
from bayeschute.records.read import read_record as read_columns
from bayeschute.study.job import Progress
from bayeschute.study.schema.belief_schema import NoiseTable
from bayeschute.study.schema.columns import has_wind, with_units_meant
from bayeschute.study.schema.structure_schema import StructureTable

if TYPE_CHECKING:
    from bayeschute.study.run.simulate import Drops

Columns = Mapping[str, tuple[str, str] | tuple[str, str, float] | tuple[str, str, float, float]]


def read_record(path: Path | str, columns: Columns | None = None, **conventions: Any) -> xr.Dataset:
    """Read a flight record: CSV, CSV.gz or Parquet with a column map, or NetCDF in the package's own schema.

    Args:
        path: The file.
        columns: By quantity (``time``, ``altitude``, ``capsule_position.north``, ``canopy_position.1.down``,
            ``capsule_attitude.w``, ...) the column's name and its unit there; where needed, gain and offset after it.
            Also ``capsule_position.up``, ``.west``, ...; ``capsule_attitude.yaw``, ``.pitch``, ``.roll``;
            ``wind.speed`` and ``wind.direction``; ``time.week``; time in ``"iso"``.
        conventions: What names and units don't tell, as `bayeschute.records.foreign.conventions.Conventions` has it:
            ``axes="ENU"``, ``body_axes="-z y x"``, ``attitude="earth to body"``, ``euler="zyx"``, ``wind_is="from"``,
            ``repeated_times="mean"``, ``sort_times=True``, ``clock_wraps=604800.0``, ``lacks=("capsule_rate.y",)``.

    Returns:
        The record in SI at its recorded times.

    Raises:
        InputError: With every fault of map and file.

    Example:
        >>> import bayeschute as bc
        >>> record = bc.read_record("drop.csv", {"time": ("t", "s"), "altitude": ("h", "ft")})  # doctest: +SKIP
    """
    unknown = sorted(set(conventions) - {field.name for field in fields(Conventions)})
    if unknown:
        known = ", ".join(field.name for field in fields(Conventions))
        raise InputError([Fault("read_record", f"{name!r}", f"one of {known}") for name in unknown])
    texts = [name for name, value in conventions.items() if name in _TEXTS and not isinstance(value, str | None)]
    if texts:
        raise InputError([Fault(f"read_record {name}", repr(conventions[name])[:60], "a text") for name in texts])
    specs = _specs(columns) if columns else None
    said = Conventions(**conventions)
    if said.wind_is is not None and specs and not has_wind(specs):
        do = "Leave it out, or name the columns; the winds of `bc.wind_profile` blow towards."
        got = f"{said.wind_is!r} of a record without columns of the wind"
        raise InputError(Fault("read_record wind_is", got, "columns of the wind", do))
    try:
        record = read_columns(path, specs, conventions=said)
    except InputError as error:
        units = {name: spec.unit for name, spec in (specs or {}).items()}
        raise InputError(with_units_meant(error.faults, units)) from None
    return record.assign_attrs({} if str(path).endswith(".nc") else {"body_axes": said.body_axes})


_TEXTS = ("axes", "body_axes", "attitude", "euler", "wind_is", "repeated_times")


def _specs(columns: Columns) -> dict[str, ColumnSpec]:
    """Columns as the reader takes them.

    Raises:
        InputError: For every column that is not a name and a unit, and numbers.
    """
    wanted = "name and unit, such as ('t_ms', 'ms'); gain and offset after them where needed"
    wrong = {
        name: one
        for name, one in columns.items()
        if not isinstance(one, tuple | list)
        or not 2 <= len(one) <= 4
        or not all(isinstance(text, str) for text in one[:2])
        or not all(isinstance(number, Real) for number in one[2:])
    }
    if wrong:
        raise InputError([Fault(f"columns {name!r}", repr(one)[:60], wanted) for name, one in wrong.items()])
    return {name: ColumnSpec(*one) for name, one in columns.items()}


def reconstruct(flight: Flight) -> Motion:
    """Angles, airflow, tensions and force coefficients along a flight's record (report 6.1 and 6.3.5).

    Args:
        flight: Of a cluster.

    Raises:
        InputError: If the flight has no vehicle.

    Example:
        >>> motion = bc.reconstruct(bc.Study.example().flights["cdt-3-12"])
        >>> motion["swing_angle"].attrs["units"]
        'rad'
    """
    from bayeschute.records.reconstruct import reconstruct as along
    from bayeschute.study.assembly.assemble import geometry
    from bayeschute.study.assembly.canopy_wind import canopy_wind

    if flight.vehicle is None:
        raise InputError(Fault(f"flight {flight.name}", "no vehicle", "the flight of a cluster"))
    profile = flight.spec.wind_profile
    aloft = None if profile is None else canopy_wind(flight.record, profile)
    return Motion(flight, along(flight.record, geometry(flight.vehicle, flight.spec.capsule_mass), canopy_wind=aloft))


def select_structure(
    motion: Motion | Flight | Sequence[Motion | Flight],
    candidates: StructureTable | None = None,
    progress: Progress | bool | None = None,
) -> Structure:
    """Which aerodynamic terms the records support, by equation error with colored residuals.

    Args:
        motion: Of one flight or several.
        candidates: Candidate terms and how they are searched, as ``study.candidates``; None: the flights' study's.
        progress: Called with stage, share done and words; True: shown in the terminal.

    Example:
        >>> structure = bc.select_structure(study.flights[0])
        >>> structure.found["coefficients"]  # a point mass has one coefficient
        {}
    """
    from bayeschute.study.run.stage_structure import structure

    several = [motion] if isinstance(motion, Motion | Flight) else list(motion)
    flights = [one.flight if isinstance(one, Motion) else one for one in several]
    spec = spec_of(flights, ("structure", "identify"))
    spec = spec if candidates is None else replace(spec, structure=candidates)
    with shown(progress) as tell, workspace(spec, progress=tell) as job:
        ingest(job, flights)
        structure(job)
        text = job.out / "structure.txt"
        said = text.read_text(encoding="utf-8") if text.is_file() else ""
        return Structure(spec, job.load("structure.json"), said)


def fit(
    flights: Study | Flight | Sequence[Flight],
    priors: Priors | None = None,
    *,
    noise: NoiseTable | None = None,
    seed: int | None = None,
    progress: Progress | bool | None = None,
) -> Fit:
    """Fit simulated flights to records: joint optimum, noise parameters, mode of the marginal posterior.

    Args:
        flights: A study, whose flights with the role ``identify`` are fitted; or flights.
        priors: Of all parameters; None: by `select_structure` and the study's own.
        noise: Noise of channels and latent disturbances; None: the study's, or `Flight.usual_noise` of the first flight
            where there is none.
        seed: Of random numbers; None: the study's.
        progress: Called with stage, share done and words; True: shown in the terminal.

    Raises:
        FitError: If no trajectory of the model follows the records; it lists what was tried.

    Example:
        >>> bc.fit(study.flights[0]).converged
        True
    """
    return Fit(*fitted_flights(chosen(flights), priors, noise, seed, progress))


def sample(
    fitted: Fit,
    draws: int | None = None,
    *,
    chains: int | None = None,
    warmup: int | None = None,
    seed: int | None = None,
    sampler: str | None = None,
    progress: Progress | bool | None = None,
) -> Posterior:
    """Draw from the posterior of a fit, and check fit and draws.

    Args:
        fitted: From `fit`.
        draws: In all; the study's number where None.
        chains: Chains.
        warmup: Warm-up steps of each.
        seed: Seed; the fit's where None.
        sampler: ``nuts``, ``emcee`` or ``both``.
        progress: Called with stage, share done and words; True: shown in the terminal.

    Raises:
        InputError: If a size is out of range.
        FitError: If the draws don't vary in all directions.

    Example:
        >>> bc.sample(fitted, draws=200, chains=2, warmup=50)[fitted.parameters.index[0]].size
        200
    """
    spec = sampling(fitted.spec, draws, chains, warmup, seed, sampler)
    return drawn(spec, fitted.groups, fitted.files, progress, Posterior.of_run)


def run(
    study: Study,
    folder: Path | str,
    *,
    resume: bool = False,
    quick: bool = False,
    until: str | None = None,
    workers: int = 1,
    progress: Progress | bool | None = None,
    force: bool = False,
) -> Run:
    """Records and a study to posterior, bands, risk and report, as `bayeschute run` does.

    Args:
        study: From `Study.load`.
        folder: Of the run; made where missing.
        resume: Continue in the folder of an earlier run; stages whose inputs are unchanged are reused.
        quick: Small sizes, not for use.
        until: Last stage to run.
        workers: Local processes that predictions are spread over.
        progress: Called with stage, share done and words; True: shown in the terminal.
        force: Start again in the folder of an earlier run; its results are removed first.

    Raises:
        InputError: If `folder` contains something else, or an earlier run and neither `resume` nor `force` is given;
            if another run is under way in it.
        KeyboardInterrupt: If it is stopped; its note says how to go on.

    Example:
        >>> run = bc.run(study, folder / "until-priors", until="priors")
        >>> (run.folder / "priors.json").is_file()
        True
    """
    from bayeschute.study.assembly.assemble import smaller
    from bayeschute.study.run.stages import run_study

    with shown(progress) as tell:
        try:
            run_study(study.spec, folder, until, resume, quick, progress=tell, workers=workers, force=force)
        except KeyboardInterrupt as stop:
            same = "".join(f", {name}={value!r}" for name, value in _not_usual(quick, until, workers).items())
            stop.add_note(f"What is finished is kept: bc.run(study, {str(folder)!r}, resume=True{same}) goes on.")
            raise
    return Run(Path(folder), Study(smaller(study.spec)) if quick else study)


def _not_usual(quick: bool, until: str | None, workers: int) -> dict[str, Any]:
    """Options of a run that are not at their defaults."""
    return {
        k: v for k, v, usual in (("quick", quick, False), ("until", until, None), ("workers", workers, 1)) if v != usual
    }


@dataclass(frozen=True, eq=False, repr=False)
class Coverage:
    """Coverage of intervals and bands over replicates of a study.

    Attributes:
        found: As `bayeschute calibrate` stores it.

    Example:
        >>> found = {"replicates": 40, "coverage": {"axial[1]": 0.9}, "standard_error": {"axial[1]": 0.05}}
        >>> float(bc.Coverage(found).table.loc["axial[1]", "share"])
        0.9
    """

    found: Mapping[str, Any]

    @property
    def table(self) -> pd.DataFrame:
        """Coverage of nominal 90 % intervals over the replicates, with its standard error."""
        share, error = self.found["coverage"], self.found["standard_error"]
        return pd.DataFrame({"share": share, "standard_error": error})

    @property
    def replicates(self) -> int:
        """How many replicates counted."""
        return int(self.found["replicates"])

    def __repr__(self) -> str:
        """The shares."""
        return f"Coverage of 90 % intervals over {self.replicates} replicates\n{self.table}"

    def _repr_html_(self) -> str:
        """The shares as a table."""
        rows = [(n, f"{r.share:.3f}", f"{r.standard_error:.3f}") for n, r in self.table.iterrows()]
        return html.table(f"Coverage over {self.replicates} replicates", ("interval", "share", "standard error"), rows)


def calibrate(
    study: Study,
    folder: Path | str,
    replicates: int = 100,
    *,
    scenario: str = "none",
    noise: str | None = None,
    workers: int = 1,
    quick: bool = False,
    progress: Progress | bool | None = None,
) -> Coverage:
    """Measure the coverage of intervals and bands over replicates of a study's virtual flights.

    Args:
        study: All flights virtual.
        folder: Stores finished replicates; the same call continues a stopped one.
        replicates: Number of replicates to simulate, identify and predict.
        scenario: Misspecification of the simulated flights; ``none`` or a name of `scenarios`.
        noise: Replaces the noise model.
        workers: Local processes.
        quick: Small sizes, not for use.
        progress: Progress bars if True, or a function called with a name, the share done and words.

    Raises:
        InputError: If study or arguments are invalid, or `folder` contains replicates of another campaign.

    Example:
        >>> coverage = bc.calibrate(bc.Study.load("mine.toml"), "runs/mine", replicates=40)  # doctest: +SKIP
    """
    from bayeschute.study.calibrate import calibrate as fly_replicates

    with shown(progress) as tell:
        say = None if tell is None else partial(tell, "calibrate")
        return Coverage(
            fly_replicates(study.spec, folder, replicates, scenario, noise, workers, None, quick, progress=say)
        )


def simulate_study(
    study: Study,
    folder: Path | str,
    draws: int = 1,
    *,
    seed: int | None = None,
    workers: int = 1,
    progress: Progress | bool | None = None,
) -> Drops:
    """Fly the virtual flights of a study, and store their records and true motion.

    Args:
        study: At least one flight virtual.
        folder: Where to; a flight's files are ``<flight>.nc`` and ``<flight>.truth.nc``, numbered where `draws` > 1.
        draws: Drops of each flight, each with its own seed; those that the folder has already are kept.
        seed: Replaces the study's.
        workers: Local processes; 1: this one.
        progress: Progress bars if True, or a function called with a name, the share done and words.

    Returns:
        The files, and the outcome of every drop; a drop that fails is counted and leaves no files.

    Raises:
        InputError: If the study has no virtual flight, or no drop stays finite.

    Example:
        >>> drops = bc.simulate_study(bc.Study.example(), "drops", draws=100, workers=2)  # doctest: +SKIP
    """
    from bayeschute.study.run.simulate import simulate_study as fly

    with shown(progress) as tell:
        return fly(study.spec, folder, draws, seed, tell, workers)


def scenarios() -> dict[str, str]:
    """Misspecification scenarios of `calibrate`, by name, with a description.

    Example:
        >>> "strong-gusts" in bc.scenarios()
        True
    """
    from bayeschute.study.evidence.scenarios import SCENARIOS

    return {name: kind.says for name, kind in SCENARIOS.items()}


def numpyro_model(source: Fit | Posterior) -> Callable[[], None]:
    """The marginal posterior as a numpyro model with a site per parameter, for `numpyro.infer`.

    Args:
        source: A fit or a posterior of one set of flights.

    Raises:
        InputError: If several sets of flights were fitted apart.

    Example:
        >>> model = bc.numpyro_model(fitted)
        >>> callable(model)
        True
    """
    from bayeschute.posterior.numpyro_model import model

    if isinstance(source, Fit):
        pairs = [(one.found.marginal, one.group.priors) for one in source.groups]
    else:
        pairs = list(source.marginals)
    if len(pairs) != 1:
        raise InputError(Fault("numpyro_model", f"{len(pairs)} fits", "one set of flights that share their parameters"))
    return model(*pairs[0])
