"""A record whose parts disagree about the parameters: the run says so."""

from __future__ import annotations

import pytest

from bayeschute.study.run.stages import run_study

WIND = '[noise.wind]\nvertical = "0.5 m/s"\ntime_constant = "30 s"\n'


@pytest.fixture(scope="module")
def white(descents, tmp_path_factory):
    """Fits of two drops through gusts of half a minute, which the noise model takes for white noise of the sensor."""
    folder = tmp_path_factory.mktemp("white")
    for name in descents.truth:
        (folder / f"{name}.csv").write_bytes((descents.study.parent / f"{name}.csv").read_bytes())
    text = descents.study.read_text(encoding="utf-8")
    assert WIND in text
    study = folder / "white.toml"
    study.write_text(text.replace("[noise]\n", '[noise]\nmodel = "white"\n').replace(WIND, ""), encoding="utf-8")
    return run_study(study, folder / "run")


def test_the_check_is_missed_and_the_notes_say_why(white):
    summary = white
    check = summary["checks"]["score_dispersion"]
    assert not check["passed"] and check["value"] > check["bound"] > 1.0
    notes = [note for note in summary["notes"] if note.startswith("Parts of ")]
    assert [note.split(" disagree")[0] for note in notes] == ["Parts of low", "Parts of high"]
    assert any(f"{check['value']:.2g} times" in note for note in notes)
    assert all("Nothing is widened" in note for note in notes)  # classical results stay what they are


def test_gusts_in_the_noise_model_leave_nothing_to_disagree_about(finished):
    for name, check in finished.summary["checks"].items():
        assert name != "score_dispersion" or check["passed"]
    assert not [note for note in finished.summary["notes"] if note.startswith("Parts of")]
