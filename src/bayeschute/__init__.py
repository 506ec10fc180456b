"""bayeschute: Bayesian system identification of capsules under parachutes from flight records.

``import bayeschute as bc`` gives the classes `Study`, `Flight`, `Structure`, `Priors`, `Fit`, `Posterior`, `Forecast`,
`Landings`, `Run` and `Coverage`, and the functions `read_record`, `reconstruct`, `select_structure`, `fit`, `sample`,
`run`, `calibrate` and others. Names are imported when they are first used, so that the import itself is quick.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bayeschute.core.version import __version__

if TYPE_CHECKING:
    from bayeschute.api.beliefs import Priors, Structure
    from bayeschute.api.fitted import Fit
    from bayeschute.api.flight import Flight, Flights, wind_profile
    from bayeschute.api.forecast import Forecast, Probability
    from bayeschute.api.inputs import Study, noise
    from bayeschute.api.landing.landing_winds import wind_climatology
    from bayeschute.api.landing.landings import Landings
    from bayeschute.api.posterior import Posterior
    from bayeschute.api.run_folder import Run
    from bayeschute.api.verbs import (
        Coverage,
        calibrate,
        fit,
        numpyro_model,
        read_record,
        reconstruct,
        run,
        sample,
        scenarios,
        select_structure,
        simulate_study,
    )
    from bayeschute.api.views.curve import Curve
    from bayeschute.api.views.flight_motion import Motion
    from bayeschute.api.views.plausibility import Plausibility
    from bayeschute.api.views.rank_test import RankTest, rank_test
    from bayeschute.calibration.label import Claim
    from bayeschute.core.errors import Fault, FitError, InputError
    from bayeschute.likelihood.priors import Prior
    from bayeschute.study.load import check_study, load_vehicle
    from bayeschute.study.swing_modes import find_modes
    from bayeschute.study.templates import copy_templates
    from bayeschute.verification.all_cases import verify

_PLACES = {
    "api.beliefs": ("Priors", "Structure"),
    "api.views.curve": ("Curve",),
    "api.views.flight_motion": ("Motion",),
    "api.flight": ("Flight", "Flights", "wind_profile"),
    "api.inputs": ("Study", "noise"),
    "api.fitted": ("Fit",),
    "api.landing.landing_winds": ("wind_climatology",),
    "api.landing.landings": ("Landings",),
    "api.forecast": ("Forecast", "Probability"),
    "api.posterior": ("Posterior",),
    "api.run_folder": ("Run",),
    "api.views.plausibility": ("Plausibility",),
    "api.views.rank_test": ("RankTest", "rank_test"),
    "api.verbs": (
        "Coverage", "calibrate", "fit", "numpyro_model", "read_record", "reconstruct", "run", "sample", "scenarios",
        "select_structure", "simulate_study",
    ),
    "calibration.label": ("Claim",),
    "core.errors": ("Fault", "FitError", "InputError"),
    "likelihood.priors": ("Prior",),
    "study.load": ("check_study", "load_vehicle"),
    "study.swing_modes": ("find_modes",),
    "study.templates": ("copy_templates",),
    "verification.all_cases": ("verify",),
}  # fmt: skip
_PLACE = {name: module for module, names in _PLACES.items() for name in names}

__all__ = [
    "__version__",
    "Claim",
    "Coverage",
    "Curve",
    "Fault",
    "Fit",
    "FitError",
    "Flight",
    "Flights",
    "Forecast",
    "InputError",
    "Landings",
    "Motion",
    "Plausibility",
    "Posterior",
    "Prior",
    "Priors",
    "Probability",
    "RankTest",
    "Run",
    "Structure",
    "Study",
    "calibrate",
    "check_study",
    "copy_templates",
    "find_modes",
    "fit",
    "load_vehicle",
    "noise",
    "numpyro_model",
    "rank_test",
    "read_record",
    "reconstruct",
    "run",
    "sample",
    "scenarios",
    "select_structure",
    "simulate_study",
    "verify",
    "wind_climatology",
    "wind_profile",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACE:
        raise AttributeError(f"module 'bayeschute' has no attribute {name!r}")
    value = getattr(import_module(f"bayeschute.{_PLACE[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
