"""JSBSim's section: read back as JSBSim evaluates it, against the simulator's forces; names that are hostile to XML."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from bayeschute.landing.other_programs.jsbsim_aerodynamics import FOOT, aerodynamics, write
from bayeschute.landing.other_programs.steady_cluster import cluster_coefficients

ANGLES = np.deg2rad(np.arange(0.0, 41.0, 2.0))
NOTES = {"reach": 70.0, "mass": 9761.0, "flyout": 0.2, "enclosed_volume": 8000.0}
POUND, SLUG_PER_CUBIC_FOOT = 4.4482216152605, 515.3788183931961
AREA, LENGTH = 981.0, 35.0


class Section:
    """Values of a section as JSBSim has them: functions in the order of the file, tables linear and held at the ends."""

    def __init__(self, path, properties):
        self.root, self.known = ElementTree.parse(path).getroot(), dict(properties)
        for function in self.root.findall("function"):
            self.known[function.get("name")] = self.value(self.operation(function))

    @staticmethod
    def operation(function):
        (one,) = [child for child in function if child.tag != "description"]
        return one

    def value(self, node):
        if node.tag == "value":
            return float(node.text)
        if node.tag == "property":
            return self.known[node.text]
        if node.tag == "table":
            keys, values = np.array([line.split() for line in node.find("tableData").text.split("\n")[1:-1]], float).T
            assert (np.diff(keys) > 0.0).all()
            return float(np.interp(self.known[node.find("independentVar").text], keys, values))
        parts = [self.value(child) for child in node]
        by = {
            "product": math.prod, "sum": sum, "sqrt": lambda p: math.sqrt(*p), "max": max,
            "difference": lambda p: p[0] - sum(p[1:]), "quotient": lambda p: p[0] / p[1],
            "todegrees": lambda p: math.degrees(*p), "atan2": lambda p: math.atan2(*p),
        }  # fmt: skip
        return by[node.tag](parts)

    def forces(self):
        """Axial, side and normal force [N]."""
        found = {a.get("name"): self.value(self.operation(a.find("function"))) for a in self.root.findall("axis")}
        return np.array([found[name] * POUND for name in ("AXIAL", "SIDE", "NORMAL")])


def properties(velocity, rates=(0.0, 0.0, 0.0), to=(0.0, 0.0, 0.0), density=1.225):
    """What JSBSim knows of a body: velocity through the air (3,) [m/s], rates (3,) [rad/s], way from CG to AERORP [m].

    Its structural frame has x aft, y right, z up; body axes x forward, y right, z down.
    """
    inches = np.array([-1.0, 1.0, -1.0]) * to / FOOT * 12.0
    centre = np.array([100.0, 3.0, -7.0])
    said = {"atmosphere/rho-slugs_ft3": density / SLUG_PER_CUBIC_FOOT}
    for i, axis in enumerate("xyz"):
        said[f"inertia/cg-{axis}-in"], said[f"metrics/aero-rp-{axis}-in"] = centre[i], centre[i] + inches[i]
        said[f"velocities/{'uvw'[i]}-aero-fps"] = velocity[i] / FOOT
        said[f"velocities/{'pqr'[i]}-aero-rad_sec"] = rates[i]
    return said


def written(tmp_path, coefficients, angles=ANGLES, name="canopies"):
    path = tmp_path / "c.xml"
    write(aerodynamics(name, "a draw", angles, coefficients, AREA, LENGTH, NOTES), path)
    return path


def test_a_closed_form(tmp_path):
    """C_A = 0.9, C_N = sin(alpha), no damping: forces by hand."""
    path = written(tmp_path, np.array([0.9 + 0.0 * ANGLES, np.sin(ANGLES), 0.0 * ANGLES]))
    alpha, side = np.deg2rad(12.0), np.deg2rad(30.0)
    velocity = 10.0 * np.array([np.cos(alpha), np.sin(alpha) * np.sin(side), np.sin(alpha) * np.cos(side)])
    load = 0.5 * 1.225 * 100.0 * AREA
    want = load * np.array([0.9, -np.sin(alpha) * np.sin(side), np.sin(alpha) * np.cos(side)])
    np.testing.assert_allclose(Section(path, properties(velocity)).forces(), want, rtol=1e-9)


def test_at_rest_and_on_the_axis_there_is_no_side_force(tmp_path):
    path = written(tmp_path, np.array([1.0 + 0.0 * ANGLES, np.sin(ANGLES), 0.0 * ANGLES]))
    np.testing.assert_allclose(Section(path, properties((0.0, 0.0, 0.0))).forces(), 0.0, atol=1e-12)
    np.testing.assert_allclose(Section(path, properties((8.0, 0.0, 0.0))).forces()[1:], 0.0, atol=1e-9)


@pytest.mark.parametrize(("q", "r"), [(0.05, 0.0), (0.0, 0.05), (0.03, -0.04)])
def test_turning_is_damped_and_moves_the_canopies(tmp_path, q, r):
    """Airflow is taken at AERORP, omega x arm away, and a rate of the axis has a force of its own."""
    slope, damping, arm, speed = 0.4, 0.3, 80.0, 10.0
    path = written(tmp_path, np.array([1.0 + 0.0 * ANGLES, slope * ANGLES, damping + 0.0 * ANGLES]))
    at_canopies = np.cross([0.0, q, r], [-arm, 0.0, 0.0]) + [speed, 0.0, 0.0]
    lateral, V = np.hypot(*at_canopies[1:]), np.linalg.norm(at_canopies)
    load, alpha = 0.5 * 1.225 * V**2 * AREA, np.arctan2(lateral, speed)
    y = -slope * alpha * at_canopies[1] / lateral + damping * r * LENGTH / (2.0 * V)
    z = -slope * alpha * at_canopies[2] / lateral - damping * q * LENGTH / (2.0 * V)
    made = Section(path, properties((speed, 0.0, 0.0), (0.0, q, r), (-arm, 0.0, 0.0))).forces()
    np.testing.assert_allclose(made, load * np.array([1.0, y, -z]), rtol=1e-9)
    moment = np.cross([-arm, 0.0, 0.0], [-made[0], made[1], -made[2]])
    assert moment[1] * q + moment[2] * r < 0.0  # both parts oppose the turning


def test_the_airflow_is_that_of_the_reference_point_wherever_it_is(tmp_path):
    """Off the axis through the centre of gravity, too: omega x the way from there."""
    path = written(tmp_path, np.zeros((3, ANGLES.size)))
    velocity, rates, to = np.array([9.0, 0.4, -0.7]), np.array([0.3, -0.05, 0.08]), np.array([-70.0, 0.5, -1.5])
    known = Section(path, properties(velocity, rates, to)).known
    made = [known[f"aero/canopies/{axis}-fps"] * FOOT for axis in "uvw"]
    want = velocity + np.cross(rates, to)
    np.testing.assert_allclose(made, want, rtol=1e-12)
    assert known["aero/canopies/speed-fps"] * FOOT == pytest.approx(np.linalg.norm(want), rel=1e-12)
    alpha = np.rad2deg(np.arctan2(np.hypot(*want[1:]), want[0]))
    assert known["aero/canopies/alpha-total-deg"] == pytest.approx(alpha, rel=1e-12)


def test_tables_are_read_back(plan, tmp_path):
    """Between rows 2 deg apart the table is within 1e-3 of the curve; beyond the last it keeps that value."""
    one, still = plan.models[0], (np.zeros(12), np.full(12, 9.0))
    made = cluster_coefficients(one, *still, ANGLES)[:, :, 3]
    fine = np.deg2rad(np.arange(0.5, 40.0, 1.0))
    want = cluster_coefficients(one, *still, fine)[:, :, 3]
    path = written(tmp_path, made)
    for i, angle in enumerate(fine):
        known = Section(path, properties(9.0 * np.array([np.cos(angle), 0.0, np.sin(angle)]))).known
        got = [known[f"aero/canopies/{key}-coefficient"] for key in ("axial", "normal", "rate")]
        np.testing.assert_allclose(got, want[:, i], atol=1e-3)
    far = Section(path, properties((0.0, 0.0, 9.0))).known
    assert far["aero/canopies/alpha-total-deg"] == pytest.approx(90.0)
    assert far["aero/canopies/axial-coefficient"] == pytest.approx(made[0, -1])


def test_functions_come_before_what_needs_them(tmp_path):
    """JSBSim's tables bind to a property when they are read; `Section` would not find one that comes later."""
    path = written(tmp_path, np.zeros((3, ANGLES.size)))
    known = set(properties((9.0, 0.0, 0.0)))
    names = [f.get("name") for f in ElementTree.parse(path).iter("function")]
    assert len(names) == len(set(names))
    for function in ElementTree.parse(path).iter("function"):
        used = {n.text for n in function.iter() if n.tag in ("property", "independentVar")}
        assert used <= known, function.get("name")
        known.add(function.get("name"))


@pytest.mark.parametrize(
    "name", ["<a> & \"b\" 'c'", "two -- dashes -->", "]]>", "bell \x07 and \ud800", "Schirm \u00fc"]
)
def test_hostile_names(tmp_path, name):
    path = written(tmp_path, np.zeros((3, ANGLES.size)), name=name)
    root = ElementTree.parse(path).getroot()
    assert root.get("name") == re.sub("[\x07\ud800]", "\ufffd", name)
    assert [axis.get("name") for axis in root.findall("axis")] == ["AXIAL", "SIDE", "NORMAL"]
    comment = re.search("<!--(.*?)-->", path.read_text(encoding="utf-8"), re.DOTALL)[1]
    assert "--" not in comment and "rigid body can't hold" in comment and "229.659 ft" in comment
