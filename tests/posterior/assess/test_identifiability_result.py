"""What determines a parameter, in words, from its contraction, shift and sensitivities."""

from __future__ import annotations

import pytest

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
    ParameterIdentifiability,
    diagnosis,
)

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
