"""Campaign files: what they say, and every fault at once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.study.landing_campaign.campaign_file import load_campaign, surface_plan, wind_plan
from bayeschute.study.landing_campaign.landing_plan import requirements_of, start_plan

ROOT = Path(__file__).parents[3]
EXAMPLE = ROOT / "models/campaigns/cdt-3-11-landing.toml"
LEAST = 'title = "t"\nseed = 1\n[start]\naltitude = "1000 m"\n'


def written(tmp_path, text):
    path = tmp_path / "campaign.toml"
    path.write_text(text)
    return path


def test_the_example():
    campaign = load_campaign(EXAMPLE)
    start = start_plan(campaign.tables.start)
    assert start.altitude == pytest.approx((1219.2, 30.48)) and start.swing[1] == pytest.approx(np.deg2rad(6.0))
    winds = wind_plan(campaign.tables.wind)
    assert len(winds.profiles) == 2 and winds.events[0].kind == "shear" and winds.turbulence is None
    soft, upright = requirements_of(campaign)
    assert soft.limits[0].at_most == pytest.approx(36 * 0.3048) and len(upright.limits) == 3
    assert load_campaign(EXAMPLE).identity == campaign.identity == campaign.with_landings(7).identity


def test_what_the_example_has_in_comments(tmp_path):
    """Its climatology, waves and slope, without the marks of comments."""
    text = EXAMPLE.read_text(encoding="utf-8")
    start, end = text.index("# [wind.climatology]"), text.index("[[wind.shear]]")
    table = text[start:end].replace("# ", "", 1).replace("\n# ", "\n")
    profiles = text.index("[[wind.profile]]")
    text = text[:profiles] + table + text[end:]
    (tmp_path / "statistics.csv").write_text(
        "month,h,v,u,v_sd,u_sd,r\n" + "".join(f"{m},{h},1,2,3,4,0.5\n" for m in (6, 7, 8) for h in (0, 999))
    )
    sea = text.replace("# [ground.waves]", "[ground.waves]").replace("# significant_height", "significant_height")
    sea = sea.replace("# mean_period", "mean_period").replace("# direction", "direction")
    tables = load_campaign(written(tmp_path, sea)).tables
    assert len(wind_plan(tables.wind).scatter) == 3 and surface_plan(tables.ground).waves.period == 6.0
    land = text.replace("# slope", "slope")
    assert surface_plan(load_campaign(written(tmp_path, land)).tables.ground).slope == pytest.approx(
        np.deg2rad([3.0, 1.0])
    )


def test_every_fault_at_once(tmp_path):
    text = (
        'title = "t"\nseed = -1\nlandings = 3\nvehicle = "none.toml"\nwinds = 1\n'
        '[start]\naltitude = { mean = "1000 m", sdd = "1 m" }\nswing = 6\nspeed = -1\n'
        '[wind]\nerror_sd = "3 m"\n[[wind.shear]]\nmiddle = "300 m"\n'
        '[wind.ensemble]\nfile = "none.csv"\nmember = "m"\naltitude = { column = "h", unit = "m" }\n'
        'north = { column = "v", unit = "m/s" }\neast = { column = "u", unit = "m/s" }\n'
        '[[requirement]]\nname = "r"\nlimits = [{ quantity = "speed", at_most = "3 m/s" }]\n'
        '[[requirement]]\nname = "s"\nprobability = 1.5\nlimits = [{ quantity = "vertical_speed" }]\n'
        '[[requirement]]\nname = "e"\nlimits = []\n'
    )
    with pytest.raises(InputError) as caught:
        load_campaign(written(tmp_path, text))
    said = str(caught.value)
    for word in (
        "seed", "landings", "none.toml", "winds", "altitude", "swing", "speed", "error_sd", "thickness", "none.csv",
        "one of 'time'", "probability", "exactly one of at_most and at_least", "at least one limit",
    ):  # fmt: skip
        assert word in said, word
    assert "Traceback" not in said and len(caught.value.faults) >= 13


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_campaign(tmp_path / "none.toml")


def test_reading_a_campaign_needs_no_jax():
    script = (
        "import sys; from bayeschute.study.landing_campaign.campaign_file import load_campaign;"
        f"load_campaign({str(EXAMPLE)!r}); print('jax' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
