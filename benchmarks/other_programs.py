"""What `bayeschute land` writes for JSBSim and RocketPy, run in both programs and compared with the product's formulas.

    python benchmarks/other_programs.py POSTERIOR_OR_RUN [--python PYTHON] [--packages NAME==VERSION ...] [--json]

JSBSim: forces and moments of the mean over angles of attack to all sides, rates and altitudes, with a centre of gravity
off the axis, against `cluster_coefficients`; descents of the mean and of two draws, held upright, against the steady
speed at the local density. RocketPy: descents that open at once, from rest, and the parachutes of all draws and of
``stochastic``. PYTHON is an interpreter that has both programs; without one an environment is made by venv and pip in a
temporary folder. Exit 1 if anything is off by more than its tolerance: 1e-4 where both take the same formula and rows,
1e-2 where ours has finer rows than the file, which JSBSim joins by lines, 5e-3 for descents, whose air gets denser. Of
a list of values, "off" is the largest difference over the root mean square of ours.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from command import parser_of, print_result
from numpy.typing import ArrayLike, NDArray

import bayeschute as bc
from bayeschute.api.landing.landing_verb import source_of
from bayeschute.api.landing.other_programs_files import JSBSIM, write_other_programs
from bayeschute.atmosphere.standard import STANDARD_GRAVITY, standard_density
from bayeschute.landing.aero_table import ANGLES
from bayeschute.landing.campaign_plan import CampaignPlan
from bayeschute.landing.other_programs.jsbsim_aerodynamics import FOOT
from bayeschute.landing.other_programs.rocketpy_parachutes import DATA
from bayeschute.landing.other_programs.steady_cluster import SteadyCluster, cluster_coefficients, steady_clusters
from bayeschute.study.landing_campaign.campaign_file import load_campaign

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[1]
CAMPAIGN = ROOT / "models" / "campaigns" / "cdt-3-11-landing.toml"
PACKAGES = ("jsbsim==1.3.3", "rocketpy==1.13.0")
SAME, BETWEEN_ROWS, DESCENT = 1e-4, 1e-2, 5e-3  # tolerances
DRAWS = (None, 0, 1)
FINER = np.deg2rad(np.arange(0.0, 40.25, 0.5))
RELEASE, ALTITUDES = 1500.0, (1000.0, 100.0)  # [m]
TO_CANOPIES = np.array([-60.0, 0.3, -0.5])  # [m], from the centre of gravity to AERORP, body axes, for the forces
SOON = 0.5  # [s] after release from rest, while most of the weight still accelerates the enclosed air
POUND = 0.45359237
AIRCRAFT = """<?xml version="1.0"?>
<fdm_config name="{name}" version="2.0" release="ALPHA">
  <fileheader><author>bayeschute</author><description>capsule and canopies as one body</description></fileheader>
  <metrics>
    <wingarea unit="FT2">1</wingarea><wingspan unit="FT">1</wingspan><chord unit="FT">1</chord>
    <location name="AERORP" unit="FT"><x>{x!r}</x><y>{y!r}</y><z>{z!r}</z></location>
  </metrics>
  <mass_balance>
    <ixx unit="SLUG*FT2">1e5</ixx><iyy unit="SLUG*FT2">5e6</iyy><izz unit="SLUG*FT2">5e6</izz>
    <emptywt unit="LBS">{weight!r}</emptywt>
    <location name="CG" unit="FT"><x>0</x><y>0</y><z>0</z></location>
  </mass_balance>
  <ground_reactions/>
  <propulsion/>
  <flight_control name="none"/>
  <aerodynamics file="{file}"/>
