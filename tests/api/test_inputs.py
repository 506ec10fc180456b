"""`Study` and `noise` from Python: what a study file says, in SI, and its faults."""

from __future__ import annotations

import pytest

import bayeschute as bc
from bayeschute.api.inputs import Study, noise
from bayeschute.study.load import load_study
from bayeschute.study.run.stage_data import given_priors

RATE = {"white": "0.3 m/s", "correlated": "1 ft/s", "time_constant": "3 s"}


def test_noise_from_python_is_that_of_a_study_file(sondes):
    made = noise(
        {"descent_rate": RATE | {"correlated": "0.3 m/s"}, "wind": {"vertical": "0.5 m/s", "time_constant": "30 s"}}
    )
    assert made == sondes.noise == sondes.spec.noise
    channel = noise({"descent_rate": RATE}).channels()["descent_rate"]
    assert (channel.white, channel.correlated, channel.time_constant) == pytest.approx((0.3, 0.3048, 3.0))


def test_all_faults_of_noise_are_told_at_once():
    with pytest.raises(bc.InputError) as caught:
        noise({"descent_rate": RATE | {"white": "0.3 kg"}, "speed": RATE})
    told = [str(fault) for fault in caught.value.faults]
    assert len(told) == 2 and all(one.startswith("noise") for one in told)
    assert any("descent_rate" in one and "white" in one for one in told) and any("speed" in one for one in told)


def test_a_study_is_read_with_all_it_says(descents):
    study = Study.load(descents.study)
    assert study.spec == load_study(descents.study) == Study.load(str(descents.study)).spec
    assert (study.title, study.spec.model, study.spec.seed) == ("Two made-up sondes", "descent", 4)
    assert study.vehicle is None and study.candidates is None and study.noise is study.spec.noise
    assert [flight.name for flight in study.flights] == ["low", "high"] and study.flights is study.flights
    assert study.flights["high"].study is study.spec and study.flights[1].spec is study.spec.flights[1]


def test_data_is_looked_for_where_it_is_said(descents, tmp_path):
    text = descents.study.read_text(encoding="utf-8").replace('file = "', 'file = "${DATA}/')
    path = tmp_path / "elsewhere.toml"
    path.write_text(text, encoding="utf-8")
    study = Study.load(path, descents.study.parent)
    assert study.flights["low"].spec.path.resolve() == descents.study.with_name("low.csv").resolve()
    with pytest.raises(bc.InputError, match="low.csv"):
        Study.load(path, tmp_path)


def test_the_example_is_a_cluster_with_candidates():
    study = Study.example()
    assert study.spec.model == "cluster" and study.vehicle is study.spec.vehicle is not None
    assert study.candidates is study.spec.structure and "1" in study.candidates.axial
    assert all(flight.source == "virtual drop" for flight in study.flights)


def test_priors_are_those_from_outside_with_the_studys_tables():
    study = Study.example()
    priors = study.priors
    assert priors.parameters == tuple(given_priors(study.spec)) and "riser_stiffness" in priors.names
    assert priors.table is study.spec.priors and priors.candidates is study.spec.structure


def test_a_quick_study_is_smaller_and_all_else_the_same():
    study = Study.example()
    quick = study.quick()
    assert isinstance(quick, Study) and quick.spec.sampler.draws < study.spec.sampler.draws
    assert quick.spec.predict.draws < study.spec.predict.draws
    assert [f.name for f in quick.flights] == [f.name for f in study.flights] and quick.noise == study.noise


def test_a_study_shows_itself(sondes):
    assert repr(sondes) == "Study('Two made-up sondes', descent, 2 flights, seed 4)"
    shown = sondes._repr_html_()
    assert "<b>Two made-up sondes</b>" in shown and shown.endswith("<p>model: descent</p></div>")
    assert "<tr><td>low</td><td>identify, predict</td><td>low.csv</td></tr>" in shown and shown.count("<tr>") == 3
    heads = ("flight", "roles", "record")
    assert "".join(f'<th scope="col">{name}</th>' for name in heads) in shown
