"""benchmarks/other_programs.py without the other programs: its loads, its aircraft, and what it says of an answer."""

from __future__ import annotations

import sys
from xml.etree import ElementTree

import numpy as np
import other_programs as other
import pytest
from tests.landing.other_programs.test_jsbsim_aerodynamics import Section, properties
from tests.landing.plans import small_plan

from bayeschute.atmosphere.standard import standard_density
from bayeschute.landing.aero_table import ANGLES
from bayeschute.landing.other_programs.jsbsim_aerodynamics import FOOT
from bayeschute.landing.other_programs.steady_cluster import steady_clusters


@pytest.fixture(scope="module")
def plan():
    return small_plan()


@pytest.fixture(scope="module")
def steady(plan):
    return steady_clusters(plan.models)


@pytest.fixture(scope="module")
def written(plan, steady, tmp_path_factory):
    folder = tmp_path_factory.mktemp("written")
    return folder, other.prepare(plan, steady, folder)


def agreeing(plan, steady):
    """An answer as the programs would give it."""
    at = other.states()
    loads = other.mean_loads(plan, steady, at, ANGLES)
    rates = [[other.fell(steady, d, float(standard_density(h))) for h in (*other.ALTITUDES, 0.0)] for d in other.DRAWS]
    flights = [
        [[0.0, other.RELEASE, 0.0], [other.SOON, other.RELEASE - 0.1, other.soon(steady)],
         *([100.0 + i, h, v] for i, (h, v) in enumerate(zip((*other.ALTITUDES, 0.0), own, strict=True)))]
        for own in rates
    ]  # fmt: skip
    chutes = np.stack([steady.drag_area, steady.enclosed_volume], axis=1).tolist()
    return {
        "versions": {}, "forces": np.concatenate([[standard_density(at[:, 6])], *loads]).T.tolist(),
        "descents": [own[:2] for own in rates], "free": [9.0, 9.0], "flights": flights,
        "parachutes": {"draws": chutes, "picked": chutes, "rocket": chutes[:1]},
    }  # fmt: skip


def test_loads_are_those_of_the_written_file(plan, steady, written):
    """Of some states, by a reader of the file that knows nothing of the formulas."""
    folder, asked = written
    at = other.states()[::37]
    force, moment = other.mean_loads(plan, steady, at, ANGLES)
    for i, (angle, azimuth, speed, *rates, altitude) in enumerate(at):
        along = [np.cos(angle), np.sin(angle) * np.sin(azimuth), np.sin(angle) * np.cos(azimuth)]
        known = properties(speed * np.array(along), rates, other.TO_CANOPIES, float(standard_density(altitude)))
        axial, side, normal = Section(folder / "aircraft/forces" / other.JSBSIM, known).forces()
        np.testing.assert_allclose(force[:, i], [-axial, side, -normal], rtol=1e-6, atol=1e-3)
        np.testing.assert_allclose(moment[:, i], np.cross(other.TO_CANOPIES, force[:, i]), rtol=1e-12)
    assert asked["states"] == other.states().tolist()


def test_aircraft(steady, written):
    folder, asked = written
    assert asked["descents_of"] == ["mean", "draw-0", "draw-1"]
    root = ElementTree.parse(folder / "aircraft/draw-1/draw-1.xml").getroot()
    there = root.find("metrics/location")
    assert float(there.find("x").text) == pytest.approx(steady.reach[1] / FOOT)
    assert float(root.find("mass_balance/emptywt").text) == pytest.approx(steady.mass[1] / other.POUND)
    section = folder / "aircraft/draw-1" / root.find("aerodynamics").get("file")
    names = [f.get("name") for f in ElementTree.parse(section).find("axis").findall("function")]
    assert names == ["aero/force/canopies-axial-lbs", "aero/force/capsule-axial-lbs"]


def test_an_answer_that_agrees(plan, steady, written):
    rows = other.compare(plan, steady, written[0], agreeing(plan, steady))
    assert [row.quantity for row in rows if not row.agrees] == []
    assert all("MORE" not in line for line in other.lines(rows))


@pytest.mark.parametrize(
    ("key", "which", "factor", "said"),
    [
        ("forces", (slice(None), 2), 1.02, "force along body y"),
        ("forces", (5, 6), 1.1, "moment about body z"),
        ("descents", (1, 0), 1.01, "JSBSim: descent rate of the draw 0 at 1000 m"),
        ("descents", (2, 1), np.nan, "JSBSim: descent rate of the draw 1 at 100 m"),
        ("flights", (0, 1, 2), 1.02, "speed of the mean 0.5 s after rest"),
        ("flights", (0, -1, 2), 0.99, "RocketPy: descent rate of the mean at sea level"),
    ],
)
def test_an_answer_that_does_not(plan, steady, written, key, which, factor, said):
    answer = agreeing(plan, steady)
    values = np.array(answer[key])
    values[which] *= factor
    answer[key] = values.tolist()
    off = [row for row in other.compare(plan, steady, written[0], answer) if not row.agrees]
    assert off and all(said in row.quantity for row in off)
    assert all("MORE" in line for line in list(other.lines(off))[1:])


def test_a_parachute_that_is_no_draw(plan, steady, written):
    answer = agreeing(plan, steady)
    answer["parachutes"]["picked"] = [[1.3 * steady.drag_area.max(), steady.enclosed_volume.mean()]]
    answer["parachutes"]["draws"] = answer["parachutes"]["draws"][1:]
    off = [row.quantity for row in other.compare(plan, steady, written[0], answer) if not row.agrees]
    assert off == [
        "RocketPy: cd_s of all draws", "RocketPy: air enclosed, of all draws", "RocketPy: cd_s picked by stochastic, 1",
    ]  # fmt: skip


def test_ratios():
    row = other.Row("drag", "N", [1.0, 2.0], [1.1, 2.2])
    assert row.ratio == pytest.approx(1.1) and row.off == pytest.approx(0.2 / np.sqrt(2.5)) and not row.agrees
    assert other.Row("drag", "N", 3.0, 3.0).agrees and not other.Row("drag", "N", 3.0, np.nan).agrees


def test_a_probe_that_fails_is_told(tmp_path):
    with pytest.raises(SystemExit, match="other_programs_probe.py in .* failed:\n(?s:.*)No module named"):
        other.asked(sys.executable, {"folder": str(tmp_path)}, tmp_path)
