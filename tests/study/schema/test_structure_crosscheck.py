"""Faults between the candidate terms, the vehicle and the priors, as `check` names them."""

from __future__ import annotations

from pathlib import Path

import pytest

from bayeschute.study.load import check_study
from bayeschute.study.schema.structure_schema import StructureTable

MODELS = Path(__file__).parents[3] / "models"


def faults(folder: Path, canopies: int = 2, *changes: tuple[str, str]) -> list[str]:
    vehicle = (MODELS / "vehicles" / "cpas-two-mains.toml").read_text(encoding="utf-8")
    assert "number = 2" in vehicle
    (folder / "vehicle.toml").write_text(vehicle.replace("number = 2", f"number = {canopies}", 1), encoding="utf-8")
    text = (MODELS / "studies" / "cdt-3-11.toml").read_text(encoding="utf-8")
    for old, new in (("../vehicles/cpas-two-mains.toml", "vehicle.toml"), *changes):
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return [str(fault) for fault in check_study(folder / "study.toml")]


def test_terms_of_two_canopies_need_a_second_one(tmp_path):
    named = [fault for fault in faults(tmp_path, 1) if "a term of a canopy alone" in fault]
    assert {fault.split("got ")[1].split(";")[0] for fault in named} == {
        "'proximity(0.8)'", "'closing'", "'repulsion(0.8)'", "'c'",
    }  # fmt: skip
    assert all("structure" in fault and "second one" in fault for fault in named)
    assert not any("canopy alone" in fault for fault in faults(tmp_path))


def test_a_second_canopy_of_a_flight_that_is_only_predicted_is_no_use_to_a_fit(tmp_path):
    two = (MODELS / "vehicles" / "cpas-two-mains.toml").read_text(encoding="utf-8")
    (tmp_path / "two.toml").write_text(two, encoding="utf-8")
    found = faults(tmp_path, 1, ('roles = ["predict"]', 'roles = ["predict"]\nvehicle = "two.toml"'))
    assert sum("a term of a canopy alone" in fault for fault in found) == 4
    (tmp_path / "one").mkdir()
    one = two.replace("number = 2", "number = 1", 1)
    (tmp_path / "one" / "one.toml").write_text(one, encoding="utf-8")
    found = faults(tmp_path / "one", 2, ('roles = ["predict"]', 'roles = ["predict"]\nvehicle = "one.toml"'))
    assert not any("a term of a canopy alone" in fault for fault in found)


@pytest.mark.parametrize("fit", ["pool", "selected", "search"])
def test_a_search_has_one_set_of_terms_for_all_canopies(tmp_path, fit):
    found = faults(
        tmp_path,
        2,
        ("inflation = 10.0", 'vary_canopies = ["axial[1]"]\ninflation = 10.0'),
        ('fit = "search"', f'fit = "{fit}"'),
    )
    assert len(found) == (fit == "search")
    if found:
        assert "'search' together with [priors] vary or vary_canopies" in found[0] and "'pool'" in found[0]


def test_the_only_canopy_need_not_be_named(tmp_path):
    """Of several, one says which the structure is found on, since the others test it."""
    unsaid = ("canopies = [1]", "")
    (told,) = faults(tmp_path, 2, unsaid)
    assert "[structure] canopies: got nothing; wanted on which of the vehicle's 2 canopies" in told
    assert "canopies = [1]" in told
    assert not any("structure] canopies" in fault for fault in faults(tmp_path, 1, unsaid))
    assert any(
        "structure] canopies, item 1: got canopy 2" in f for f in faults(tmp_path, 1, (unsaid[0], "canopies = [2]"))
    )
    assert any("structure] canopie:" in f for f in faults(tmp_path, 1, (unsaid[0], "canopie = [1]")))


def test_naming_the_only_canopy_changes_no_hash(tmp_path):
    said = StructureTable.model_validate({"axial": ["1"], "transverse": ["e"], "canopies": [1]})
    assert said.model_dump() == StructureTable.model_validate({"axial": ["1"], "transverse": ["e"]}).model_dump()