</fdm_config>
"""


class Row(NamedTuple):
    """A quantity by both, single values or lists in the same order."""

    quantity: str
    unit: str
    ours: ArrayLike
    theirs: ArrayLike
    within: float = SAME

    @property
    def ratio(self) -> float:
        """Theirs over ours; of lists, of the best line through zero."""
        ours, theirs = np.ravel(self.ours), np.ravel(self.theirs)
        return float(ours @ theirs / (ours @ ours)) if ours.shape == theirs.shape else np.nan

    @property
    def off(self) -> float:
        """The largest difference over the root mean square of ours; NaN where one has no value for the other."""
        ours, theirs = np.ravel(self.ours), np.ravel(self.theirs)
        if ours.shape != theirs.shape:
            return np.nan
        return float(np.abs(theirs - ours).max() / np.sqrt(np.mean(np.square(ours))))

    @property
    def agrees(self) -> bool:
        """Whether it is within the tolerance."""
        return self.off <= self.within


def lines(rows: Sequence[Row]) -> Iterator[str]:
    """The table; of lists the root mean squares are shown."""
    yield f"{'quantity':58} {'unit':7} {'ours':>11} {'theirs':>11} {'ratio':>8} {'off':>8} {'within':>7}"
    for row in rows:
        ours, theirs = (float(np.sqrt(np.mean(np.square(v)))) for v in (row.ours, row.theirs))
        end = f"{row.off:8.1e} {row.within:7g}" + ("" if row.agrees else "  MORE")
        yield f"{row.quantity:58} {row.unit:7} {ours:11.5g} {theirs:11.5g} {row.ratio:8.5f} {end}"


def states() -> Array:
    """Angle, azimuth [rad], speed [m/s], p, q, r [rad/s] and altitude [m] of all states (N, 7)."""
    angles, azimuths = (
        np.deg2rad([0.0, 3.0, 7.0, 15.0, 25.0, 33.0, 39.0, 50.0, 60.0]),
        np.deg2rad([0, 70, 160, 250, 300]),
    )
    rates = ((0.0, 0.0, 0.0), (0.3, 0.05, 0.0), (-0.2, 0.0, 0.04), (0.0, -0.03, 0.05))
    grid = product(angles, azimuths, (7.0, 12.0), rates, (0.0, 3000.0))
    return np.array([(a, b, speed, *rate, h) for a, b, speed, rate, h in grid])


def loads(at: Array, angles: Array, coefficients: Array, area: float, length: float) -> tuple[Array, Array]:
    """Forces along and moments about body axes (3, N) [N, N m] of states: docs/landing.md's formulas.

    Args:
        at: States (N, 7).
        angles: Of the coefficients (A,) [rad].
        coefficients: C_A, C_N, C_N_rate (3, A); beyond the last row of the file they are those of that row.
        area: [m^2].
        length: [m].
    """
    alpha, azimuth, speed, altitude = at[:, 0], at[:, 1], at[:, 2], at[:, 6]
    side = np.array([0.0 * alpha, np.sin(azimuth), np.cos(azimuth)])
    centre = speed * np.stack([np.cos(alpha), *(np.sin(alpha) * side[1:])])
    velocity = centre + np.cross(at[:, 3:6], TO_CANOPIES).T
    lateral, size = np.hypot(velocity[1], velocity[2]), np.linalg.norm(velocity, axis=0)
    total = np.minimum(np.arctan2(lateral, velocity[0]), ANGLES[-1])
    axial, normal, rate = (np.interp(total, angles, c) for c in coefficients)
    load = 0.5 * standard_density(altitude) * size**2 * area
    share, half = velocity[1:] / np.maximum(lateral, 1e-12), 0.5 * length / size
    y, z = -normal * share[0] + rate * at[:, 5] * half, -normal * share[1] - rate * at[:, 4] * half
    force = load * np.stack([-axial, y, z])
    return force, np.cross(TO_CANOPIES, force.T).T


def mean_loads(plan: CampaignPlan, steady: SteadyCluster, at: Array, angles: Array) -> tuple[Array, Array]:
    """Loads by the mean over all draws, its coefficients taken at some angles and joined by lines."""
    parts, first = [], 0
    for one in plan.models:
        own = slice(first, first + len(one.theta))
        parts.append(cluster_coefficients(one, steady.flyout[own], steady.speed[own], angles))
        first = own.stop
    mean = np.concatenate(parts, axis=2).mean(axis=2)
    return loads(at, angles, mean, float(steady.area.mean()), float(steady.length.mean()))


def fell(steady: SteadyCluster, draw: int | None, density: float) -> float:
    """Steady descent rate of a draw, or by the mean drag area [m/s]."""
    area, mass = (float(a.mean() if draw is None else a[draw]) for a in (steady.drag_area, steady.mass))
    return float(np.sqrt(2.0 * mass * STANDARD_GRAVITY / (density * area)))


def write_aircraft(folder: Path, name: str, section: Path, to: Array, mass: float, capsule: float = 0.0) -> None:
    """An aircraft of JSBSim with the written section, and a capsule's drag area [m^2] in its AXIAL element."""
    there, (x, y, z) = folder / "aircraft" / name, np.array([-1.0, 1.0, -1.0]) * to / FOOT
    there.mkdir(parents=True)
    tree = ElementTree.parse(section)
    if capsule:
        axis = next(a for a in tree.getroot().iter("axis") if a.get("name") == "AXIAL")
        function = ElementTree.SubElement(axis, "function", name="aero/force/capsule-axial-lbs")
        drag = ElementTree.SubElement(function, "product")
        ElementTree.SubElement(drag, "property").text = "aero/qbar-psf"
        ElementTree.SubElement(drag, "value").text = repr(capsule / FOOT**2)
        tree.write(there / section.name, encoding="UTF-8", xml_declaration=True)
    else:
        (there / section.name).write_bytes(section.read_bytes())
    said = AIRCRAFT.format(name=name, x=float(x), y=float(y), z=float(z), weight=float(mass / POUND), file=section.name)
    (there / f"{name}.xml").write_text(said, encoding="utf-8")


