"""Draws of a posterior for landings: how many of which, with whose noise parameters, and in which units."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.likelihood.priors import Prior
from bayeschute.prediction.bands import GROUP
from bayeschute.study.landing_campaign import posterior_parameters as module
from bayeschute.study.landing_campaign.posterior_parameters import drawn_values, parameters_of


@dataclass(frozen=True)
class Base:
    axial: tuple = (9.0,)
    transverse: tuple = (9.0,)


@dataclass(frozen=True)
class Structure:
    canopies: int
    axial: tuple = ("1", "alpha^2")
    transverse: tuple = ("e",)


def job(model="cluster", hierarchical=False):
    vehicle = SimpleNamespace(canopies=SimpleNamespace(number=2))
    priors = SimpleNamespace(hierarchical=hierarchical)
    return SimpleNamespace(
        study=SimpleNamespace(model=model, priors=priors, seed=1, vehicle_of=lambda flight: (vehicle, flight))
    )


def some(names, theta):
    return SimpleNamespace(names=tuple(names), theta=np.array(theta, float))


def test_values_are_in_their_own_units_and_of_parameters_that_all_models_have():
    first = some(["axial[1]", "riser_stiffness", "", "riser_length"], [[0.8, 1.0, 5.0, 9.0], [0.9, 2.0, 6.0, 8.0]])
    second = some(["riser_stiffness", "axial[1]", ""], [[3.0, 0.7, 4.0]])
    made = drawn_values((first, second))
    assert list(made) == ["axial[1]", "riser_stiffness"]
    np.testing.assert_allclose(made["axial[1]"], [0.8, 0.9, 0.7])
    np.testing.assert_allclose(made["riser_stiffness"], np.exp([1.0, 2.0, 3.0]))
    assert list(drawn_values((first,))) == ["axial[1]", "riser_stiffness", "riser_length"]


def test_a_point_mass_has_no_landing():
    with pytest.raises(InputError, match="model 'descent'"):
        parameters_of(job("descent"), None, None, None)


@pytest.fixture
def asked(monkeypatch):
    """A posterior of 4 chains of 25 draws; what is asked of its models, and what `_of` is given for each."""
    seen = SimpleNamespace(members=[], of=[], populations=[], other=object())
    group, stored = object(), SimpleNamespace(held=np.zeros((4, 25, 3)))
    seen.group, seen.stored = group, stored
    monkeypatch.setattr(module, "groups", lambda job: [group, "another"])
    monkeypatch.setattr(module, "load_fit", lambda job, one: stored if one is group else ("fit of", one))

    def members(job, one, count):
        seen.members.append((one, count))
        return [(group, count - 10), (seen.other, 10)]

    def populations(*given):
        seen.populations.append(given)
        return [(group, stored, given[-1])]

    monkeypatch.setattr(module.structures, "members", members)
    monkeypatch.setattr(module, "by_members", populations)
    monkeypatch.setattr(module, "_of", lambda *given: seen.of.append(given) or given[-1])
    return seen


@pytest.mark.parametrize(("draws", "count"), [(None, 100), (40, 40), (100, 100), (500, 100)])
def test_all_draws_or_as_many_as_are_wanted_and_there(asked, draws, count):
    assert parameters_of(job(), "vehicle", 9.0, draws) == (count - 10, 10)
    assert asked.members == [(asked.group, count)] and not asked.populations
    assert asked.of[0][1:] == ("vehicle", 9.0, asked.group, asked.stored, count - 10)
    assert asked.of[1][3:5] == (asked.other, ("fit of", asked.other))  # a model that is mixed in has its own fit


def test_members_of_populations_are_new_ones(asked):
    assert parameters_of(job(hierarchical=True), None, None, 30) == (30,)
    assert asked.populations[0][1:] == (asked.group, asked.stored, False, 30) and not asked.members


@pytest.fixture
def stored(monkeypatch):
    """A fit of 2 chains of 50 draws, numbered; noise parameters are numbered too."""
    law = SimpleNamespace(disturbance_parameters=[np.zeros(2), np.zeros(3)])
    held = np.stack([np.arange(100.0).reshape(2, 50), np.zeros((2, 50)), np.ones((2, 50))], axis=-1)
    seen = SimpleNamespace(shared=[], assembled=[])

    def noise(hyper, covariance, shared, rng):
        seen.shared.append(shared)
        return [SimpleNamespace(disturbance_parameters=[[k, 1.0], [k, 2.0, 3.0]]) for k in range(shared)]

    monkeypatch.setattr(module.bands, "noise_parameter_draws", noise)
    monkeypatch.setattr(module.bands, "carried", lambda marginal, picked, hypers, effect: picked + 0.25)
    monkeypatch.setattr(module.assemble, "cluster", lambda *given: (seen.assembled.append(given), (Base(), None))[1])
    monkeypatch.setattr(module.assemble, "latent", lambda study, n: ("latent", n))
    monkeypatch.setattr(module, "structure_of", lambda priors, n: Structure(n))
    priors = tuple(Prior(n, 0.0, 1.0, False, "1", "") for n in ("axial[1]", "capsule_mass", "riser_length"))
    seen.fit = SimpleNamespace(held=held, hyper=law, noise_parameter_covariance=None, marginal=None, noise_effect=None)
    flight = SimpleNamespace(name="f")
    seen.group = SimpleNamespace(name="g", flights=[flight, "another"], priors=priors)
    return seen


def of(stored, draws, vehicle=None, mass=None):
    made = job()
    made.study.vehicle_of = lambda flight: SimpleNamespace(canopies=SimpleNamespace(number=2))
    return module._of(made, vehicle, mass, stored.group, stored.fit, draws)


def test_draws_are_taken_evenly_through_the_chains(stored):
    made = of(stored, 12)
    np.testing.assert_allclose(made.theta[:, 0], 9.0 * np.arange(12) + 0.25)
    assert len(of(stored, 1000).theta) == 100 and of(stored, 100).theta[-1, 0] == 99.25


def test_draws_share_noise_parameters_in_groups(stored):
    made = of(stored, 2 * GROUP + 1)
    assert stored.shared == [3]
    first, second = made.laws
    np.testing.assert_array_equal(first[:, 0], np.repeat([0.0, 1.0, 2.0], [GROUP, GROUP, 1]))
    np.testing.assert_array_equal(second, np.stack([first[:, 0], 2.0 + 0 * first[:, 0], 3.0 + 0 * first[:, 0]], axis=1))


def test_coefficients_of_the_base_are_blank_and_the_model_is_of_the_vehicle_that_lands(stored):
    made = of(stored, 4)
    assert made.base == Base((0.0, 0.0), (0.0,)) and made.structure == Structure(2) and made.latent == ("latent", 2)
    other = SimpleNamespace(canopies=SimpleNamespace(number=3))
    assert of(stored, 4, other, 8000.0).structure.canopies == 3 and stored.assembled[-1] == (other, 8000.0)


@pytest.mark.parametrize(
    ("vehicle", "mass"), [(SimpleNamespace(canopies=SimpleNamespace(number=2)), None), (None, 9.0)]
)
def test_a_mass_of_the_posterior_is_not_that_of_another_payload(stored, vehicle, mass):
    assert of(stored, 4).names == ("axial[1]", "capsule_mass", "riser_length")
    assert of(stored, 4, vehicle, mass).names == ("axial[1]", "", "riser_length")


def test_landings_have_no_record_and_so_none_of_its_constant_errors(stored):
    wrong = Prior("wind_bias.north", 0.0, 1.0, False, "m/s", "")
    stored.group.priors = (*stored.group.priors[:2], wrong)
    made = of(stored, 4)
    assert made.names == ("axial[1]", "capsule_mass", "") and made.theta.shape == (4, 3)
