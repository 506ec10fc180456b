"""Fits and draws of flights in memory: what `fit`, `sample` and `Posterior.update` share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from bayeschute.api.beliefs import Priors
from bayeschute.api.flight import Flight
from bayeschute.api.inputs import Study
from bayeschute.api.workspace import Files, collected, workspace
from bayeschute.core.errors import Fault, InputError
from bayeschute.study.job import Job, Progress
from bayeschute.study.schema.belief_schema import NoiseTable
from bayeschute.study.schema.schema_faults import validated
from bayeschute.study.study import Study as StudySpec

if TYPE_CHECKING:
    from bayeschute.study.run.stage_fit import Fitted

T = TypeVar("T")


@contextmanager
def shown(progress: Progress | bool | None) -> Iterator[Progress | None]:
    """Progress callback: a function, or progress bars in the terminal if True."""
    if progress is True:
        from bayeschute.console import Bars

        with Bars() as bars:
            yield bars
    else:
        yield progress or None


def chosen(flights: Study | Flight | Sequence[Flight]) -> list[Flight]:
    """Flights to be fitted: those of a study that have a part in its fit, or those given."""
    if isinstance(flights, Study):
        return [f for f in flights.flights if {"identify", "structure"} & set(f.roles)]
    return [flights] if isinstance(flights, Flight) else list(flights)


def spec_of(flights: Sequence[Flight], roles: tuple[str, ...]) -> StudySpec:
    """The study of some flights: tables of the first's, each flight with the vehicle that flew it."""
    if not flights:
        raise InputError(Fault("flights", "none", "at least one flight"))
    study = flights[0].study
    names = [flight.name for flight in flights]
    if len(set(names)) < len(names):
        raise InputError(Fault("flights", ", ".join(names), "flights of different names", "Use `Flight.changed`."))
    vehicle = flights[0].vehicle
    specs = tuple(
        replace(
            flight.spec,
            roles=tuple(role for role in flight.roles if role in roles) or roles,
            vehicle=None if flight.vehicle == vehicle else flight.vehicle,
        )
        for flight in flights
    )
    return replace(study, flights=specs, vehicle=vehicle, requirements=())


def ingest(job: Job, flights: Sequence[Flight]) -> None:
    """Records of flights, ready to be used."""
    from bayeschute.study.run.stage_data import ingest_flight, read_and_judge

    for spec, flight in zip(job.study.flights, flights, strict=True):
        ingest_flight(job, spec, read_and_judge(job, spec, flight.raw))


def fitted_flights(
    flights: Sequence[Flight],
    priors: Priors | None,
    noise: NoiseTable | None,
    seed: int | None,
    progress: Progress | bool | None,
) -> tuple[StudySpec, tuple[Fitted, ...], Files]:
    """Fit flights; see `verbs.fit`.

    Returns:
        The study that was fitted, its fits, and the files that say what they are made of.
    """
    from bayeschute.study.assembly.fits import groups
    from bayeschute.study.run import stage_data, stage_fit, stage_structure

    spec = spec_of(flights, ("structure", "identify"))
    if priors is not None:
        known = tuple(k for k in spec.knowledge if k.use == "compare")
        known += tuple(k for k in priors.known if k.name not in [other.name for other in known])
        spec = replace(spec, priors=priors.table, structure=priors.candidates or spec.structure, knowledge=known)
    if noise is None:  # a flight without a study tells its own
        noise = spec.noise if spec.text else flights[0].usual_noise()
    spec = replace(spec, noise=noise, seed=spec.seed if seed is None else seed)
    with shown(progress) as tell, workspace(spec, progress=tell) as job:
        ingest(job, flights)
        if priors is None:
            stage_structure.structure(job)
            stage_data.priors(job)
        else:
            job.save("structure.json", priors.found or {"coefficients": {}})
            job.save("priors.json", [p.__dict__ for p in stage_data.in_order(spec, priors.parameters)])
        stage_fit.fit_structures(job)
        made = tuple(stage_fit.fit_group(job, group, job.say("fit")) for group in groups(job))
        return spec, made, collected(job.out)


def sampling(
    spec: StudySpec, draws: int | None, chains: int | None, warmup: int | None, seed: int | None, sampler: str | None
) -> StudySpec:
    """A study with other sizes of its sampler; see `verbs.sample`.

    Raises:
        InputError: If a size is out of range; draws are counted by chain.
    """
    table = spec.sampler
    count = chains or table.chains
    asked = {
        "chains": chains,
        "warmup": warmup,
        "kind": sampler,
        "draws": None if draws is None else -(-draws // count),
    }
    sizes = table.model_dump() | {k: v for k, v in asked.items() if v is not None}
    table = validated(type(table), "sample", sizes)
    return replace(spec, sampler=table, seed=spec.seed if seed is None else seed)


def drawn(
    spec: StudySpec,
    made: Sequence[Fitted],
    files: Files,
    progress: Progress | bool | None,
    read: Callable[[Path, StudySpec], T],
) -> T:
    """Draw from the posterior of fits, and check fits and draws.

    Args:
        spec: The study that was fitted, with the sampler's sizes.
        made: Its fits.
        files: What they are made of.
        progress: As of `verbs.sample`.
        read: Makes a posterior of the folder and the study.
    """
    from bayeschute.study.run import stage_check, stage_fit

    with shown(progress) as tell, workspace(spec, files, tell) as job:
        draws = [stage_fit.draw_group(job, one, job.say("fit")) for one in made]
        stage_fit.store(job, made, draws)
        stage_check.check(job)
        return read(job.out, spec)
