"""Starts from the prior, judged at the mode of a run."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import optimum
import pytest
from optimum import Problem, found, kept, modes

from bayeschute.posterior.along_record import conditional_mode
from bayeschute.posterior.assess import multistart
from bayeschute.posterior.assess.multistart import Start, Told
from bayeschute.posterior.fit import marginal_mode
from bayeschute.posterior.fit.joint_fit import JointFit


def place(theta, converged=True):
    return SimpleNamespace(theta=np.array(theta), covariance=np.diag([4.0, 0.01]), converged=converged, flights=())


@pytest.fixture
def led(monkeypatch):
    """Three starts: one comes to the run's mode, one to another, one nowhere; the density is a parabola."""
    ends = {0: place([1.1, 2.0]), 1: place([1.0, 2.5])}

    def settle(flights, priors, prior, number, seed, spread):
        assert (seed, spread) == (7, 1.0)
        return Start(number, JointFit(ends[number], "own", -3.0)) if number in ends else Start(number, None, "lost")

    def search(flights, priors, settled):
        assert settled.hyper == "the run's"
        return settled.optimum

    def at(flights, hyper, priors, theta, places):
        return SimpleNamespace(marginal=float((theta[1] - 2.0) ** 2))

    monkeypatch.setattr(multistart, "settle_from", settle)
    monkeypatch.setattr(marginal_mode, "marginal_mode", search)
    monkeypatch.setattr(conditional_mode, "conditional_optimum", at)
    priors = tuple(SimpleNamespace(name=name) for name in "ab")
    return Problem([], priors, None, "the run's", place([1.0, 2.0]), "a fit")


def test_a_start_is_found_where_its_mode_is_the_run_s(led, tmp_path, capsys):
    one, other, none = modes(led, 3, 7, tmp_path)
    assert one == Told(0, "", True, -3.0, pytest.approx(0.05), "a", pytest.approx(0.0)) and found(one)
    assert other == Told(1, "", True, -3.0, pytest.approx(5.0), "b", pytest.approx(0.25)) and not found(other)
    assert none.why == "lost" and np.isnan(none.away) and not found(none) and not none.converged
    told = capsys.readouterr().out
    assert "start 1: 5.000 standard deviations off in b, log density -0.25" in told
    assert "start 2: lost, NOT CONVERGED" in told


def test_a_search_that_did_not_end_is_not_found():
    near = Told(0, "", True, -3.0, 0.1, "a", 0.0)
    assert found(near) and not found(near._replace(converged=False)) and not found(near._replace(away=0.31))


def test_what_is_kept_tells_the_share_and_what_made_it(led, tmp_path):
    made = kept(tmp_path / "Q_1.toml", 7, modes(led, 3, 7, tmp_path))
    assert made["study"] == "Q_1" and made["share_found"] == pytest.approx(1.0 / 3.0) and made["near"] == optimum.NEAR
    assert [row["number"] for row in made["rows"]] == [0, 1, 2]
    assert made["provenance"]["command"] == "benchmarks/optimum.py Q_1.toml RUN --starts 3 --seed 7"


def test_rows_of_this_fit_are_kept_and_not_made_again(led, tmp_path, capsys):
    made = modes(led, 3, 7, tmp_path, first=2)
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == ["start 2", "start 0", "start 1"]
    file = tmp_path / "seed-7-start-0.json"
    held = json.loads(file.read_text())
    (tmp_path / "seed-7-start-1.json").unlink()
    file.write_text(json.dumps(held | {"row": held["row"] | {"away": 0.25}}))
    again = modes(led, 3, 7, tmp_path)
    assert capsys.readouterr().out.startswith("start 1:") and again[0].away == 0.25
    assert again[1] == made[1] and again[2].why == "lost"
    file.write_text(json.dumps(held | {"key": "another fit"}))
    assert modes(led, 3, 7, tmp_path)[0] == made[0]
