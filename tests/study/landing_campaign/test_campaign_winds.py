"""Winds of a campaign file: ensembles member by member and month by month, layers, turbulence, and what excludes what."""

from __future__ import annotations

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.study.landing_campaign import campaign_winds as module
from bayeschute.study.landing_campaign.campaign_file import load_campaign, wind_plan
from bayeschute.study.landing_campaign.campaign_winds import EnsembleTable, EventTable, WindTable
from bayeschute.study.schema.schema_faults import validated

LEAST = 'title = "t"\nseed = 1\n[start]\naltitude = "1000 m"\n'
ENSEMBLE = {
    "file": "many.csv",
    "member": "member",
    "altitude": {"column": "h", "unit": "m"},
    "north": {"column": "v", "unit": "m/s"},
    "east": {"column": "u", "unit": "m/s"},
}


def written(tmp_path, text):
    path = tmp_path / "campaign.toml"
    path.write_text(text)
    return path


def test_winds_of_an_ensemble_and_turbulence(tmp_path):
    rows = [f"{m},{h},{m + h / 1000},{-m}" for m in (3, 1, 2) for h in (2000, 0, 1000)]
    (tmp_path / "many.csv").write_text("\n".join(["member,h,v,u", *rows]) + "\n")
    text = LEAST + (
        '[wind.ensemble]\nfile = "many.csv"\nmember = "member"\naltitude = { column = "h", unit = "m" }\n'
        'north = { column = "v", unit = "km/h" }\neast = { column = "u", unit = "m/s" }\n'
        '[wind.turbulence]\nkind = "dryden"\nhorizontal = "2 m/s"\nvertical = "1 m/s"\nlength = "150 m"\n'
    )
    winds = wind_plan(load_campaign(written(tmp_path, text)).tables.wind)
    assert [p.wind[0, 1] for p in winds.profiles] == [-1.0, -2.0, -3.0]
    np.testing.assert_allclose(winds.profiles[0].wind[:, 0], np.array([1.0, 2.0, 3.0]) / 3.6)
    np.testing.assert_array_equal(winds.profiles[0].altitude, [0.0, 1000.0, 2000.0])
    assert winds.turbulence is not None and winds.turbulence.vertical_length == 150.0


def test_units_of_an_ensemble_are_checked_before_its_file_is_read(tmp_path):
    text = LEAST + (
        '[wind.ensemble]\nfile = "none.csv"\nmember = "member"\naltitude = { column = "h", unit = "m" }\n'
        'north = { column = "v", unit = "kg" }\neast = { column = "u", unit = "m/s" }\n'
    )
    with pytest.raises(InputError, match=r"north in 'kg'.*a unit convertible to m/s"):
        load_campaign(written(tmp_path, text))


def ensemble(folder, rows, **changes):
    """An ensemble from rows of member, altitude, north, east, month."""
    lines = ["member,h,v,u,month", *(",".join(map(str, row)) for row in rows)]
    (folder / "many.csv").write_text("\n".join(lines) + "\n")
    return validated(EnsembleTable, "wind", ENSEMBLE | changes, {"folder": str(folder)})


def faults(run):
    with pytest.raises(InputError) as refused:
        run()
    return [str(fault) for fault in refused.value.faults]


def test_members_are_in_order_of_their_numbers_and_their_rows_in_order_of_altitude(tmp_path):
    made = ensemble(tmp_path, [(7, 500, 1, 2, 6), (2, 0, 5, 6, 1), (7, 0, 3, 4, 6)])
    assert made.members == (((0.0, 5.0, 6.0),), ((0.0, 3.0, 4.0), (500.0, 1.0, 2.0))) and made.member_months == ()


def test_members_of_months_that_are_wanted(tmp_path):
    rows = [(m, h, m, 0, month) for m, month in ((1, 6), (2, 7), (3, 6), (4, 8)) for h in (0, 500)]
    made = ensemble(tmp_path, rows, month="month", months=[6, 8])
    assert [one[0][1] for one in made.members] == [1.0, 3.0, 4.0] and made.member_months == (6, 6, 8)
    assert ensemble(tmp_path, rows, month="month").member_months == (6, 7, 6, 8)
    (fault,) = faults(lambda: ensemble(tmp_path, rows, month="month", months=[5]))
    assert "no row of month 5" in fault


def test_all_faults_of_an_ensemble_are_told_at_once(tmp_path, monkeypatch):
    rows = [(1, 0, 1, 1, 6), (1, 500, 1, 1, 7), (2, 0, 1, 1, 6), (2, 0, 2, 2, 6), (3, 0, 1, 1, 6)]
    monkeypatch.setattr(module, "MOST_MEMBERS", 2)
    (told,) = faults(lambda: ensemble(tmp_path, rows, month="month"))
    assert "member 1 in months 6, 7; " in told and "one twice in member 2 of" in told and "csv: 3 members;" in told
    assert len(ensemble(tmp_path, rows[:3]).members) == 2  # as many as there may be


@pytest.mark.parametrize("given", [{"members": []}, {"member_months": [1]}])
def test_what_the_file_says_is_not_to_be_given(tmp_path, given):
    assert any(
        "come from the file" in fault for fault in faults(lambda: ensemble(tmp_path, [(1, 0, 1, 1, 1)], **given))
    )


def test_a_climatology_stands_alone(tmp_path):
    rows = {name: [f"{v} m/s" for v in (1, 2)] for name in ("north", "east", "north_sd", "east_sd")}
    climatology = {"altitude": ["0 m", "900 m"], "length": "500 m", **rows}
    profile = {"altitude": ["0 m", "900 m"], "north": ["1 m/s", "2 m/s"], "east": ["1 m/s", "2 m/s"]}
    assert validated(WindTable, "wind", {"climatology": climatology}).climatology is not None
    (fault,) = faults(lambda: validated(WindTable, "wind", {"climatology": climatology, "profile": [profile]}))
    assert "a climatology and profile" in fault
    broken = {"climatology": climatology, "profile": [{"altitude": 3}]}
    told = faults(lambda: validated(WindTable, "wind", broken))  # one with faults is one, too
    assert len(told) > 1 and any("a climatology and profile" in fault for fault in told)


def test_layers_are_met_for_certain_and_change_nothing_unless_said():
    made = validated(EventTable, "wind", {"middle": "300 m", "thickness": "50 m"})
    assert (made.middle, made.middle_sd, made.thickness, made.probability) == (300.0, 0.0, 50.0, 1.0)
    assert (made.north, made.east, made.down) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"probability": 0.0}, "probability"),
        ({"probability": 1.01}, "probability"),
        ({"thickness": "0 m"}, "thickness"),
        ({"middle_sd": "-1 m"}, "middle_sd"),
    ],
)
def test_layers_that_cannot_be(changes, words):
    (fault,) = faults(lambda: validated(EventTable, "wind", {"middle": "300 m", "thickness": "50 m"} | changes))
    assert words in fault


def test_factors_on_winds_are_limited():
    assert validated(WindTable, "wind", {"scale_sd": 2.0}).scale_sd == 2.0
    for value in (-0.1, 2.1):
        assert "scale_sd" in faults(lambda v=value: validated(WindTable, "wind", {"scale_sd": v}))[0]
    usual = WindTable()
    assert usual.error_length == 500.0 and not usual.any_direction and usual.scale_sd == usual.error_sd == 0.0
