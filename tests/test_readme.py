"""README: its picture and links are there, its commands exist, its Python runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import bayeschute as bc
from tests.conftest import descent_altitude
from tests.pages import blocks, faults_of_commands

ROOT = Path(__file__).parents[1]
README = ROOT / "README.md"


def test_it_is_a_page_with_a_picture_and_few_numbers():
    text = README.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 110
    assert (ROOT / "docs/figures/bands.svg").stat().st_size < 200_000
    prose = re.sub(r"(?s)```.*?```", "", text)
    assert len(re.findall(r"\d+(?:\.\d+)? %", prose)) == 0


def test_commands_of_continuous_integration_stand_in_it():
    assert {"make demo", "make test"} <= {
        line.split("  ")[0] for line in blocks(README, "sh") for line in line.splitlines()
    }


def test_every_command_and_option_in_it_exists():
    assert faults_of_commands(blocks(README, "sh")) == []


def test_own_record_runs(tmp_path, monkeypatch):
    altitude = descent_altitude(0.155, 3000.0, 110, np.random.default_rng(3)) / 0.3048
    rows = "".join(f"{i},{h:.3f}\n" for i, h in enumerate(altitude))
    (tmp_path / "sonde.csv").write_text("time_s,altitude_ft\n" + rows, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    _, own = blocks(README, "python")
    space = {"bc": bc}
    exec(own.replace("noise=noise))", "noise=noise), draws=200, chains=2, warmup=50)"), space)
    assert abs(space["posterior"]["cds_over_mass"].values.mean() - 0.155) < 0.02


@pytest.mark.slow
def test_the_study_that_comes_with_the_package_runs(monkeypatch, capsys):
    whole, _ = blocks(README, "python")
    quick = bc.Study.example().quick()
    monkeypatch.setattr(bc.Study, "example", lambda: quick)
    space = {}
    exec(whole, space)
    assert "Probability(met=" in capsys.readouterr().out
    assert {"swing_angle", "descent_rate"} <= set(space["forecast"].quantities)
