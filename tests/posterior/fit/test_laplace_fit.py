"""Noise parameters between a mode and the next: by logarithms, with the density of their log-normal priors."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from bayeschute.likelihood.joint import NoiseParameters
from bayeschute.likelihood.noise import Noise
from bayeschute.posterior.fit import laplace_fit as module
from bayeschute.posterior.fit.joint_fit import JointFit
from bayeschute.posterior.noise_evidence import NoisePrior, to_vector


def noise(factor=1.0, wind=1.0):
    levels = Noise(*(factor * np.array([x]) for x in (0.05, 0.1, 2.0)))
    return NoiseParameters(levels, (wind * np.array([0.4, 12.0]),))


def test_a_share_of_the_way_is_a_share_of_every_factor():
    begin, end = noise(), noise(16.0, 81.0)
    place = JointFit("optimum", begin, np.nan)
    asked = []
    found = module._part_of_the_way(lambda vector: asked.append(vector) or (7.5, None), place, end, 0.25)
    np.testing.assert_allclose(to_vector(found.hyper), to_vector(noise(2.0, 3.0)))
    assert (found.optimum, found.evidence) == ("optimum", 7.5)
    np.testing.assert_allclose(asked[0], to_vector(found.hyper))
    whole = module._part_of_the_way(lambda vector: (0.0, None), place, end, 1.0)
    np.testing.assert_allclose(to_vector(whole.hyper), to_vector(end))


def test_the_prior_of_noise_is_the_log_normal_of_its_medians():
    prior = NoisePrior(noise(), 0.4)
    law = stats.norm(0.0, 0.4)
    for one in (noise(1.3), noise(0.7, 2.0)):
        away = to_vector(one) - to_vector(noise())
        want = -(law.logpdf(away) - law.logpdf(0.0)).sum()
        assert module._prior_of_noise(one, prior) == pytest.approx(want)
    assert module._prior_of_noise(noise(), prior) == 0.0


@pytest.mark.parametrize(("is_mode", "kept"), [(True, "corrected"), (False, "made")])
def test_corrections_under_which_there_is_no_mode_are_not_taken(monkeypatch, is_mode, kept):
    fit = SimpleNamespace(marginal="corrected", shift=0.1, before=0.7)
    seen = SimpleNamespace(is_mode=is_mode)
    monkeypatch.setattr(module.correction_fit, "fitted", lambda made, rng, say: fit)
    monkeypatch.setattr(module, "expansion_of", lambda made: SimpleNamespace(step=lambda: np.zeros(1)))
    monkeypatch.setattr(module, "best_profile", lambda made, step: seen)
    made, profile, shift = module._over_the_posterior("made", "before", lambda *_: None)
    assert made == kept and profile is (seen if is_mode else "before") and shift == (0.1 if is_mode else 0.7)


def test_noise_weaker_than_its_priors_have_it_may_be_raised_on_the_way_there():
    """By logarithms, standard deviations alone, and only those that are weaker."""
    prior = NoisePrior(noise(), 0.7)
    weak = NoiseParameters(Noise(np.array([0.05 / 4.0]), np.array([0.3]), np.array([9.0])), (np.array([0.1, 3.0]),))
    louder = module._louder(weak, prior)
    assert [round(float(one.hyper.noise.white[0]), 6) for one in louder] == [0.025, 0.035355, 0.05]
    for one in louder:
        assert one.hyper.noise.correlated == 0.3 and one.hyper.noise.time_constant == 9.0
        assert one.hyper.disturbance_parameters[0][1] == 3.0 and len(one.lost) == 1
    np.testing.assert_allclose([one.hyper.disturbance_parameters[0][0] for one in louder], [0.2, 0.4 / 2**0.5, 0.4])
    assert "50% of the way" in louder[0].words and "wider than the record asks for" in louder[0].lost[0]


@pytest.mark.parametrize(("factor", "count"), [(0.5, 3), (0.65, 3), (0.7, 0), (1.0, 0), (2.0, 0)])
def test_noise_that_is_hardly_weaker_is_left(factor, count):
    assert len(module._louder(noise(factor, factor), NoisePrior(noise(), 0.7))) == count
