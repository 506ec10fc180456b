"""Winds by month in a campaign file: ensembles whose members have months, statistics by altitude, and their faults."""

from __future__ import annotations

import re

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.landing.climatology import DAYS
from bayeschute.study.landing_campaign.campaign_file import load_campaign, wind_plan

LEAST = 'title = "t"\nseed = 1\n[start]\naltitude = "1000 m"\n'
ENSEMBLE = (
    '[wind.ensemble]\nfile = "many.csv"\nmember = "member"\naltitude = { column = "h", unit = "m" }\n'
    'north = { column = "v", unit = "m/s" }\neast = { column = "u", unit = "m/s" }\n'
)
COLUMNS = "".join(
    f'{name} = {{ column = "{column}", unit = "{unit}" }}\n'
    for name, column, unit in (
        ("altitude", "h", "km"), ("north", "v", "m/s"), ("east", "u", "m/s"), ("north_sd", "sv", "m/s"),
        ("east_sd", "su", "km/h"),
    )
)  # fmt: skip
STATISTICS = f'[wind.climatology]\nlength = "2 km"\n[wind.climatology.statistics]\nfile = "stats.csv"\n{COLUMNS}'
TABLE = """[wind.climatology]
length = "1500 m"
altitude = ["0 m", "1000 m"]
north = ["2 m/s", "8 m/s"]
east = ["0 m/s", "-3 m/s"]
north_sd = ["1 m/s", "4 m/s"]
east_sd = ["1 m/s", "3 m/s"]
"""


def winds(folder, text):
    (folder / "c.toml").write_text(LEAST + text)
    return wind_plan(load_campaign(folder / "c.toml").tables.wind)


def faults(folder, text):
    with pytest.raises(InputError) as caught:
        winds(folder, text)
    return caught.value.faults


def many(folder, months):
    """An ensemble of one member a month, its wind to the north the member's number."""
    rows = [f"{m},{h},{m},0,{month}\n" for m, month in enumerate(months) for h in (0, 900)]
    (folder / "many.csv").write_text("member,h,v,u,when\n" + "".join(rows))


def stats(folder, *rows, header="month,h,v,u,sv,su,r"):
    (folder / "stats.csv").write_text("\n".join([header, *rows]) + "\n")


@pytest.mark.parametrize(
    "months",
    [
        (6, 6, 7, 1), ("06", "6", "07", "1"), ("2019-06-30", "2020-06-01T23:59Z", "2020-07-01 00:00", "1999-01"),
        (20190630, 20200601, 20200701, 19990131),
    ],
)  # fmt: skip
def test_members_of_an_ensemble_are_picked_by_their_month(tmp_path, months):
    many(tmp_path, months)
    made = winds(tmp_path, ENSEMBLE + 'month = "when"\nmonths = [7, 6]\n')
    assert [p.wind[0, 0] for p in made.profiles] == [0.0, 1.0, 2.0]
    ratio = np.array(made.weights) / made.weights[0]
    np.testing.assert_allclose(ratio, [1.0, 1.0, 2.0 * 31.0 / 30.0])  # July as a whole is as likely as its days
    (one,) = winds(tmp_path, ENSEMBLE + 'month = "when"\nmonths = 1\n').profiles
    assert one.wind[0, 0] == 3.0
    assert len(winds(tmp_path, ENSEMBLE + 'month = "when"\n').profiles) == 4
    plain = winds(tmp_path, ENSEMBLE)
    assert len(plain.profiles) == 4 and plain.weights == ()


