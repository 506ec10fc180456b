"""A capsule's coefficients by numbers or by a table, in the vehicle file or beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bayeschute.aero.capsule_table import table_coefficients
from bayeschute.core.vectors import Vec3
from bayeschute.study.assembly import assemble
from bayeschute.study.load import check_study, load_study
from bayeschute.study.schema.vehicle_schema import Vehicle

SCALARS = ("axial_force", "normal_force_slope", "pitch_moment_slope")


def with_table(study: Path, table: str, keep: bool = False) -> Path:
    """The study with a table of the capsule in its vehicle, in place of the numbers unless they are kept."""
    path = study.parent / "vehicle.toml"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    text = "".join(line for line in lines if keep or not line.startswith(SCALARS))
    before, after = text.split("[canopies]", 1)
    path.write_text(f"{before}{table}\n[canopies]{after}", encoding="utf-8")
    return study


def examples(study: Path) -> list[str]:
    """The two examples of a table in the template's comments."""
    text = (study.parent / "vehicle.toml").read_text(encoding="utf-8")
    found = []
    for part in text.split("# [capsule.table]\n")[1:]:
        lines = [
            line
            for line in part.split("\n\n")[0].splitlines()
            if line.startswith("# ") and line[2].isalpha() and " = " in line
        ]
        found.append("[capsule.table]\n" + "\n".join(line[2:] for line in lines if not line.startswith("# Or")))
    return found


def vehicle_of(study: Path) -> Vehicle:
    vehicle = load_study(study).vehicle
    assert vehicle is not None
    return vehicle


def told(study: Path) -> str:
    return "\n".join(map(str, check_study(study)))


def coefficients(vehicle: Vehicle, angle: float, roll: float) -> np.ndarray:
    table = assemble.cluster(vehicle)[0].capsule.table
    along = Vec3(np.cos(angle), np.sin(angle) * np.sin(roll), np.sin(angle) * np.cos(roll))
    return np.array([float(value) for value in table_coefficients(table, along)])


