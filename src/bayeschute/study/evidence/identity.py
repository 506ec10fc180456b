"""Identity (hash) of a configuration and of a campaign, and the calibrations stored for it; free of JAX."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

from bayeschute.core.version import __version__
from bayeschute.study.job import Job
from bayeschute.study.study import Study, canonical, study_hash

STORED = Path("reference", "calibration")
"""Where a folder of models, or the package, keeps results of `calibrate`."""


def configuration(study: Study, quick: bool = False) -> str:
    """Hash of how a study identifies: model, vehicle, structure, priors, noise, sampler, program; not its flights."""
    said = canonical(study)
    told = {key: said[key] for key in ("model", "vehicle", "structure", "priors", "noise", "sampler", "predict")}
    known = [table for table in said.get("knowledge", ()) if table["use"] == "prior"]
    told |= {"knowledge": known} if known else {}
    text = json.dumps([told, __version__, quick], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def with_noise(study: Study, model: str) -> Study:
    """The study with another noise model."""
    return replace(study, noise=study.noise.model_copy(update={"model": model}))


def identity(study: Study, disturbance: str, quick: bool) -> str:
    """Hash of all that a row depends on except its seed."""
    text = f"{study_hash(replace(study, seed=0))}:{disturbance}:{quick}:{__version__}"
    return hashlib.sha256(text.encode()).hexdigest()


def stored(study: Study, quick: bool, places: Sequence[Path]) -> dict[str, Any] | None:
    """The calibration of a study's configuration with most replicates, flights undisturbed; None if none is stored.

    Args:
        study: The study.
        quick: Whether sizes are cut.
        places: Folders with results of `calibrate`.
    """
    wanted, found = configuration(study, quick), []
    for file in sorted(f for place in places if place.is_dir() for f in place.glob("*.json")):
        try:
            result = json.loads(file.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            continue  # not a result: folders of users hold other files
        if isinstance(result, dict) and result.get("hash") == wanted and result.get("disturbance") == "none":
            found.append(result)
    return max(found, key=lambda r: int(r["replicates"]), default=None)


def shipped() -> Path:
    """Folder of the calibrations that come with the program.

    Data of the package where it is installed; in a checkout, and so in an editable install, ``models/reference``.
    """
    package = Path(str(resources.files("bayeschute")))
    installed = package / STORED
    return installed if installed.is_dir() else package.parents[1] / "models" / STORED


def places(job: Job) -> list[Path]:
    """Folders that may contain calibrations: the run's, the one next to the study's folder, and the package's."""
    beside = job.study.path.resolve().parent.parent / STORED
    return list(dict.fromkeys([job.out / "calibration", beside, shipped()]))