def test_profiles_beside_an_ensemble_by_month_weigh_as_one_member_on_average(tmp_path):
    many(tmp_path, (6, 6, 7, 1))
    profile = '[[wind.profile]]\naltitude = ["0 m", "9 m"]\nnorth = ["1 m/s", "1 m/s"]\neast = ["1 m/s", "1 m/s"]\n'
    made = winds(tmp_path, profile + ENSEMBLE + 'month = "when"\nmonths = [6, 7]\n')
    assert len(made.weights) == 4 and made.weights[0] == 1.0 and np.mean(made.weights[1:]) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ("months = [6]", "months without month"),
        ('month = "when"\nmonths = [6, 13]', "months from 1 to 12"),
        ('month = "when"\nmonths = [6, 6]', "each once"),
        ('month = "when"\nmonths = []', "months from 1 to 12"),
        ('month = "when"\nmonths = "June"', "months from 1 to 12"),
        ('month = "when"\nmonths = [6, 12, 3]', "no row of month 12, 3; it has 1, 6, 7"),
        ('month = "season"\nmonths = [6]', "no such column"),
    ],
)
def test_months_that_cannot_be(tmp_path, keys, word):
    many(tmp_path, (6, 6, 7, 1))
    (fault,) = faults(tmp_path, ENSEMBLE + keys + "\n")
    assert word in str(fault) and "ensemble" in fault.where


@pytest.mark.parametrize("bad", ["June", "13", "0", "6.5", "2020", "2020-13-01", "01/06/2020", "202006", ""])
def test_a_column_of_months_holds_months_or_dates(tmp_path, bad):
    many(tmp_path, (6, bad, 7))
    (fault,) = faults(tmp_path, ENSEMBLE + 'month = "when"\nmonths = [6]\n')
    assert "in row 4 (2 such rows)" in fault.got and "months from 1 to 12, or dates" in fault.wanted


def test_a_member_has_one_month_and_all_faults_of_the_file_are_told_at_once(tmp_path):
    rows = ["1,0,1,1,6", "1,5,1,1,7", "2,3,1,1,6", "2,3,1,1,6"]
    (tmp_path / "many.csv").write_text("\n".join(["member,h,v,u,when", *rows]) + "\n")
    (fault,) = faults(tmp_path, ENSEMBLE + 'month = "when"\n')
    assert "member 1 in months 6, 7" in fault.got and "one twice in member 2" in fault.got


def test_statistics_by_month(tmp_path):
    stats(tmp_path, *("6,0,1,2,3,3.6,.5", "6,2,4,5,6,7.2,-.5"), *("1,2,9,9,9,36,0", "1,0,8,8,8,36,0"))
    made = winds(tmp_path, STATISTICS + 'month = "month"\nmonths = [6, 1]\ncorrelation = "r"\n')
    june, january = made.profiles
    np.testing.assert_array_equal(june.wind, [[1.0, 2.0, 0.0], [4.0, 5.0, 0.0]])
    np.testing.assert_array_equal(january.altitude, [0.0, 2000.0])  # a file may go downwards
    np.testing.assert_allclose(made.scatter[0].sd, [[3.0, 1.0], [6.0, 2.0]])
    assert made.scatter[0].correlation.tolist() == [0.5, -0.5] and made.scatter_length == 2000.0
    assert made.weights[1] / made.weights[0] == pytest.approx(DAYS[0] / DAYS[5]) and made.size == 51 + 48
    only = winds(tmp_path, STATISTICS + 'month = "month"\nmonths = 1\n')
    assert only.weights == () and not only.scatter[0].correlation.any()
    assert len(winds(tmp_path, STATISTICS + 'month = "month"\n').profiles) == 2


