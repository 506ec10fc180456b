"""Questions to landings that are refused before anything is flown, and the payload of a placard without payloads."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from bayeschute.api.landing import landing_questions as module
from bayeschute.core.errors import Fault, InputError
from bayeschute.study.landing_campaign.campaign_schema import PlacardTable


def campaign(requirement=(), placard=None, design=None):
    return SimpleNamespace(
        path=Path("day.toml"), tables=SimpleNamespace(requirement=list(requirement), placard=placard, design=design)
    )


def source(*models, **tables):
    plan = SimpleNamespace(models=models)
    return SimpleNamespace(
        campaign=campaign(**tables), plan=plan, spec=None, told=lambda one: one, say=lambda name: print
    )


def told(run):
    with pytest.raises(InputError) as refused:
        run()
    return [str(fault) for fault in refused.value.faults]


def test_all_that_a_campaign_lacks_is_told_at_once():
    faults = told(lambda: module.check_questions(campaign(), ("design", "placard", "rare"), None))
    assert len(faults) == 3 and all("day.toml" in fault for fault in faults)
    assert "requirement" in faults[0] and "[placard]" in faults[1] and "[design]" in faults[2]
    module.check_questions(campaign(), (), None)
    module.check_questions(campaign(placard="a table"), ("placard",), None)
    assert len(told(lambda: module.check_questions(campaign(placard="a table"), ("placard", "rare"), None))) == 1


def test_faults_of_a_file_of_candidates_are_among_them(monkeypatch):
    def candidates(path, spec, data):
        raise InputError([Fault(str(path), "a", "b"), Fault(str(path), "c", "d")])

    monkeypatch.setattr(module, "candidates", candidates)
    design = SimpleNamespace(candidates="drops.toml")
    assert len(told(lambda: module.check_questions(campaign(design=design), ("design",), None))) == 3


def test_a_placard_without_payloads_is_of_the_capsule_s_own_mass(monkeypatch):
    asked = []
    monkeypatch.setattr(module, "requirements_of", lambda campaign: ())
    monkeypatch.setattr(module, "placard", lambda plan, cells, *_: asked.append(cells) or [])
    model = SimpleNamespace(base=SimpleNamespace(capsule=SimpleNamespace(mass=9100.0)))
    for said, masses in ((None, (9100.0,)), (["8000 kg", "9000 kg"], (8000.0, 9000.0))):
        table = PlacardTable.model_validate({"shear": ["2 m/s"]} | ({"capsule_mass": said} if said else {}))
        module.wind_placard(source(model, placard=table))
        assert asked[-1].capsule_mass == masses and asked[-1].shear == (2.0,)
        assert (asked[-1].middle, asked[-1].thickness) == (table.middle, table.thickness)
        assert (asked[-1].landings, asked[-1].amplitude) == (table.landings, table.amplitude)
    assert "[placard]" in told(lambda: module.wind_placard(source(model)))[0]


def test_drops_are_ranked_for_one_model_by_a_parameter_that_it_has(monkeypatch):
    monkeypatch.setattr(module, "candidates", lambda *_: None)
    monkeypatch.setattr(module, "requirements_of", lambda campaign: ("one",))
    design = SimpleNamespace(candidates="drops.toml", interval="drag")
    one = SimpleNamespace(names=("mass", "", "axial[1]"))
    assert "mixes models" in told(lambda: module.drop_ranking(source(one, one, design=design), None))[0]
    (fault,) = told(lambda: module.drop_ranking(source(one, design=design), None))
    assert "one of mass, axial[1]" in fault and "'drag'" in fault
