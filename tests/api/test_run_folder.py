"""`Run`: what a folder tells as far as the run went."""

from __future__ import annotations

import json
from dataclasses import dataclass
from types import SimpleNamespace

import pytest

from bayeschute.api import run_folder as module
from bayeschute.api.run_folder import Run
from bayeschute.calibration.label import CONTRADICTED


def flight(name, *roles):
    return SimpleNamespace(name=name, roles=roles)


@pytest.fixture
def run(tmp_path):
    flights = (flight("s", "structure"), flight("i", "structure", "identify"), flight("p", "predict"))
    return Run(tmp_path, SimpleNamespace(spec=SimpleNamespace(flights=flights)))


def told(run, name, value):
    (run.folder / name).write_text(json.dumps(value), encoding="utf-8")
    return run


def test_a_run_that_did_not_end_says_so(run):
    assert run.summary == {} and run.level == "not checked" and "not finished" in repr(run)


def test_html_tells_missed_checks_and_requirements_without_markup_of_names(run):
    assert "not finished" in run._repr_html_() and "not checked" in run._repr_html_()
    checks = {"rhat": {"passed": True}, "bands": {"passed": False}, "loo": {"passed": None}}
    wanted = [{"name": "<b>", "run": "p", "probability_met": 0.25}, {"name": "r", "run": "p", "probability_met": None}]
    claim = {"level": "not checked", "contradicted": [], "sentences": ["Nothing is promised."]}
    shown = told(run, "summary.json", {"claim": claim, "checks": checks, "requirements": wanted})._repr_html_()
    assert "<td>checks</td><td>1 passed, missed: bands</td>" in shown and "Nothing is promised." in shown
    assert "<td>&lt;b&gt; on p</td><td>P(met) = 0.250</td>" in shown and "r on p</td><td>P(met) is not known" in shown


def test_a_contradicted_run_has_no_level_whatever_its_label_claims(run):
    claim = {"level": "self-consistent", "contradicted": []}
    assert told(run, "summary.json", {"claim": claim, "label": "l"}).level == "self-consistent" and ": l)" in repr(run)
    assert told(run, "summary.json", {"claim": claim | {"contradicted": ["wind"]}}).level == CONTRADICTED
    assert told(run, "summary.json", {"label": "l"}).level == "not checked"


@dataclass(frozen=True)
class Foretold:
    """A stand-in of a forecast."""

    name: str
    level: str = ""


def test_flights_that_were_fitted_or_predicted_have_forecasts_each_made_once(run, monkeypatch):
    made = []

    class Workspace:
        def __init__(self, *given):
            self.given = given

        def __enter__(self):
            return "job"

        def __exit__(self, *_):
            return None

    monkeypatch.setattr(module, "workspace", Workspace)
    monkeypatch.setattr(module, "collected", lambda folder: {})
    monkeypatch.setattr(module, "forecast_of", lambda job, one: made.append(one.name) or Foretold(f"of {one.name}"))
    monkeypatch.setattr(module, "stored_forecast_of", lambda job, one: pytest.fail("stage predict has not ended"))
    forecasts = run.forecasts
    assert list(forecasts) == ["i", "p"] and len(forecasts) == 2 and "s" not in forecasts
    assert [forecasts[name].name for name in ("p", "p", "i")] == ["of p", "of p", "of i"] and made == ["p", "i"]
    assert forecasts["p"].level == run.level
    for none in ("s", "x"):
        with pytest.raises(KeyError, match=f"no forecast '{none}'; there are i, p"):
            forecasts[none]


def test_a_flight_that_the_run_has_drawn_is_not_drawn_again(run, monkeypatch):
    monkeypatch.setattr(module, "forecast_of", lambda *_: pytest.fail("drawn anew"))
    monkeypatch.setattr(module, "stored_forecast_of", lambda job, one: Foretold(f"{one.name} of {job.out.name}"))
    (run.folder / ".stages").mkdir()
    (run.folder / ".stages/predict").write_text("key", encoding="utf-8")
    assert run.forecasts["p"].name == f"p of {run.folder.name}"