def test_statistics_of_one_period(tmp_path):
    stats(tmp_path, "0,1,2,3,3.6", "2,4,5,6,7.2", header="h,v,u,sv,su")
    assert winds(tmp_path, STATISTICS).profiles[0].wind[1, 0] == 4.0
    made = winds(tmp_path, TABLE + "correlation = [0.1, 0.2]\n")
    assert made.scatter[0].sd[1].tolist() == [4.0, 3.0] and made.scatter[0].correlation.tolist() == [0.1, 0.2]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (["6,0,1,1,-1,1,0", "6,1,1,1,1,1,0"], ["column 'sv'", "got -1 m/s", "standard deviations from 0"]),
        (["6,0,1,1,1,9999,0", "6,1,1,1,1,1,0"], ["column 'su'", "standard deviations from 0 to 500 m/s"]),
        (["6,0,1,1,1,1,0", "6,0,1,1,1,1,0"], ["0 m followed by 0 m in month 6", "altitudes that increase"]),
        (["6,0,1,1,1,1,0", "6,2,1,1,1,1,0", "6,1,1,1,1,1,0"], ["2000 m followed by 1000 m in month 6"]),
        (["6,0,1,1,1,1,1.2"], ["column 'r'", "one of size 1.2", "correlations between"]),
        (["7,0,1,1,1,1,0"], ["no row of month 6; it has 7"]),
        (["6,0,999,1,1,1,0"], ["winds up to 500 m/s"]),
        (["7,0,1,1,-2,1,3"], ["no row of month 6", "column 'sv': -2 m/s", "column 'r': one of size 3"]),
    ],
)
def test_statistics_that_cannot_be(tmp_path, rows, words):
    stats(tmp_path, *rows)
    (fault,) = faults(tmp_path, STATISTICS + 'month = "month"\nmonths = 6\ncorrelation = "r"\n')
    for word in words:
        assert word.removeprefix("got ") in str(fault), str(fault)
    assert fault.where.endswith("[wind.climatology] statistics")


def test_months_without_a_column_would_be_one_profile(tmp_path):
    stats(tmp_path, "6,0,1,1,1,1,0", "7,0,1,1,1,1,0")
    (fault,) = faults(tmp_path, STATISTICS)
    assert "altitudes that increase" in fault.wanted


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('length = "1500 m"\n', "", ["length", "this key is required"]),
        ('length = "1500 m"', 'length = "0 m"', ["length", "> 0 m"]),
        ('north_sd = ["1 m/s", "4 m/s"]', 'north_sd = ["1 m/s", "-4 m/s"]', ["north_sd", ">= 0 m/s"]),
        ('north_sd = ["1 m/s", "4 m/s"]', 'north_sd = ["1 m/s"]', ["1 of north_sd"]),
        ('"0 m", "1000 m"', '"1000 m", "0 m"', ["altitudes that don't increase"]),
        ("", "correlation = [0.1, 1.0]\n", ["correlation", "<= 0.999"]),
        ("", f'[wind.climatology.statistics]\nfile = "stats.csv"\n{COLUMNS}', ["got both"]),
    ],
)
def test_a_table_that_cannot_be(tmp_path, old, new, words):
    stats(tmp_path, "0,1,2,3,3.6", header="h,v,u,sv,su")
    (fault,) = faults(tmp_path, TABLE.replace(old, new) if old else TABLE + new)
    for word in words:
        assert word in str(fault), str(fault)


def test_a_climatology_stands_alone_and_every_fault_is_told(tmp_path):
    many(tmp_path, (6, 7))
    (fault,) = faults(tmp_path, TABLE + ENSEMBLE)
    assert fault.got == "a climatology and ensemble" and fault.where.endswith("[wind] climatology")
    assert "neither" in str(faults(tmp_path, '[wind.climatology]\nlength = "9 m"\n')[0])
    text = TABLE + ENSEMBLE + 'months = [0]\n[[wind.shear]]\nmiddle = "3 m"\n[ground]\nslope = "80 deg"\n'
    said = "\n".join(map(str, faults(tmp_path, text)))
    for word in ("months from 1 to 12", "a climatology and ensemble", "thickness", "1.0472 rad"):
        assert re.search(re.escape(word), said), said


def test_what_a_file_says_is_not_to_be_given(tmp_path):
    many(tmp_path, (6, 7))
    stats(tmp_path, "0,1,2,3,3.6", header="h,v,u,sv,su")
    assert "come from the file" in str(faults(tmp_path, ENSEMBLE + "member_months = [6]\n")[0])
    assert "comes from the file" in str(faults(tmp_path, STATISTICS + "found = []\n")[0])