def test_the_examples_of_the_template_say_the_same_in_the_file_and_beside_it(cluster: Path):
    inline, beside = examples(cluster)
    original = (cluster.parent / "vehicle.toml").read_text(encoding="utf-8")
    here = vehicle_of(with_table(cluster, inline))
    np.testing.assert_allclose(
        coefficients(here, np.deg2rad(120.0), 0.0), [-0.5, 0.0, 0.26, 0.0, -0.04, 0.0], atol=1e-9
    )
    assert assemble.geometry(here).capsule_drag_coefficient == pytest.approx(0.9)
    table = here.capsule.table
    assert table is not None
    given = table.arrays()
    rows = [[angle, 0.0, *(given[name][i, 0] for name in given)] for i, angle in enumerate((0, 60, 90, 120, 150, 180))]
    lines = [",".join(["total_angle", "roll", *given]), *(",".join(map(str, row)) for row in rows[::-1])]
    (cluster.parent / "capsule.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (cluster.parent / "vehicle.toml").write_text(original, encoding="utf-8")
    there = vehicle_of(with_table(cluster, beside))
    for angle, roll in ((0.3, 1.0), (2.0, 4.0), (3.1, 0.2)):
        np.testing.assert_allclose(coefficients(there, angle, roll), coefficients(here, angle, roll), atol=1e-12)


GRID = '[capsule.table]\ntotal_angle = ["0 deg", "60 deg", "120 deg", "180 deg"]\nroll = ["0 deg"]\n'
FAULTS = [
    (GRID, "no coefficient"),
    (GRID + "C_A = [[1.0], [0.5], [-0.5]]\n", "C_A: shape (3, 1)"),
    (GRID + "C_A = [[1.0], [0.5, 0.1], [-0.5], [1.0]]\n", "rows of different lengths in C_A"),
    (GRID + "C_N = [[0.1], [0.5], [0.5], [0.0]]\n", "0 on the axis of a body of revolution"),
    (GRID + "C_D = [[1.0], [0.5], [-0.5], [1.0]]\n", "unknown key 'C_D'"),
    (GRID.replace("60", "130") + "C_A = [[1.0], [0.5], [-0.5], [1.0]]\n", "130 deg followed by 120 deg"),
    (GRID.replace('"0 deg"]', '"0 deg", "90 deg"]') + "C_A = [[1.0, 1], [0.5, 1], [-0.5, 1], [1.0, 1]]\n", "2 rolls"),
    (GRID + 'angle_unit = "deg"\nC_A = [[1.0], [0.5], [-0.5], [1.0]]\n', "angle_unit without file"),
    ('[capsule.table]\nfile = "c.csv"\n', "file without angle_unit"),
    ('[capsule.table]\nfile = "c.csv"\nangle_unit = "m"\n', "a unit of angles"),
    ('[capsule.table]\nfile = "d.csv"\nangle_unit = "deg"\n', "no such file"),
    ('[capsule.table]\nfile = "c.csv"\nangle_unit = "deg"\n', "every pair of the file's angles once"),
]


@pytest.mark.parametrize(("table", "words"), FAULTS)
def test_tables_that_can_t_be_used_are_refused(cluster: Path, table: str, words: str):
    (cluster.parent / "c.csv").write_text("total_angle,roll,C_A\n0,0,1\n90,0,0\n90,0,1\n180,0,-1\n", encoding="utf-8")
    said = told(with_table(cluster, table))
    assert words in said and "vehicle.toml" in said


def test_a_capsule_has_numbers_or_a_table(cluster: Path):
    table = GRID + "C_A = [[1.0], [0.5], [-0.5], [-1.0]]\n"
    assert "both a table and axial_force" in told(with_table(cluster, table, keep=True))


def test_a_capsule_without_coefficients_is_refused(cluster: Path):
    assert "no axial_force, normal_force_slope, pitch_moment_slope" in told(with_table(cluster, ""))


def test_rate_dampings_reach_the_capsule(cluster: Path, spoil):
    more = "pitch_damping = -0.2\nyaw_damping = -0.3\npitch_rate_damping = -0.1\nyaw_rate_damping = -0.4"
    spoil(cluster.parent / "vehicle.toml", r"^pitch_damping = -0.2.*$", more)
    capsule = assemble.cluster(vehicle_of(cluster))[0].capsule
    found = capsule.pitch_damping, capsule.yaw_damping, capsule.pitch_rate_damping, capsule.yaw_rate_damping
    assert found == (-0.2, -0.3, -0.1, -0.4)


def test_a_table_of_the_numbers_flies_like_the_numbers(cluster: Path):
    """The force of constant C_A and a slope with the sine, told by a table."""
    import jax.numpy as jnp

    from bayeschute.core.vectors import quaternion
    from bayeschute.dynamics.cluster import Air, capsule_aerodynamics
    from bayeschute.dynamics.state import ClusterState

    plain = assemble.cluster(vehicle_of(cluster))[0].capsule
    angle = np.deg2rad(np.arange(0.0, 181.0, 10.0))
    across = np.where(np.sin(angle) < 1e-9, 0.0, np.sin(angle))
    rows = {"C_A": np.full(angle.size, -0.9), "C_N": 0.3 * across}
    table = (
        "[capsule.table]\ntotal_angle = ["
        + ", ".join(f'"{np.rad2deg(a):g} deg"' for a in angle)
        + ']\nroll = ["0 deg"]\n'
    )
    table += "".join(f"{name} = {[[float(v)] for v in values]}\n" for name, values in rows.items())
    tabled = assemble.cluster(vehicle_of(with_table(cluster, table)))[0].capsule
    zero = jnp.zeros(())
    still = Vec3(zero, zero, zero)
    for seed in range(4):
        v, w, q = np.split(np.random.default_rng(seed).normal(size=10), [3, 6])
        state = ClusterState(
            still, Vec3(*(10.0 * v)), quaternion(jnp.asarray(q / np.linalg.norm(q))), Vec3(*w), still, still
        )
        air = Air(still, still, 1.1, 1.0, still)
        for a, b in zip(capsule_aerodynamics(state, plain, air), capsule_aerodynamics(state, tabled, air), strict=True):
            np.testing.assert_allclose(b.stack(), a.stack(), rtol=1e-4, atol=1e-3 * np.abs(a.stack()).max())


def test_numbers_in_whose_place_a_table_stands_are_not_fitted(cluster: Path):
    prior = "capsule_normal_force_slope = { mean = 0.3, sd = 0.1 }\n"
    text = cluster.read_text(encoding="utf-8")
    cluster.write_text(text.replace("riser_length = {", prior + "riser_length = {", 1), encoding="utf-8")
    assert check_study(cluster) == []
    (fault,) = check_study(with_table(cluster, examples(cluster)[0]))
    assert "capsule_normal_force_slope" in str(fault) and "[capsule.table]" in str(fault)
