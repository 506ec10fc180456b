"""Campaigns, their winds and their vehicle damaged at random: clear faults or a sound campaign, never a traceback."""

from __future__ import annotations

import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from tests.damages import outcomes

from bayeschute.core.errors import InputError
from bayeschute.study.landing_campaign.campaign_file import load_campaign, surface_plan, wind_plan
from bayeschute.study.landing_campaign.landing_plan import requirements_of, start_plan

MODELS = Path(__file__).parents[3] / "models"
PROFILE = (
    '[[wind.profile]]\n[wind.profile.profile]\nfile = "profile.csv"\naltitude = { column = "h", unit = "km" }\n'
    'north = { column = "v", unit = "m/s" }\n'
)
ENSEMBLE = (
    '[wind.ensemble]\nfile = "many.csv"\nmember = "member"\naltitude = { column = "h", unit = "km" }\n'
    'north = { column = "v", unit = "m/s" }\neast = { column = "u", unit = "m/s" }\n'
)
CLIMATOLOGY = (
    '[wind.climatology]\nlength = "1 km"\n[wind.climatology.statistics]\nfile = "stats.csv"\nmonth = "month"\nmonths = [6, 7]\n'
    'altitude = { column = "h", unit = "km" }\nnorth = { column = "v", unit = "m/s" }\ncorrelation = "r"\n'
    'east = { column = "u", unit = "m/s" }\nnorth_sd = { column = "sv", unit = "m/s" }\n'
    'east_sd = { column = "su", unit = "km/h" }\n'
    '[ground]\ncontact_height = "2 m"\n[ground.waves]\nsignificant_height = "2 m"\npeak_period = "8 s"\n'
)
LEAST = 'title = "t"\nseed = 1\n[start]\naltitude = "1000 m"\n'


@pytest.fixture
def campaign(tmp_path) -> Path:
    """The example with a vehicle, a file of a profile and one of an ensemble."""
    for folder in ("campaigns", "vehicles"):
        shutil.copytree(MODELS / folder, tmp_path / folder)
    path = tmp_path / "campaigns" / "cdt-3-11-landing.toml"
    text = (
        path.read_text(encoding="utf-8")
        .replace("# vehicle", "vehicle")
        .replace("[placard]", f"{PROFILE}{ENSEMBLE}[placard]")
    )
    path.write_text(text, encoding="utf-8")
    (path.parent / "profile.csv").write_text("h,v\n" + "".join(f"{h},{2 * h}\n" for h in range(5)))
    rows = [f"{m},{h},{m},{h}\n" for m in range(3) for h in range(3)]
    (path.parent / "many.csv").write_text("member,h,v,u\n" + "".join(rows))
    return path


def _outcomes(campaign: Path, number: int, seed: int) -> Counter[tuple[str, str]]:
    """How many files of each damage were told of, or were clean."""

    def read() -> bool:
        made = load_campaign(campaign)
        start_plan(made.tables.start), requirements_of(made)
        for profile in wind_plan(made.tables.wind).profiles:
            assert (np.abs(profile.wind) <= 500.0).all() and (np.abs(profile.altitude) <= 80_000.0).all()
        return False

    beside = campaign.parent
    vehicle = beside.parent / "vehicles" / "cpas-two-mains.toml"
    files = (campaign, beside / "profile.csv", beside / "many.csv", vehicle)
    return outcomes([(path, read) for path in files], number, seed)


def test_damaged_campaigns_are_told_or_harmless(campaign):
    count = _outcomes(campaign, 120, seed=1)
    assert count["value", "told"] > 0 and count["value", "clean"] > 0 and count["NUL", "told"] > 0
    assert not count["depth", "clean"] and not count["NUL", "clean"] and not count["byte order mark", "told"]


def _of_months(folder: Path, number: int, seed: int) -> Counter[tuple[str, str]]:
    """As `_outcomes`, of a climatology over the sea and its file."""
    path, beside = folder / "months.toml", folder / "stats.csv"
    path.write_text(LEAST + CLIMATOLOGY)
    rows = [f"{day},{h},{h},1,2,3,0.{h}\n" for day in ("2020-06-01", "2021-07-09", "8") for h in range(3)]
    beside.write_text("month,h,v,u,sv,su,r\n" + "".join(rows))

    def read() -> bool:
        tables = load_campaign(path).tables
        winds = wind_plan(tables.wind)
        made = winds.by_altitude(np.zeros((winds.size, 2)), np.arange(0.0, 900.0, 2.0))
        assert np.isfinite(made).all() and (np.abs(made) <= 2000.0).all()
        assert np.isfinite(surface_plan(tables.ground).drawn(np.ones((3, 2))).gradient).all()
        return False

    return outcomes([(path, read), (beside, read)], number, seed)


def test_damaged_climatologies_are_told_or_harmless(tmp_path):
    count = _of_months(tmp_path, 120, seed=3)
    assert count["value", "told"] > 0 and count["value", "clean"] > 0 and not count["NUL", "clean"]


@pytest.mark.slow
def test_many_damaged_climatologies_are_told_or_harmless(tmp_path):
    assert sum(_of_months(tmp_path, 5000, seed=4).values()) == 5000


@pytest.mark.slow
def test_many_damaged_campaigns_are_told_or_harmless(campaign):
    assert sum(_outcomes(campaign, 5000, seed=2).values()) == 5000


@pytest.mark.parametrize("value", ["1e308", "1e300", "1e5", "-1e5"])
@pytest.mark.parametrize(
    ("table", "file", "rows"),
    [
        (PROFILE, "profile.csv", "h,v\n-1,1\n0,{}\n"),
        (PROFILE, "profile.csv", "h,v\n{},1\n0,1\n"),
        (ENSEMBLE, "many.csv", "member,h,v,u\n1,0,{},1\n1,1,2,1\n"),
        (ENSEMBLE, "many.csv", "member,h,v,u\n1,0,1,1\n1,{},2,1\n"),
    ],
)
def test_winds_and_altitudes_that_cannot_be(tmp_path, table, file, rows, value):
    """Those of a profile's altitudes and of ensembles went by, infinite ones of a large unit included."""
    (tmp_path / file).write_text(rows.format(value))
    (tmp_path / "c.toml").write_text(LEAST + table)
    with pytest.raises(InputError, match="unit right"):
        load_campaign(tmp_path / "c.toml")


@pytest.mark.parametrize("name", ["=cmd()", "+1", "-1", "@sum(A1)"])
def test_a_requirement_is_no_formula_of_a_spreadsheet(tmp_path, name):
    table = f'[[requirement]]\nname = "{name}"\nlimits = [{{ quantity = "vertical_speed", at_most = "9 m/s" }}]\n'
    (tmp_path / "c.toml").write_text(LEAST + table)
    with pytest.raises(InputError, match="would be a formula"):
        load_campaign(tmp_path / "c.toml")