def prepare(plan: CampaignPlan, steady: SteadyCluster, folder: Path) -> dict[str, Any]:
    """Write the files and aircraft; what the probe is asked."""
    told = write_other_programs(plan, 'canopies <of> "a benchmark" & \u00fc', folder, 2)
    if told:
        raise SystemExit("\n".join(told))
    sections = [folder / JSBSIM if d is None else folder / "jsbsim" / f"canopies-draw-{d}.xml" for d in DRAWS]
    write_aircraft(folder, "forces", sections[0], TO_CANOPIES, float(steady.mass.mean()))
    names = []
    for draw, section in zip(DRAWS, sections, strict=True):
        mass, capsule, reach = (
            float(a.mean() if draw is None else a[draw])
            for a in (steady.mass, steady.drag_area - steady.canopy_drag_area, steady.reach)
        )
        names.append("mean" if draw is None else f"draw-{draw}")
        write_aircraft(folder, names[-1], section, np.array([-reach, 0.0, 0.0]), mass, capsule)
    return {
        "folder": str(folder), "forces_of": "forces", "states": states().tolist(), "descents_of": names,
        "release": RELEASE, "altitudes": ALTITUDES, "free_altitudes": np.arange(1000.0, 99.0, -5.0).tolist(),
        "swing": 0.08, "draws": DRAWS, "picks": 200,
    }  # fmt: skip


def soon(steady: SteadyCluster) -> float:
    """Speed of the mean `SOON` after it was let go [m/s]: (m + m_a) dv/dt = m g (1 - (v/v_steady)^2)."""
    density, mass = float(standard_density(RELEASE)), float(steady.mass.mean())
    steadily, added = fell(steady, None, density), density * float(steady.enclosed_volume.mean())
    return float(steadily * np.tanh(SOON * mass * STANDARD_GRAVITY / (steadily * (mass + added))))


def compare(plan: CampaignPlan, steady: SteadyCluster, folder: Path, answer: dict[str, Any]) -> list[Row]:
    """All rows."""
    at, theirs = states(), np.array(answer["forces"]).T
    rows = [Row(f"JSBSim: density of the air, {len(at)} states", "kg/m^3", standard_density(at[:, 6]), theirs[0])]
    for where, angles, within in (("", ANGLES, SAME), (", by finer rows", FINER, BETWEEN_ROWS)):
        force, moment = mean_loads(plan, steady, at, angles)
        for words, unit, ours, got in (
            ("force along", "N", force, theirs[1:4]),
            ("moment about", "N m", moment, theirs[4:]),
        ):
            named = [f"JSBSim: {words} body {axis}{where}" for axis in "xyz"]
            rows += [Row(n, unit, o, t, within) for n, o, t in zip(named, ours, got, strict=True)]
    local = {h: steady_clusters(plan.models, float(standard_density(h))) for h in ALTITUDES}
    whose = ["mean" if draw is None else f"draw {draw}" for draw in DRAWS]
    for draw, name, rates in zip(DRAWS, whose, answer["descents"], strict=True):
        for h, got in zip(ALTITUDES, rates, strict=True):
            ours = fell(local[h], draw, float(standard_density(h)))
            rows.append(Row(f"JSBSim: descent rate of the {name} at {h:.0f} m", "m/s", ours, got, DESCENT))
    data = json.loads((folder / DATA).read_text(encoding="utf-8"))
    for draw, name, flight in zip(DRAWS, whose, answer["flights"], strict=True):
        time, height, rate = np.array(flight).T
        for h in ALTITUDES:
            ours = fell(local[h], draw, float(standard_density(h)))
            got = float(np.interp(-h, -height, rate))
            rows.append(Row(f"RocketPy: descent rate of the {name} at {h:.0f} m", "m/s", ours, got, DESCENT))
        said = (data["mean"] if draw is None else data["draws"][draw])["sea_level_descent_rate"]
        rows.append(Row(f"RocketPy: descent rate of the {name} at sea level", "m/s", said, rate[-1], DESCENT))
        if draw is None:
            got = float(np.interp(SOON, time, rate))
            rows.append(Row(f"RocketPy: speed of the mean {SOON:g} s after rest", "m/s", soon(steady), got, DESCENT))
    parachutes = {key: np.array(values).T for key, values in answer["parachutes"].items()}
    drag, volume = parachutes["draws"]
    rows.append(Row("RocketPy: cd_s of all draws", "m^2", steady.drag_area, drag))
    rows.append(Row("RocketPy: air enclosed, of all draws", "m^3", steady.enclosed_volume, volume))
    drag, volume = parachutes["picked"]
    nearest = steady.drag_area[np.abs(steady.drag_area[:, None] - drag).argmin(axis=0)]
    rows.append(Row(f"RocketPy: cd_s picked by stochastic, {drag.size}", "m^2", nearest, drag))
    mean = np.full(volume.shape, steady.enclosed_volume.mean())
    return [*rows, Row("RocketPy: air enclosed, picked by stochastic", "m^3", mean, volume)]


