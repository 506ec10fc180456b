"""Conditions of a run, from its records, its fit and its study."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayeschute.posterior.sampler import EMCEE_DREW, INDEPENDENCE_DREW
from bayeschute.study.assembly import assemble
from bayeschute.study.evidence import conditions as module
from bayeschute.study.evidence.conditions import ORIGIN, OTHER_PROGRAM, RECORD, VIRTUAL, conditions, origin
from bayeschute.study.job import Job
from bayeschute.study.load import load_study
from bayeschute.study.run import stage_list

STUDY = load_study(Path(__file__).parents[3] / "models/studies/cdt-3-11.toml")


@pytest.fixture(scope="module")
def ingested(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    short = [
        replace(f, virtual=f.virtual.model_copy(update={"duration": d}))
        for f, d in zip(STUDY.flights, (6.0, 8.0), strict=True)
    ]
    job = Job(replace(STUDY, flights=tuple(short)), folder, False, "", lambda *_: None)
    stage_list.ingest(job)
    (folder / "priors.json").write_text("[]")
    (folder / "fit").mkdir()
    return job


@pytest.fixture
def made(ingested, monkeypatch):
    monkeypatch.setattr(module, "load_noise_parameters", lambda job, group: assemble.hyper(STUDY))

    def of(*notes, study=ingested.study):
        (ingested.out / "fit/facts.json").write_text(json.dumps({"notes": list(notes)}))
        return conditions(replace(ingested, study=study))

    return of


def test_flights_noise_and_names_are_told(made):
    found = made()
    assert found.numbers["duration of fitted flights"] == pytest.approx([6.0])
    assert found.numbers["duration of predicted flights"] == pytest.approx([8.0])
    assert found.numbers["time between samples of fitted flights"] == pytest.approx([0.1])
    assert found.numbers["number of canopies of fitted flights"] == [2.0]
    assert found.numbers["capsule mass of predicted flights"] == pytest.approx([20340 * 0.45359237])
    swing = found.numbers["largest swing angle of fitted flights"][0]
    assert np.deg2rad(5.0) < swing < np.deg2rad(30.0)
    wind = np.hypot(2.0, 1.0) * 0.3048
    assert found.numbers["fitted standard deviation of the horizontal wind"] == pytest.approx([wind])
    assert found.names["channels"] == ["canopy_position", "capsule_velocity", "capsule_attitude"]
    assert found.names[ORIGIN] == [VIRTUAL] and found.names["sampler"] == ["nuts"]
    assert set(found.units) == set(found.numbers)


@pytest.mark.parametrize(("ending", "name"), [(EMCEE_DREW, "emcee"), (INDEPENDENCE_DREW, "independence sampler")])
def test_the_sampler_is_the_one_that_drew(made, ending, name):
    assert made(f"Draws by NUTS failed their check; {ending}").names["sampler"] == [name]


def test_a_sandwich_is_no_sampler(made, ingested, monkeypatch):
    table = STUDY.noise.model_copy(update={"model": "sandwich"})
    study = replace(ingested.study, noise=table)
    monkeypatch.setattr(module, "load_noise_parameters", lambda job, group: assemble.hyper(study))
    assert made(study=study).names["sampler"] == ["sandwich"]


def test_flights_come_from_here_from_records_or_from_other_programs():
    recorded = replace(STUDY.flights[0], virtual=None)
    assert [origin(f) for f in (STUDY.flights[0], recorded, replace(recorded, simulated_by="Adams"))] == [
        VIRTUAL, RECORD, OTHER_PROGRAM,
    ]  # fmt: skip
