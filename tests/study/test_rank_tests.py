"""Rank tests of a study: what is fitted, faults at once, and results with their provenance."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.study import rank_tests as module
from bayeschute.study.evidence.numerics_hash import numerics
from bayeschute.study.load import load_study
from bayeschute.study.rank_tests import Tested, rank_tests, template, with_flown_terms
from bayeschute.study.study import study_hash

STUDY = Path(__file__).parents[2] / "models/studies/cdt-3-11.toml"


def made_up(seed, of, truths):
    """A row of a replicate that took no time."""
    rng = np.random.default_rng(seed)
    return {"seed": seed, "ok": True, "ranks": {"a": int(rng.integers(100))}, "spoiled": {"a": 99}, "redrawn": 0}


def test_results_are_stored_with_their_provenance(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "one", made_up)
    result = rank_tests(STUDY, tmp_path, 60)
    assert json.loads((tmp_path / "ranks.posterior.json").read_text()) == result
    assert result["passed"] is True and result["spoiled"]["passed"] is False and result["replicates"] == 60
    assert result["numerics"] == numerics() and result["command"].endswith("--ranks posterior --replicates 60")


def test_all_faults_at_once(tmp_path):
    with pytest.raises(InputError) as caught:
        rank_tests(STUDY, tmp_path, 1, "hearsay")
    assert "'hearsay'" in str(caught.value) and "at least 2" in str(caught.value) and not any(tmp_path.iterdir())


def test_the_study_is_fitted_with_the_terms_that_it_flies():
    study = with_flown_terms(load_study(STUDY))
    assert study.vehicle is not None and study.structure is not None
    names = {f"axial[{t}]" for t in study.structure.axial} | {f"transverse[{t}]" for t in study.structure.transverse}
    assert names == set(study.vehicle.aero.coefficients()) and study.structure.fit == "pool"
    assert [f.name for f in study.flights] == ["cdt-3-11"]


def test_the_template_is_the_studys_first_flight():
    study = load_study(STUDY)
    virtual = study.flights[0].virtual.model_copy(update={"duration": 12.0})
    short = replace(study, flights=(replace(study.flights[0], virtual=virtual), *study.flights[1:]))
    made = template(Tested(study_hash(short), short))
    assert made.flight.samples == 121
    assert {p.name for p in made.priors if "[" in p.name} == set(study.vehicle.aero.coefficients())
    assert made.noise.log_sd == 0.7
