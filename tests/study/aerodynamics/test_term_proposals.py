"""Proposals for terms along a flown path: the term that a latent force is made of, and a fit that goes without one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bayeschute as bc
from bayeschute.aero.airflow import CanopyFlow, Neighbour
from bayeschute.aero.terms import transverse_term
from bayeschute.core.vectors import Vec3
from bayeschute.likelihood.flow_along import Along
from bayeschute.study.aerodynamics.flown import FlownFlight, ranges
from bayeschute.study.aerodynamics.term_proposals import as_rows, proposed_terms

T = 600
NOTHING = Vec3(*np.zeros((3, 2, T)))


def slow(seed, sd, memory=15.0):
    """Stationary AR(1) series (canopy, T)."""
    rng, phi = np.random.default_rng(seed), np.exp(-1.0 / memory)
    x = rng.standard_normal((2, T))
    for t in range(1, T):
        x[:, t] = phi * x[:, t - 1] + np.sqrt(1.0 - phi**2) * x[:, t]
    return sd * x


@pytest.fixture(scope="module")
def flow():
    """Two canopies that swing and cone, their axes down, beside each other in the north."""
    time = 0.1 * np.arange(T)
    alpha = 0.25 + 0.12 * np.sin(0.44 * time + np.array([[0.0], [0.4]])) + slow(1, 0.02)
    turn = 0.15 * time + np.array([[0.0], [1.0]])
    zero = np.zeros((2, T))
    e = Vec3(np.sin(alpha) * np.cos(turn), np.sin(alpha) * np.sin(turn), zero)
    rate = Vec3(slow(2, 0.05), slow(3, 0.05), zero)
    away = Vec3(np.repeat([[1.0], [-1.0]], T, axis=1), zero, zero)
    near = Neighbour(away, np.clip(0.65 + slow(4, 0.05), 0.4, 1.0), slow(5, 0.02))
    one = zero + 1.0
    return CanopyFlow(
        Vec3(zero, zero, one), e, rate, alpha**2, np.cos(alpha), 60.0 * one, one + slow(6, 0.05), slow(7, 0.02), (near,)
    )


def flight(flow, transverse, axial=None):
    along = Along(flow, np.zeros((2, T)) if axial is None else axial, transverse)
    return FlownFlight("a", along, ("1", "alpha^2"), ("e", "rate"))


def test_the_term_that_a_latent_force_is_made_of_comes_first(flow):
    missing = transverse_term("e*alpha^4", flow)
    noise = Vec3(slow(11, 0.0003), slow(12, 0.0003), np.zeros((2, T)))
    found = proposed_terms([flight(flow, missing * 0.5 + noise)])
    assert list(found) == ["transverse"]
    best = found["transverse"][0]
    assert best.term == "e*alpha^4" and best.coefficient == pytest.approx(0.5, abs=0.1)
    assert best.share > 0.25 and best.p_any < 0.01  # `e` of the model makes the rest
    assert len(as_rows(found)) == 5 and as_rows(found)[0]["kind"] == "transverse"


def test_terms_of_the_model_are_not_proposed(flow):
    found = proposed_terms([flight(flow, Vec3(slow(11, 0.01), slow(12, 0.01), np.zeros((2, T))), slow(13, 0.02))])
    for kind, has in (("axial", {"1", "alpha^2"}), ("transverse", {"e", "rate"})):
        assert not has & {one.term for one in found[kind]}


def test_a_canopy_alone_is_offered_no_terms_of_others(flow):
    alone = replace(flow, neighbours=())
    found = proposed_terms([flight(alone, Vec3(slow(11, 0.01), slow(12, 0.01), np.zeros((2, T))))])
    assert not any("c" in one.term.replace("(e.rate)", "").split("*") for one in found["transverse"])
    assert not any("proximity" in one.term for one in found["transverse"])


def test_without_latent_forces_nothing_is_proposed(flow):
    assert proposed_terms([flight(flow, NOTHING)]) == {} and proposed_terms([]) == {}


def test_ranges_are_of_all_flights(flow):
    one = flight(flow, NOTHING)
    found = ranges([one, flight(replace(flow, alpha_squared=flow.alpha_squared + 0.2), NOTHING)])
    assert found["alpha"][1] > ranges([one])["alpha"][1] and found["alpha"][0] == pytest.approx(
        float(np.quantile(np.sqrt(np.concatenate([flow.alpha_squared, flow.alpha_squared + 0.2])), 0.005))
    )
    assert set(found) == {"alpha", "D_prox", "rate", "speed"}


@pytest.mark.slow
def test_a_fit_without_a_term_asks_for_it():
    """45 s of a virtual drop that flies with e*alpha^2, fitted without anything of its kind."""
    study = bc.Study.example()
    drop = study.flights["cdt-3-11"].changed(window=(0.0, 45.0))
    few = study.candidates.model_copy(
        update={"axial": ("1",), "transverse": ("e", "rate", "repulsion(0.8)"), "fit": "pool"}
    )
    priors = bc.Priors.from_structure(bc.select_structure(drop, few), inflation=10.0) | study.priors
    found = bc.sample(bc.fit([drop], priors), draws=400, seed=1).proposals().query("kind == 'transverse'")
    assert found["term"].iloc[0].startswith("e*alpha") and "e*alpha^2" in set(found["term"])
    assert found["share"].iloc[0] > 0.3 and found["p_any"].iloc[0] < 0.001
