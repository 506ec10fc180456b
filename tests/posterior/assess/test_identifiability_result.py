"""What an analysis found: its words, and itself through JSON and back: nothing is lost, damage is refused."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import FrozenInstanceError, fields, replace

import pytest

from bayeschute.core.errors import InputError
from bayeschute.core.plain import from_plain, to_plain
from bayeschute.posterior.assess.identifiability_result import (
    AGREE,
    CONFLICT,
    FELT,
    INFORMED,
    INSENSITIVE,
    MAY_CONFLICT,
    PRIOR_ONLY,
    SENSITIVE,
    UNINFORMED,
    UNTOLD,
    Direction,
    FitIdentifiability,
    LikelihoodInterval,
    NoiseCorrelations,
    ParameterIdentifiability,
    diagnosis,
)

WHOLE = FitIdentifiability(
    {
        "axial[1]": ParameterIdentifiability(
            0.8, 0.5, 0.02, "wind, sd", -0.3, 0.01, 0.2, INSENSITIVE, LikelihoodInterval(0.9, "1", 0.7, None)
        ),
        "mass": ParameterIdentifiability(shift=-1.25, prior_sensitivity=0.4),
    },
    (Direction({"axial[1]": 0.6, "mass": -0.8}, 12.0, 12.0 / 13.0, "0.6 axial[1] - 0.8 mass"),),
    {"wind, sd": 0.8, "wind, time constant": None},
    NoiseCorrelations(("wind, sd", "wind, time constant"), {"axial[1]": (-0.3, 0.1), "mass": (None, 0.0)}),
)


def through_json(found, *, without_none):
    return from_plain(type(found), json.loads(json.dumps(to_plain(found, without_none=without_none))), "stored")


@pytest.mark.parametrize("without_none", [False, True])
def test_nothing_is_lost_in_a_file(without_none):
    """As a run stores it, without what is unknown, or with it."""
    assert through_json(WHOLE, without_none=without_none) == WHOLE
    assert through_json(FitIdentifiability({}), without_none=without_none) == FitIdentifiability({})


def test_a_direction_may_be_of_unknown_information():
    """As from draws that are no numbers: null in the file."""
    found = replace(WHOLE, directions=(Direction({"mass": 1.0}, None, None, "mass"),))
    assert through_json(found, without_none=False) == found


def test_what_a_file_does_not_tell_is_not_known():
    """A sandwich has no confounding; a fit whose prior does not matter, no profile likelihood."""
    found = from_plain(FitIdentifiability, {"parameters": {"a": {"shift": 0.5}}}, "stored")
    assert found.directions == () and found.noise == {} and found.confounding is None
    assert [getattr(found.parameters["a"], f.name) for f in fields(ParameterIdentifiability)] == [
        None,
        0.5,
        *[None] * 7,
    ]
    unknown = ParameterIdentifiability(*[None] * len(fields(ParameterIdentifiability)))
    assert from_plain(ParameterIdentifiability, {}, "stored") == unknown


def test_an_interval_without_an_end_is_open_there():
    """Nothing but its level must be told; it is then of a number without a unit."""
    assert from_plain(LikelihoodInterval, {"level": 0.9}, "x") == LikelihoodInterval(0.9, "1", None, None)
    assert from_plain(LikelihoodInterval, {"level": 0.9, "high": 3}, "x").high == 3.0
    assert from_plain(LikelihoodInterval, {"level": 0.9, "unit": "kg", "low": 1.0}, "x") == LikelihoodInterval(0.9, "kg", 1.0)  # fmt: skip


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"parameters": [1.0]}, "stored.parameters"),
        ({"parameters": {"a": {"shift": "far"}}}, r"stored.parameters.a.shift"),
        ({"parameters": {"a": {"sway": 1.0}}}, "stored.parameters.a"),
        ({"directions": [{"weights": {"a": 1.0}, "information": 1.0}]}, r"stored.directions\[0\]"),
        ({"directions": [{"weights": {"a": None}, "information": 1.0, "contraction": 0.5, "words": "a"}]}, "weights.a"),
        ({"noise": {"wind, sd": "much"}}, "stored.noise.wind, sd"),
        ({"confounding": {"noise": ["n"], "correlation": {"a": 0.5}}}, "stored.confounding.correlation.a"),
        ({"parameters": {"a": {"likelihood_interval": {"low": 1.0}}}}, "likelihood_interval"),
    ],
)
def test_what_is_of_another_form_is_refused_by_its_place(change, where):
    stored = to_plain(WHOLE) | change
    with pytest.raises(InputError, match=where):
        from_plain(FitIdentifiability, json.loads(json.dumps(stored)), "stored")


def test_results_of_two_fits_share_nothing():
    one, other = FitIdentifiability({}), FitIdentifiability({})
    assert one.noise is not other.noise and one == other != replace(one, noise={"sd": 0.1})


@pytest.mark.parametrize("one", [WHOLE, WHOLE.directions[0], WHOLE.parameters["mass"], WHOLE.confounding, LikelihoodInterval(0.5)])  # fmt: skip
def test_a_result_can_not_be_changed(one):
    with pytest.raises(FrozenInstanceError):
        setattr(one, fields(one)[0].name, None)


def test_reading_a_result_needs_no_jax():
    module = "bayeschute.posterior.assess.identifiability_result"
    script = f"import sys, {module}; print(sorted({{'jax', 'arviz_stats', 'xarray'}} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


BELOW, MOVED = 1.0 - 1e-9, CONFLICT


@pytest.mark.parametrize(
    ("contraction", "shift", "prior", "likelihood", "wanted"),
    [
        (0.9, 0.0, BELOW * SENSITIVE, 0.2, INSENSITIVE),
        (0.9, MOVED, BELOW * SENSITIVE, 0.2, INSENSITIVE),
        (0.9, 0.0, SENSITIVE, SENSITIVE, AGREE),
        (0.9, -BELOW * MOVED, 0.2, 0.2, AGREE),
        (0.9, -MOVED, SENSITIVE, SENSITIVE, MAY_CONFLICT),
        (None, MOVED, 0.2, 0.2, MAY_CONFLICT),
        (INFORMED, 0.0, SENSITIVE, BELOW * SENSITIVE, FELT),
        (INFORMED, 0.0, 0.2, None, FELT),
        (BELOW * INFORMED, 0.0, 0.2, 0.0, PRIOR_ONLY),
        (None, 0.0, 0.2, 0.0, PRIOR_ONLY),
        (UNINFORMED, 0.0, 0.2, 0.2, AGREE),
        (BELOW * UNINFORMED, 0.0, 0.2, 0.2, UNTOLD),
        (BELOW * UNINFORMED, None, 0.0, 0.0, UNTOLD),
        (-0.5, MOVED, 0.2, 0.2, MAY_CONFLICT),
        (0.9, 0.0, None, 0.2, None),
    ],
)
def test_words(contraction, shift, prior, likelihood, wanted):
    facts = ParameterIdentifiability(contraction, shift, prior_sensitivity=prior, likelihood_sensitivity=likelihood)
    assert diagnosis(facts) == wanted


@pytest.mark.parametrize(
    ("contraction", "shift", "prior", "likelihood", "wanted"),
    [
        (0.1, 0.0, 0.04, 0.2, "insensitive to the prior"),
        (0.099, 0.99, 0.04, 0.2, "the posterior is the prior"),
        (0.099, -0.99, 0.2, 0.2, "the posterior is the prior"),
        (0.099, 1.0, 0.049, 0.2, "insensitive to the prior"),
        (0.5, 0.0, 0.05, 0.049, "determined by the data, and the prior is felt"),
        (0.499, 0.0, 0.05, 0.049, "determined by the prior"),
        (0.5, 0.99, 0.05, 0.05, "prior and data both matter, and agree"),
        (0.5, 1.0, 0.05, 0.05, "possible conflict of prior and data"),
        (0.5, -1.0, 0.05, 0.05, "possible conflict of prior and data"),
    ],
)
def test_words_change_at_the_published_bounds(contraction, shift, prior, likelihood, wanted):
    """Sensitivities of 0.05, a contraction of a tenth and of a half, a shift of one standard deviation."""
    facts = ParameterIdentifiability(
        contraction, shift, prior_sensitivity=prior, likelihood_sensitivity=likelihood
    )  # fmt: skip
    assert diagnosis(facts) == wanted
