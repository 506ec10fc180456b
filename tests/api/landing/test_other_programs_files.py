"""Files for other programs: of the mean and of a draw, through `Landings`, through `bayeschute land`, bad input."""

from __future__ import annotations

import json
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
from tests.landing.plans import small_plan
from typer.testing import CliRunner

import bayeschute as bc
from bayeschute.api.landing.landing_files import dictionary, write_for_others
from bayeschute.api.landing.other_programs_files import write_jsbsim, write_other_programs
from bayeschute.cli import app
from bayeschute.core.errors import InputError
from bayeschute.landing.aero_table import ANGLES
from bayeschute.landing.measures import ROW
from bayeschute.landing.other_programs.steady_cluster import cluster_coefficients, steady_clusters


@pytest.fixture(scope="module")
def plan():
    return small_plan()


@pytest.fixture
def landings(plan):
    return bc.Landings("drop <1> & 2", np.zeros(2, ROW), (), {}, (), SimpleNamespace(plan=plan))


def tables(path):
    """Coefficients of a section (3, A), and its angles [deg]."""
    found = [one.text.split() for one in ElementTree.parse(path).iter("tableData")]
    read = np.array(found, float).reshape(3, -1, 2)
    return read[:, :, 1], read[0, :, 0]


def test_the_mean_is_that_of_the_draws(landings, plan, tmp_path):
    each = [tables(landings.to_jsbsim(tmp_path / f"{draw}.xml", draw))[0] for draw in range(plan.draws)]
    mean, angles = tables(landings.to_jsbsim(tmp_path / "mean.xml"))
    np.testing.assert_allclose(mean, np.mean(each, axis=0), atol=1e-11)
    np.testing.assert_allclose(angles, np.rad2deg(ANGLES), atol=1e-9)
    steady = steady_clusters(plan.models)
    want = cluster_coefficients(plan.models[0], steady.flyout, steady.speed)
    np.testing.assert_allclose(each[7], want[:, :, 7], atol=1e-11)
    root = ElementTree.parse(tmp_path / "7.xml").getroot()
    assert root.get("name") == "drop <1> & 2" and root.find("documentation").text.startswith("draw 7 of 12; ")


def test_draws_are_counted_through_the_models(plan, tmp_path):
    (one,) = plan.models
    mixed = replace(plan, models=(replace(one, theta=one.theta[:5]), replace(one, theta=one.theta[5:])))
    for draw in (None, 4, 5, 11):
        a, b = (tables(write_jsbsim(p, "n", tmp_path / f"{i}.xml", draw))[0] for i, p in enumerate((plan, mixed)))
        np.testing.assert_allclose(a, b, atol=1e-11)


def test_parachutes_of_all_draws(landings, plan, tmp_path):
    module = landings.to_rocketpy(tmp_path / "new")
    said = json.loads(module.with_suffix(".json").read_text(encoding="utf-8"))
    assert said["name"] == "drop <1> & 2" and len(said["draws"]) == plan.draws
    assert [one["cd_s"] for one in said["draws"]] == steady_clusters(plan.models).drag_area.tolist()


@pytest.mark.parametrize("draw", [-1, 12, 1.5, True, "3"])
def test_what_is_no_draw_is_refused(landings, tmp_path, draw):
    with pytest.raises(InputError) as caught:
        landings.to_jsbsim(tmp_path / "canopies.txt", draw)
    first, second = caught.value.faults
    assert first.got == repr(draw) and first.wanted == "a whole number from 0 to 11, or None"
    assert "ends with .xml" in second.wanted and not any(tmp_path.iterdir())


def test_landings_from_a_file_have_no_draws(landings, tmp_path):
    back = replace(landings, source=None)
    for write in (lambda: back.to_jsbsim(tmp_path / "c.xml"), lambda: back.to_rocketpy(tmp_path)):
        with pytest.raises(InputError, match="landings read from a file"):
            write()


class Known(dict):
    """The part of a posterior that goes into files."""

    names = ("axial[1]",)


def test_what_land_writes(landings, plan, tmp_path):
    rng = np.random.default_rng(1)
    known = Known({"axial[1]": xr.DataArray(rng.normal(0.9, 0.1, (2, 100)), dims=("chain", "draw"))})
    lines = write_for_others(known, plan, tmp_path, "campaign", 13)
    assert lines == ["files for JSBSim of 12 draws: the campaign has no more"]
    assert {p.name for p in tmp_path.iterdir()} >= {
        "aero_tables.csv", "jsbsim_canopies.xml", "rocketpy_parachutes.json", "rocketpy_parachutes.py", "parameters",
    }  # fmt: skip
    assert len(list((tmp_path / "jsbsim").iterdir())) == 12
    told = dictionary(landings)
    entries = set(told[told["file"] == "rocketpy_parachutes.json"]["column"])
    said = json.loads((tmp_path / "rocketpy_parachutes.json").read_text(encoding="utf-8"))
    assert entries == set(said["draws"][0]) and said["name"] == "campaign"


def test_canopies_without_a_steady_angle_end_no_campaign(plan, tmp_path):
    (one,) = plan.models
    theta = one.theta.copy()
    theta[:, 2:4] = [-1.0, 0.0]
    lost = replace(plan, models=(replace(one, theta=theta),))
    (line,) = write_other_programs(lost, "n", tmp_path, 3)
    assert line.startswith("no files for JSBSim and RocketPy: canopies as one body: got no steady fly-out angle")
    assert not any(tmp_path.iterdir())


def test_the_shell_asks_for_files_of_draws(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr("bayeschute.study.landing_campaign.campaign_file.load_campaign", lambda *given: None)
    monkeypatch.setattr(
        "bayeschute.api.landing.landing_command.land_file", lambda *given: asked.append(given[3].jsbsim_draws) or []
    )
    campaign, posterior = tmp_path / "c.toml", tmp_path / "p.nc"
    campaign.touch(), posterior.touch()
    call = ["land", str(posterior), str(campaign), "--out", str(tmp_path / "out")]
    for more in ([], ["--jsbsim-draws", "50"]):
        assert CliRunner().invoke(app, [*call, *more]).exit_code == 0
    assert asked == [0, 50]
    assert CliRunner().invoke(app, [*call, "--jsbsim-draws", "-1"]).exit_code == 2
