from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from bayeschute.core.errors import InputError
from bayeschute.study.load import check_study
from bayeschute.study.templates import NAMES, copy_templates, template

MODELS = Path(__file__).parents[2] / "models"


def _content(path: Path) -> dict[str, object]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def test_shipped_files_are_those_of_the_models_folder():
    assert _content(template("vehicle.toml")) == _content(MODELS / "vehicles/cpas-two-mains.toml")
    shipped, default = _content(template("virtual.toml")), _content(MODELS / "studies/cdt-3-11.toml")
    assert shipped | {"vehicle": ""} == default | {"vehicle": ""}
    for name, model in (("landing.toml", "cdt-3-11-landing.toml"), ("candidate-drops.toml", "candidate-drops.toml")):
        assert template(name).read_text(encoding="utf-8") == (MODELS / "campaigns" / model).read_text(encoding="utf-8")


def test_copies_lack_nothing_but_the_reader_s_records(tmp_path: Path):
    folder = tmp_path / "a" / "b"
    assert [path.name for path in copy_templates(folder)] == list(NAMES)
    assert check_study(folder / "virtual.toml") == []
    for name in ("cluster.toml", "descent.toml"):
        faults = check_study(folder / name)
        assert len(faults) == 1
        assert "no such file" in faults[0].got


def test_nothing_is_written_over(tmp_path: Path):
    (tmp_path / "descent.toml").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"descent.toml: got a file that exists"):
        copy_templates(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["descent.toml"]
    assert (tmp_path / "descent.toml").read_text(encoding="utf-8") == "mine"


def test_a_file_is_no_folder(tmp_path: Path):
    (tmp_path / "x").touch()
    with pytest.raises(InputError, match="got a file"):
        copy_templates(tmp_path / "x")
