"""Identity (hash) of a configuration and of a campaign, and the calibrations stored for it; free of JAX."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from bayeschute.study.evidence.numerics_compared import present_numerics
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.evidence.shipped import shipped
from bayeschute.study.job import Job
from bayeschute.study.study import Study, canonical, study_hash

STORED = Path("reference", "calibration")
"""Where a folder of models, or the package, keeps results of `calibrate`."""


def configuration(study: Study, quick: bool = False) -> str:
    """Hash of how a study identifies: model, vehicle, structure, priors, noise, sampler, sizes; not its flights.

    The program is no part of it: see `numerics_hash.numerics`.
    """
    said = canonical(replace(study, flights=()))
    told = {key: said[key] for key in ("model", "vehicle", "structure", "priors", "noise", "sampler", "predict")}
    known = [table for table in said.get("knowledge", ()) if table["use"] == "prior"]
    told |= {"knowledge": known} if known else {}
    text = json.dumps([told, quick], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def with_noise(study: Study, model: str) -> Study:
    """The study with another noise model."""
    return replace(study, noise=study.noise.model_copy(update={"model": model}))


def identity(study: Study, disturbance: str, quick: bool) -> str:
    """Hash of all that a row depends on except its seed."""
    text = f"{study_hash(replace(study, seed=0))}:{disturbance}:{quick}:{numerics()}"
    return hashlib.sha256(text.encode()).hexdigest()


class Stored(NamedTuple):
    """Stored calibrations of a configuration.

    Attributes:
        current: Made by the numerics in use, or by such as give the same results (`numerics_compared`), by scenario; of
            several the one with most replicates.
        older: Made by other numerics, or by versions that did not state them, by scenario.
    """

    current: Mapping[str, dict[str, Any]]
    older: Mapping[str, dict[str, Any]]


def stored(study: Study, quick: bool, places: Sequence[Path]) -> Stored:
    """The calibrations of a study's configuration.

    Results without a hash of their numerics have a configuration's hash that contained the version; they are older
    ones of this configuration if the study's title and the noise model are the same, wherever its file lies.

    Args:
        study: The study.
        quick: Whether sizes are cut.
        places: Folders with results of `calibrate`.
    """
    wanted = configuration(study, quick)
    now = present_numerics(wanted)
    current: dict[str, dict[str, Any]] = {}
    older: dict[str, dict[str, Any]] = {}
    for file in sorted(f for place in places if place.is_dir() for f in place.glob("*.json")):
        try:
            result = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue  # not a result: folders of users hold other files
        if not isinstance(result, dict) or not {"hash", "disturbance", "replicates", "coverage"} <= set(result):
            continue
        named = (result.get("title"), result.get("noise"), bool(result.get("quick")))
        same = "numerics" not in result and named == (study.title, study.noise.model, quick)
        if result["hash"] != wanted and not same:
            continue
        found, scenario = current if result.get("numerics") in now else older, str(result["disturbance"])
        if scenario not in found or int(result["replicates"]) > int(found[scenario]["replicates"]):
            found[scenario] = result
    return Stored(current, older)


def places(job: Job) -> list[Path]:
    """Folders that may contain calibrations: the run's, the one next to the study's folder, and the package's."""
    beside = job.study.path.resolve().parent.parent / STORED
    return list(dict.fromkeys([job.out / "calibration", beside, shipped(STORED)]))
