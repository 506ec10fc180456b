"""Rank tests of a study's inference: truths from prior or posterior, records from the model itself, ranks of truths.

`calibrate` asks whether intervals hold the truth of flights that the simulator makes; a rank test asks whether the
inference is right where its own assumptions hold (simulation-based calibration, `calibration.simulation_based`). It
uses the study's first fitted flight, with the terms that it flies.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from bayeschute.calibration import simulation_based as sbc
from bayeschute.calibration.campaign import run
from bayeschute.calibration.rank_tables import summarise_ranks
from bayeschute.core.errors import Fault, InputError
from bayeschute.prediction.bands import quantities_of_states
from bayeschute.study.assembly import assemble
from bayeschute.study.assembly.fits import data_of, groups
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.evidence.provenance import provenance
from bayeschute.study.job import Job, write_json
from bayeschute.study.load import load_study
from bayeschute.study.run import stage_list
from bayeschute.study.study import Study, study_hash

FIRST_SEED = 50_000
LEVELS = 99
"""Ranks go from 0 to this."""
SHIFT = 0.3
"""Posterior standard deviations by which draws are moved that must fail the test."""
TRUTHS = ("posterior", "prior")


def with_flown_terms(study: Study) -> Study:
    """The study with its first fitted flight only, identified with the terms that it flies."""
    assert study.structure is not None and study.vehicle is not None
    names = list(study.vehicle.aero.coefficients())
    terms = {
        kind: tuple(name[len(kind) + 1 : -1] for name in names if name.startswith(f"{kind}["))
        for kind in ("axial", "transverse")
    }
    table = study.structure.model_copy(update={**terms, "core": tuple(names), "fit": "pool"})
    flight = replace(study.with_role("identify")[0], roles=("structure", "identify"))
    return replace(study, structure=table, flights=(flight,), requirements=())


@dataclass(frozen=True)
class Tested:
    """A study under test, the same as any other of its hash."""

    hash: str
    study: Study = field(compare=False)


@lru_cache(maxsize=2)
def template(of: Tested) -> sbc.Template:
    """The settings that all replicates of a study share; made once a process."""
    study = with_flown_terms(of.study)
    with tempfile.TemporaryDirectory(prefix="bayeschute-") as folder:
        job = Job(study, Path(folder), False, "", lambda *_: None)
        for stage in (stage_list.ingest, stage_list.structure, stage_list.priors):
            stage(job)
        (group,) = groups(job)
        flight = data_of(job, group.flights[0], group.priors)

    def quantities(data: Any, x: np.ndarray) -> dict[str, np.ndarray]:
        seen = quantities_of_states(data, x)
        return sbc.swing_quantities(seen["swing_angle"], seen["descent_rate"], float(data.dt))

    return sbc.Template(flight, group.priors, assemble.noise_prior(study), quantities)


@lru_cache(maxsize=2)
def believed(of: Tested) -> sbc.Believed:
    """The posterior of the study's own record, fitted once a process; the same in every process."""
    return sbc.believe(template(of), FIRST_SEED - 1)


def one(seed: int, of: Tested, truths: str) -> dict[str, Any]:
    """A row; a replicate that fails is counted."""
    try:
        start = believed(of) if truths == "posterior" else None
        return {"seed": seed, **sbc.ranked(seed, template(of), LEVELS, shift=SHIFT, believed=start)}
    except (FloatingPointError, np.linalg.LinAlgError) as error:
        return {"seed": seed, "ok": False, "error": f"{type(error).__name__}: {error}"[:500]}


def rank_tests(
    study: Study | Path | str,
    out: Path | str,
    replicates: int = 100,
    truths: str = "posterior",
    workers: int = 1,
    address: str | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> dict[str, Any]:
    """Rank tests of a study's inference (simulation-based calibration).

    Finished replicates are kept; called again with the same arguments, only those that are missing are made.

    Args:
        study: A cluster study whose fitted flights are virtual, or its file.
        out: Folder for rows and the result.
        replicates: How many.
        truths: ``posterior``: drawn from the posterior of the study's own record, which is fitted together with each
            replicate's (for priors far wider than the region of the record); ``prior``: from the priors.
        workers: Local processes.
        address: Of a Dask scheduler, in place of local processes.
        progress: Called with the share done and words.

    Returns:
        The result, as written to ``ranks.<truths>.json``: see `calibration.rank_tables.summarise_ranks`, and study,
        hash of the numerics, command, commit, date, machine and versions.

    Raises:
        InputError: If study or arguments are invalid, or `out` contains rows of another campaign.
    """
    study = study if isinstance(study, Study) else load_study(study)
    _sound(study, truths, replicates)
    of = Tested(study_hash(study), study)
    what = json.dumps([of.hash, truths, LEVELS, SHIFT, numerics()])
    rows = run(
        partial(one, of=of, truths=truths),
        range(FIRST_SEED, FIRST_SEED + replicates),
        Path(out) / f"ranks.{truths}.rows",
        hashlib.sha256(what.encode()).hexdigest(),
        workers,
        address,
        progress,
    )
    command = f"bayeschute calibrate {study.path.name} --ranks {truths} --replicates {replicates}"
    result = {
        "study": study.path.stem, "noise": study.noise.model, "truths": truths,
        **summarise_ranks(rows, LEVELS, SHIFT), **provenance(command),
    }  # fmt: skip
    write_json(Path(out) / f"ranks.{truths}.json", result)
    return result


def _sound(study: Study, truths: str, replicates: int) -> None:
    faults = []
    if study.model != "cluster" or any(f.virtual is None for f in study.with_role("identify")):
        wanted = "a cluster study whose fitted flights are virtual"
        got = "recorded flights that are fitted" if study.model == "cluster" else f"a {study.model} study"
        faults.append(Fault(str(study.path), got, wanted, "True values are known of virtual flights only."))
    if study.priors.hierarchical:
        faults.append(Fault("[priors] vary", "a hierarchical model", "parameters that all canopies and drops share"))
    if study.noise.model == "sandwich":
        faults.append(Fault("[noise] model", "'sandwich', which is no posterior", "latent, ar1, ar1+white or white"))
    if truths not in TRUTHS:
        faults.append(Fault("truths", repr(truths), f"one of {', '.join(TRUTHS)}"))
    if replicates < 2:
        faults.append(Fault("replicates", str(replicates), "at least 2"))
    if faults:
        raise InputError(faults)
