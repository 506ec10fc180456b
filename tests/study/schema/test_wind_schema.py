"""Tables of wind: read from the study and from files beside it, refused in words."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bayeschute.study.assembly import assemble
from bayeschute.study.load import check_study, load_study
from bayeschute.study.study import study_hash

EAST = 'east = ["2 ft/s", "4 ft/s", "-6 ft/s", "-14 ft/s"]\n'
FOOT = 0.3048


def with_wind(study: Path, more: str, instead: bool = False) -> Path:
    """The study with more in its first flight's table of wind, or with a wind of this alone."""
    text = study.read_text(encoding="utf-8")
    before, after = text.split(EAST, 1)
    if instead:
        before = before[: before.index('altitude = ["0 ft", "2000 ft"')]
    study.write_text(before + ("" if instead else EAST) + more + after, encoding="utf-8")
    return study


def uncommented(text: str, header: str) -> str:
    """An example of a template: its commented lines from a header to the next that isn't one of keys."""
    lines = text.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith(f"# {header}"))
    last = first + 1
    while lines[last].startswith("# ") and lines[last][2:].split(" = ")[0].replace("_", "").isalpha():
        last += 1
    return "".join(f"{line[2:]}\n" for line in lines[first:last])


def told(study: Path) -> str:
    return "\n".join(map(str, check_study(study)))


def test_the_examples_of_the_template_are_sound(cluster: Path):
    text = cluster.read_text(encoding="utf-8")
    parts = [f"[[flight.virtual.wind.{part}]]" for part in ("layer", "gust")] + ["[flight.virtual.wind.history]"]
    (cluster.parent / "wind.csv").write_text("t,w_n\n0,1.0\n60,3.0\n120,-2\n", encoding="utf-8")
    (cluster.parent / "balloon.csv").write_text("h,w_n,w_e\n8000,10,2\n4000,5,1\n0,0,-1\n", encoding="utf-8")
    whole = with_wind(cluster, "every_body = true\n" + "".join(uncommented(text, part) for part in parts))
    drop = assemble.drop(load_study(whole).flights[0].virtual)
    assert drop.every_body and drop.history is not None and len(drop.gusts) == len(drop.wind.layers) == 1
    np.testing.assert_allclose(drop.history.at(np.array([30.0])), [[2.0 * FOOT, 0.0, 0.0]])
    below, above = (drop.wind.at(np.array([5500.0 * FOOT + side]))[0, 0] for side in (-16.0, 16.0))
    assert below - above == pytest.approx(10.0 * FOOT - 32.0 / (4000.0 * FOOT) * 4.0 * FOOT)
    cluster.write_text(text, encoding="utf-8")
    profile = with_wind(cluster, uncommented(text, "[flight.virtual.wind.profile]"), instead=True)
    wind = assemble.drop(load_study(profile).flights[0].virtual).wind
    np.testing.assert_allclose(wind.at(np.array([2000.0 * FOOT])), [[2.5 * FOOT, 0.0, 0.0]], atol=1e-12)


def test_a_wind_of_files_belongs_to_the_study_s_identity(cluster: Path):
    more = '[flight.virtual.wind.history]\nfile = "w.csv"\ntime = { column = "t", unit = "s" }\ndown = { column = "w", unit = "m/s" }\n'
    with_wind(cluster, more)
    found = []
    for value in (1.0, 2.0):
        (cluster.parent / "w.csv").write_text(f"t,w\n0,{value}\n9,0\n", encoding="utf-8")
        found.append(study_hash(load_study(cluster)))
    assert found[0] != found[1]


HISTORY = '[flight.virtual.wind.history]\nfile = "{file}"\ntime = {{ column = "t", unit = "{s}" }}\nnorth = {{ column = "w", unit = "{u}" }}\n'
FAULTS = [
    ("t,w\n0,1\n1,2\n", {"file": "other.csv"}, "no such file"),
    ("t,w\n0,1\n1,2\n", {"s": "m"}, "convertible to s"),
    ("t,w\n0,1\n1,2\n", {"u": "ft"}, "convertible to m/s"),
    ("t,w\n0,1\n0,2\n", {}, "times that increase"),
    ("t,w\n0,1\n1,\n", {}, "no number in row 3"),
    ("t,v\n0,1\n1,2\n", {}, "no such column"),
    ("t,w\n0,1\n1,2000\n", {}, "winds up to 500 m/s"),
    ("t,w\n", {}, "rows"),
]


@pytest.mark.parametrize(("content", "change", "words"), FAULTS)
def test_files_that_can_t_be_used_are_refused(cluster: Path, content: str, change: dict[str, str], words: str):
    (cluster.parent / "w.csv").write_text(content, encoding="utf-8")
    with_wind(cluster, HISTORY.format(**({"file": "w.csv", "s": "s", "u": "m/s"} | change)))
    said = told(cluster)
    assert words in said and "[flight.virtual.wind] history" in said


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("down = []\n", "altitude and down of 4 and 0 values"),
        ("every_body = 1\n", "every_body"),
        ('[[flight.virtual.wind.layer]]\nmiddle = "1 km"\nthickness = "0 m"\n', "thickness"),
        ('[[flight.virtual.wind.gust]]\nstart = "-1 s"\nduration = "1 s"\n', "start"),
        ('[flight.virtual.wind.profile]\nfile = "b.csv"\naltitude = { column = "h", unit = "m" }\neast = { column = "e", unit = "m/s" }\n', "both"),
        ('[flight.virtual.wind.history]\nfile = "b.csv"\ntime = { column = "h", unit = "s" }\n', "a column of the wind"),
        ('[flight.virtual.wind.history]\nfile = "b.csv"\ntime = { column = "h", unit = "s" }\nsamples = [[1.0]]\n', "samples"),
    ],
)  # fmt: skip
def test_tables_that_say_too_little_or_too_much_are_refused(cluster: Path, more: str, words: str):
    (cluster.parent / "b.csv").write_text("h,e\n0,1\n1,2\n", encoding="utf-8")
    with_wind(cluster, more)
    assert words in told(cluster)


def test_no_wind_at_all_is_refused(cluster: Path):
    with_wind(cluster, "", instead=True)
    assert "no wind" in told(cluster)


PROFILE = '\n[flight.wind_profile]\naltitude = ["0 m", "1 km"]\nnorth = ["1 m/s", "3 m/s"]\neast = ["0 m/s", "0 m/s"]\n'


def with_profile(study: Path, table: str = PROFILE) -> Path:
    text = study.read_text(encoding="utf-8")
    study.write_text(text.replace("\n[structure]", f"{table}\n[structure]", 1), encoding="utf-8")
    return study


def test_a_flight_s_profile_is_read(cluster: Path):
    table = load_study(with_profile(cluster)).flights[1].wind_profile
    assert table is not None and table.north == (1.0, 3.0) and table.altitude == (0.0, 1000.0)


def test_a_flight_s_profile_says_something(cluster: Path):
    assert "no wind" in told(with_profile(cluster, "\n[flight.wind_profile]\n"))


def test_a_descent_has_no_use_for_a_profile(descent: Path, spoil):
    table = 'wind_profile = { altitude = ["0 m"], north = ["1 m/s"], east = ["0 m/s"] }'
    spoil(descent, r"^\[\[flight\]\].*$", f"[[flight]]\n{table}")
    assert "'wind_profile', which the model 'descent' has no use for" in told(descent)