def interpreter(given: str | None, packages: Sequence[str], folder: Path) -> str:
    """The given interpreter, or one of an environment made in a folder."""
    if given is not None:
        return given
    there = folder / "environment"
    print(f"making an environment with {', '.join(packages)}", flush=True)
    subprocess.run([sys.executable, "-m", "venv", str(there)], check=True)
    made = str(there / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python"))
    subprocess.run([made, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages], check=True)
    return made


def asked(python: str, request: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The probe's answer."""
    there, back = folder / "request.json", folder / "answer.json"
    there.write_text(json.dumps(request), encoding="utf-8")
    probe = Path(__file__).with_name("other_programs_probe.py")
    ran = subprocess.run([python, str(probe), str(there), str(back)], capture_output=True, text=True)
    if ran.returncode or not back.is_file():
        raise SystemExit(f"{probe.name} in {python} failed:\n{(ran.stdout + ran.stderr)[-3000:]}")
    return dict(json.loads(back.read_text(encoding="utf-8")))


def beside(answer: dict[str, Any], steady: SteadyCluster) -> Iterator[str]:
    """What is told and not judged."""
    free, ours = np.array(answer["free"]), float(steady.enclosed_volume.mean())
    volume = np.array(answer["parachutes"]["rocket"])[:, 1].mean()
    yield (
        f"not judged: JSBSim's mean, free to swing from {np.rad2deg(0.08):.1f} deg, descends from {ALTITUDES[0]:.0f} to"
        f" {ALTITUDES[1]:.0f} m at {1.0 / np.mean(1.0 / free):.3f} m/s; a StochasticRocket of RocketPy encloses"
        f" {volume:.4g} m^3 of air where the parachute it was given has {ours:.4g}"
    )


def main() -> None:
    """Write, run, compare, print."""
    parser = parser_of(__doc__)
    parser.add_argument("posterior", type=Path)
    parser.add_argument("--python", help="an interpreter with jsbsim and rocketpy; default: one is made")
    parser.add_argument("--packages", nargs="+", default=PACKAGES, help=f"for pip; default: {' '.join(PACKAGES)}")
    given = parser.parse_args()
    posterior = bc.Posterior.load(given.posterior)
    plan = source_of(load_campaign(CAMPAIGN), posterior.spec, posterior.files).plan
    steady = steady_clusters(plan.models)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        request = prepare(plan, steady, folder)
        answer = asked(interpreter(given.python, given.packages, folder), request, folder)
        rows = compare(plan, steady, folder, answer)
    versions = answer["versions"]
    print(f"JSBSim {versions['jsbsim']}, RocketPy {versions['rocketpy']}; {plan.draws} draws")
    print("\n".join([*lines(rows), *beside(answer, steady)]))
    print_result(given, {row.quantity: row.ratio for row in rows}, {"versions": versions})
    sys.exit(0 if all(row.agrees for row in rows) else 1)


if __name__ == "__main__":
    main()
