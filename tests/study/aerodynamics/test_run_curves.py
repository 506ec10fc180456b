"""Curves of a run: how far they reach to meet what others know, and whose truth they stand beside."""

from __future__ import annotations

from types import SimpleNamespace

import pandas as pd
import pytest

from bayeschute.study.aerodynamics import run_curves as module


def known(target, *at, kind="curve"):
    return {"kind": kind, "target": target, "at": list(at)}


def test_curves_reach_the_least_and_the_greatest_of_all_that_is_known_of_them():
    told = [known("C_A", 0.1, 0.9), known("C_A", 0.2, 0.4), known("C_N", 0.3), known("C_A", 7.0, kind="coefficient")]
    assert module._reach(told) == {"C_A": 0.9, "C_A from": 0.1, "C_N": 0.3, "C_N from": 0.3}


def job(tmp_path, *virtual, vehicle=True):
    aero = SimpleNamespace(coefficients=lambda: {"axial[1]": 0.8})
    flights = [SimpleNamespace(virtual=one) for one in virtual]
    study = SimpleNamespace(
        vehicle=SimpleNamespace(aero=aero) if vehicle else None, with_role=lambda role: flights * (role == "identify")
    )
    return SimpleNamespace(study=study, out=tmp_path)


def test_a_truth_is_known_only_where_no_fitted_flight_was_measured(tmp_path):
    assert module._truth(job(tmp_path, 1, 2)) == {"axial[1]": 0.8}
    assert module._truth(job(tmp_path, 1, None)) is None
    assert module._truth(job(tmp_path, 1, vehicle=False)) is None


@pytest.fixture
def table(monkeypatch):
    made = pd.DataFrame({"curve": ["C_A", "C_A", "C_N"], "at": [0.0, 0.1, 0.0]})
    asked = []
    for name, value in (("agreement", [known("C_A", 0.5)]), ("ranges", {"alpha": (0.1, 0.4)}), ("as_rows", ["p"])):
        monkeypatch.setattr(module, name, lambda *_, value=value: value)
    monkeypatch.setattr(module, "proposed_terms", lambda flights: None)
    monkeypatch.setattr(module, "table", lambda *given: asked.append(given) or made)
    return made, asked


def test_a_run_has_its_table_and_its_words(tmp_path, table, monkeypatch):
    made, asked = table
    monkeypatch.setattr(module, "flown", lambda job: [SimpleNamespace(saturation=0.3)])
    told = module.told_curves(job(tmp_path, 1), {"d": 1}, {"p": 2})
    assert asked == [({"d": 1}, {"p": 2}, {"alpha": (0.1, 0.4)}, {"C_A": 0.5, "C_A from": 0.5}, {"axial[1]": 0.8}, 0.3)]
    pd.testing.assert_frame_equal(pd.read_csv(tmp_path / "curves.csv"), made)
    assert list(told["curves"]["words"]) == ["C_A", "C_N"] and told["curves"]["flown"] == {"alpha": [0.1, 0.4]}
    assert told["knowledge"] == [known("C_A", 0.5)] and told["proposals"] == ["p"]


def test_curves_of_an_earlier_run_do_not_stay_where_there_are_none(tmp_path, table, monkeypatch):
    (tmp_path / "curves.csv").write_text("old")
    monkeypatch.setattr(module, "flown", lambda job: [])
    assert module.told_curves(job(tmp_path), {}, {}) == {} and not (tmp_path / "curves.csv").exists()
