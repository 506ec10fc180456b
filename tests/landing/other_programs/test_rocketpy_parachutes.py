"""RocketPy's parachutes: the module runs with nothing but a stand-in of RocketPy, and its numbers are the draws'."""

from __future__ import annotations

import json
import runpy
import sys
from types import ModuleType

import numpy as np
import pytest

from bayeschute.landing.other_programs.rocketpy_parachutes import ENTRIES, entries, write
from bayeschute.landing.other_programs.steady_cluster import steady_clusters


@pytest.fixture(scope="module")
def steady(plan):
    return steady_clusters(plan.models)


class Parachute:
    """RocketPy's since it knows an added mass."""

    def __init__(
        self, name, cd_s, trigger, sampling_rate, lag=0, noise=(0, 0, 0), radius=None, height=None, porosity=0.0432
    ):
        self.said = {k: v for k, v in locals().items() if k != "self"}


class OldParachute:
    """RocketPy's before that."""

    def __init__(self, name, cd_s, trigger, sampling_rate, lag=0, noise=(0, 0, 0)):
        self.said = {k: v for k, v in locals().items() if k != "self"}


class StochasticParachute:
    def __init__(self, parachute, cd_s=None):
        self.parachute, self.cd_s = parachute, cd_s


def as_rocketpy(monkeypatch, parachute, newest=False):
    """Put a stand-in where `import rocketpy` finds it."""
    rocketpy = ModuleType("rocketpy")
    rocketpy.StochasticParachute = StochasticParachute
    monkeypatch.setitem(sys.modules, "rocketpy", rocketpy)
    if newest:
        rocket, own = ModuleType("rocketpy.rocket"), ModuleType("rocketpy.rocket.parachutes")
        own.HemisphericalParachute = parachute
        monkeypatch.setitem(sys.modules, "rocketpy.rocket", rocket)
        monkeypatch.setitem(sys.modules, "rocketpy.rocket.parachutes", own)
    else:
        rocketpy.Parachute = parachute


@pytest.mark.parametrize("newest", [False, True])
def test_the_module_makes_parachutes(steady, tmp_path, monkeypatch, newest):
    as_rocketpy(monkeypatch, Parachute, newest)
    data, module = write('main "<x>" \n', steady, tmp_path)
    chutes = runpy.run_path(str(module))
    every = chutes["parachutes"](trigger=800.0, lag=1.5)
    assert [one.said["cd_s"] for one in every] == steady.drag_area.tolist()
    assert every[0].said["trigger"] == 800.0 and every[0].said["lag"] == 1.5
    mean = chutes["parachute"]().said
    assert mean["name"] == 'main "<x>" \n' and mean["trigger"] == "apogee" and mean["sampling_rate"] == 100
    assert mean["cd_s"] == pytest.approx(steady.drag_area.mean(), rel=1e-14)
    assert chutes["arguments"](draw=4)["cd_s"] == steady.drag_area[4] and chutes["mass"](4) == steady.mass[4]
    picked = chutes["stochastic"](name="other")
    assert picked.cd_s == steady.drag_area.tolist() and picked.parachute.said["name"] == "other"
    for wrong in (-1, 12):
        with pytest.raises(IndexError, match=f"draws 0 to 11, not {wrong}"):
            chutes["parachute"](wrong)
    assert json.loads(data.read_text(encoding="utf-8"))["units"]["cd_s"] == "m^2"


def test_a_version_without_added_mass_gets_none(steady, tmp_path, monkeypatch):
    as_rocketpy(monkeypatch, OldParachute)
    chutes = runpy.run_path(str(write("main", steady, tmp_path)[1]))
    assert set(chutes["parachute"](3).said) == {"name", "cd_s", "trigger", "sampling_rate", "lag", "noise"}


def test_the_module_needs_no_bayeschute(steady, tmp_path):
    text = write("main", steady, tmp_path)[1].read_text(encoding="utf-8")
    assert "import bayeschute" not in text and "from bayeschute" not in text


def test_rocketpy_falls_as_the_cluster_does(steady):
    """Terminal velocity of RocketPy's point mass is the descent rate, draw by draw; its added mass the enclosed air."""
    said = entries(steady)
    for draw, one in enumerate(said["draws"]):
        terminal = np.sqrt(2.0 * one["mass"] * 9.80665 / (1.225 * one["cd_s"]))
        assert terminal == pytest.approx(steady.speed[draw], rel=1e-12) and one["draw"] == draw
        assert terminal == pytest.approx(one["sea_level_descent_rate"], rel=1e-12)
        p = one["porosity"]
        added = 1.068 * (1 - 1.465 * p - 0.25975 * p**2 + 1.2626 * p**3)  # RocketPy's coefficient
        volume = added * 2.0 / 3.0 * np.pi * one["radius"] ** 2 * one["height"]
        assert volume == pytest.approx(steady.enclosed_volume[draw], rel=1e-12)
    assert said["mean"]["sea_level_descent_rate"] == pytest.approx(steady.speed.mean(), rel=1e-3)


def test_every_entry_has_a_unit_and_a_meaning(steady):
    said = entries(steady)
    assert set(said["draws"][0]) == set(ENTRIES) and set(said["mean"]) == set(ENTRIES) - {"draw"}
