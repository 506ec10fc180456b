"""Knowledge of a study: what it says of the parameters, and how it enters priors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.study.aerodynamics.knowledge_tables import NAMES, TRUTH, curve, table, told

from bayeschute.aero.coefficient import terms_of
from bayeschute.study.aerodynamics.known import informed, observed, points


def test_terms_are_found_among_parameters():
    assert terms_of(["riser_length", "transverse[e]", "axial[1]", "axial[1]@a.canopy1", "sd(axial[1])"]) == (
        ["1"], ["e"], [2, 1],
    )  # fmt: skip


def test_a_curve_of_the_truth_is_met_exactly_by_the_truth(study):
    alpha = [0.1, 0.3, 0.5]
    for target, values in (
        ("C_A", 0.85 - 0.5 * np.square(alpha)),
        ("C_N", 0.2 * np.sin(alpha)),
        ("C_N_rate", -0.4 * np.cos(alpha)),
    ):
        known = observed(study, curve(target, [(a, float(v), 0.01) for a, v in zip(alpha, values, strict=True)]), NAMES)
        np.testing.assert_allclose(known.design @ TRUTH, known.values, atol=1e-12)
        assert not known.design[:, 4].any()


def test_an_error_that_all_points_share_is_in_all_covariances(study):
    made = points(study, curve("C_A", [(0.1, 0.8, 0.01), (0.2, 0.8, 0.02)], common_sd=0.05))
    np.testing.assert_allclose(made.covariance, [[0.0026, 0.0025], [0.0025, 0.0029]])


def test_a_coefficient_multiplies_its_prior_and_moves_those_that_hang_together_with_it(study, priors):
    known = told(study, table(kind="coefficient", target="axial[1]", mean=0.9, sd=0.02, use="prior"))
    made = informed(known, priors)
    weight = 0.1**2 / (0.1**2 + 0.02**2)
    assert made[0].centre == pytest.approx(0.85 + weight * 0.05)
    assert made[0].scale == pytest.approx(0.1 * np.sqrt(1.0 - weight))
    assert made[1].centre == pytest.approx(-0.5 - 0.03 / (0.1**2 + 0.02**2) * 0.05)
    assert "and k (tunnel)" in made[0].source and made[3] == replace(priors[3])


def test_what_is_only_compared_leaves_priors_as_they_are(study, priors):
    assert informed(told(study, curve("C_A", [(0.1, 0.5, 0.01)])), priors) == priors


def test_a_term_that_the_model_lacks_moves_no_prior(study, priors):
    known = told(study, table(kind="coefficient", target="axial[alpha^4]", mean=1.0, sd=0.1, use="prior"))
    assert informed(known, priors) == priors
