"""An ``<aerodynamics>`` section for JSBSim: force of the canopies as tables over the total angle of attack.

Format, properties and axes are those of JSBSim's reference manual and of its classes FGAerodynamics, FGFunction and
FGTable. Forces are AXIAL (aft), SIDE (right) and NORMAL (up), in pounds; JSBSim lets them act at the aerodynamic
reference point (AERORP) and holds a table's last value beyond its ends. JSBSim's body x axis points forward: from the
canopies to the capsule, which is the axis of a canopy here. With u, v, w the velocity of the reference point through
the air, which is that of the centre of gravity and omega x the way from there, and V its size,

    alpha_T = atan2(sqrt(v^2 + w^2), u)
    AXIAL   =  rho/2 V^2 S C_A
    SIDE    = -rho/2 V^2 S (C_N v/sqrt(v^2 + w^2) - C_N_rate r l/(2V))
    NORMAL  =  rho/2 V^2 S (C_N w/sqrt(v^2 + w^2) + C_N_rate q l/(2V))
"""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.files import write_whole
from bayeschute.core.version import __version__

Array = NDArray[np.float64]
FOOT = 0.3048
_NO_TEXT = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # what XML 1.0 can't hold
_OF = "aero/canopies/"
_TABLES = {
    "axial-coefficient": "C_A of all canopies together",
    "normal-coefficient": "C_N of all canopies together, restoring positive",
    "rate-coefficient": "derivative of C_N by the rate of the angle of attack times l/(2V), damping positive",
}
_COMMENT = """
  Include it in an aircraft by <aerodynamics file="THIS FILE"/>. The capsule's own forces are not here. An aircraft has
  one such section, all of whose forces act at AERORP: add the capsule's drag along x to the AXIAL element, and put what
  acts across x into external_reactions, where a force has a location of its own, or add the moment that it lacks.

  Axes: body x points forward, from the canopies to the capsule; in a steady descent it points down. AXIAL acts aft
  along it, SIDE along y, NORMAL against z. Angles of attack are total, off the x axis, to any side [deg]; beyond the
  last row JSBSim holds that row's value. Area [ft^2], length [ft], forces [lbf].

  Forces act at AERORP, and the airflow is taken there, with the body's rates. Put it where the canopies are:
  {reach:.6g} ft from the riser attach point of the capsule, aft along x. Mass and inertia of the section mass_balance
  are those of capsule and canopies together ({weight:.8g} lb with dry canopies).

  What one rigid body can't hold: canopies that swing about their risers, against each other and against the capsule,
  and move apart and together (here they stand {flyout:.4g} deg off the axis for good); {enclosed:.6g} ft^3 of air that
  moves with them, as inertia without weight; gusts and breathing that were inferred as unexplained; differences
  between canopies. The body swings as a pendulum as a whole.
"""


def aerodynamics(
    name: str, said: str, angles: Array, coefficients: Array, area: float, length: float, notes: dict[str, float]
) -> ElementTree.ElementTree:
    """The section as a tree.

    Args:
        name: Of the canopies; any characters.
        said: What the coefficients are, such as ``posterior mean``.
        angles: Total angles of attack (A,), rising [rad].
        coefficients: C_A, C_N and C_N_rate (3, A) of `cluster_coefficients` [1].
        area: Reference area of all canopies [m^2].
        length: Reference length [m].
        notes: For the comment: ``reach`` [m], ``mass`` [kg], ``flyout`` [rad], ``enclosed_volume`` [m^3].
    """
    root = ElementTree.Element("aerodynamics", name=_NO_TEXT.sub("\N{REPLACEMENT CHARACTER}", name))
    told = _COMMENT.format(
        reach=notes["reach"] / FOOT, weight=notes["mass"] / 0.45359237, flyout=np.rad2deg(notes["flyout"]),
        enclosed=notes["enclosed_volume"] / FOOT**3,
    )  # fmt: skip
    root.append(ElementTree.Comment(told))
    by = f"{said}; canopies of {name} by bayeschute {__version__}"
    ElementTree.SubElement(root, "documentation").text = _NO_TEXT.sub("\N{REPLACEMENT CHARACTER}", by)
    _airflow(root)
    for (key, words), values in zip(_TABLES.items(), coefficients, strict=True):
        _table(_function(root, _OF + key, words), angles, values)
    reference = _function(root, f"{_OF}force-lbs", "dynamic pressure at the canopies times their area")
    product = ElementTree.SubElement(reference, "product")
    _leaves(product, 0.5, "atmosphere/rho-slugs_ft3", f"{_OF}speed-fps", f"{_OF}speed-fps", area / FOOT**2)
    scale = _function(root, f"{_OF}rate-factor-sec", "l/(2V)")
    quotient = ElementTree.SubElement(scale, "quotient")
    _leaves(quotient, 0.5 * length / FOOT)
    _leaves(ElementTree.SubElement(quotient, "max"), f"{_OF}speed-fps", 1e-6)
    axial = ElementTree.SubElement(_axis(root, "AXIAL"), "product")
    _leaves(axial, f"{_OF}force-lbs", f"{_OF}axial-coefficient")
    for axis, lateral, rate, sign in (
        ("SIDE", "v", "velocities/r-aero-rad_sec", -1.0),
        ("NORMAL", "w", "velocities/q-aero-rad_sec", 1.0),
    ):
        product = ElementTree.SubElement(_axis(root, axis), "product")
        _leaves(product, f"{_OF}force-lbs")
        total = ElementTree.SubElement(product, "sum")
        normal = ElementTree.SubElement(total, "product")
        _leaves(normal, sign, f"{_OF}normal-coefficient")
        share = ElementTree.SubElement(normal, "quotient")
        _leaves(share, f"{_OF}{lateral}-fps")
        _leaves(ElementTree.SubElement(share, "max"), f"{_OF}lateral-fps", 1e-6)
        _leaves(ElementTree.SubElement(total, "product"), f"{_OF}rate-coefficient", f"{_OF}rate-factor-sec", rate)
    ElementTree.indent(root)
    return ElementTree.ElementTree(root)


def write(tree: ElementTree.ElementTree, path: Path) -> None:
    """Write a section as a file of its own, UTF-8."""
    write_whole(path, lambda part: tree.write(part, encoding="UTF-8", xml_declaration=True))


def _airflow(root: ElementTree.Element) -> None:
    """Velocity of the reference point through the air, its size, and the total angle of attack."""
    for axis, sign in (("x", -1.0), ("y", 1.0), ("z", -1.0)):  # JSBSim's structural frame has x aft, z up
        way = _function(root, f"{_OF}to-{axis}-ft", f"from the centre of gravity to AERORP, along body {axis}")
        quotient = ElementTree.SubElement(way, "quotient")
        difference = ElementTree.SubElement(quotient, "difference")
        _leaves(difference, f"metrics/aero-rp-{axis}-in", f"inertia/cg-{axis}-in")
        _leaves(quotient, sign * 12.0)
    for axis, (first, to_first), (second, to_second) in (
        ("u", ("q", "z"), ("r", "y")),
        ("v", ("r", "x"), ("p", "z")),
        ("w", ("p", "y"), ("q", "x")),
    ):
        there = _function(root, f"{_OF}{axis}-fps", f"velocity of AERORP through the air, {axis}")
        total = ElementTree.SubElement(there, "sum")
        _leaves(total, f"velocities/{axis}-aero-fps")
        for sign, rate, to in ((1.0, first, to_first), (-1.0, second, to_second)):
            product = ElementTree.SubElement(total, "product")
            _leaves(product, sign, f"velocities/{rate}-aero-rad_sec", f"{_OF}to-{to}-ft")
    _length(_function(root, f"{_OF}lateral-fps", "its part across the axis"), f"{_OF}v-fps", f"{_OF}w-fps")
    _length(_function(root, f"{_OF}speed-fps", "its size"), f"{_OF}u-fps", f"{_OF}lateral-fps")
    angle = _function(root, f"{_OF}alpha-total-deg", "total angle of attack")
    _leaves(
        ElementTree.SubElement(ElementTree.SubElement(angle, "todegrees"), "atan2"),
        f"{_OF}lateral-fps",
        f"{_OF}u-fps",
    )


def _function(parent: ElementTree.Element, name: str, words: str) -> ElementTree.Element:
    made = ElementTree.SubElement(parent, "function", name=name)
    ElementTree.SubElement(made, "description").text = words
    return made


def _axis(root: ElementTree.Element, name: str) -> ElementTree.Element:
    axis = ElementTree.SubElement(root, "axis", name=name)
    return _function(axis, f"aero/force/canopies-{name.lower()}-lbs", f"{name} force of all canopies")


def _leaves(parent: ElementTree.Element, *said: str | float) -> None:
    """Properties by name and values, in this order."""
    for one in said:
        ElementTree.SubElement(parent, "property" if isinstance(one, str) else "value").text = (
            one if isinstance(one, str) else repr(float(one))
        )


def _length(parent: ElementTree.Element, *parts: str) -> None:
    total = ElementTree.SubElement(ElementTree.SubElement(parent, "sqrt"), "sum")
    for part in parts:
        _leaves(ElementTree.SubElement(total, "product"), part, part)


def _table(parent: ElementTree.Element, angles: Array, values: Array) -> None:
    table = ElementTree.SubElement(parent, "table")
    ElementTree.SubElement(table, "independentVar", lookup="row").text = f"{_OF}alpha-total-deg"
    rows = "\n".join(f"        {a:.12g}  {v:.12g}" for a, v in zip(np.rad2deg(angles), values, strict=True))
    ElementTree.SubElement(table, "tableData").text = f"\n{rows}\n      "
