"""Which number each parameter name replaces."""

from __future__ import annotations

from dataclasses import replace

import jax
import numpy as np
import pytest
from tests.twins import small_cluster as small

from bayeschute.core.vectors import Vec3
from bayeschute.dynamics.cluster_flight import with_parameters
from bayeschute.likelihood.priors import Prior, values

BASE = small.cluster()


@pytest.mark.parametrize(
    "name, value, read, want",
    [
        ("axial[alpha^2]", -0.5, lambda c: c.axial[1], -0.5),
        ("transverse[repulsion(0.8)]", 0.7, lambda c: c.transverse[4], 0.7),
        ("riser_stiffness", np.log(1e5), lambda c: c.risers.stiffness, 1e5),
        ("riser_damping", np.log(2e5), lambda c: c.risers.damping, 2e5),
        ("riser_length", 70.0, lambda c: c.risers.length, 70.0),
        ("capsule_mass", 9000.0, lambda c: c.capsule.mass, 9000.0),
        ("capsule_axial_force", -0.7, lambda c: c.capsule.axial_force, -0.7),
        ("capsule_normal_force_slope", 0.5, lambda c: c.capsule.normal_force_slope, 0.5),
        ("capsule_pitch_moment_slope", -0.1, lambda c: c.capsule.moment_slope, -0.1),
        ("capsule_pitch_damping", -0.4, lambda c: c.capsule.pitch_damping, -0.4),
        ("capsule_inertia_factor_y", 1.1, lambda c: c.capsule.inertia.y, 1.1 * float(BASE.capsule.inertia.y)),
        ("capsule_inertia_factor_z", 0.9, lambda c: c.capsule.inertia.z, 0.9 * float(BASE.capsule.inertia.z)),
        ("canopy_mass", 140.0, lambda c: c.canopies.dry_mass, 140.0),
        ("enclosed_air_factor", np.log(1.1), lambda c: c.canopies.enclosed_volume, 1.1 * 3969.0),
    ],
)
def test_a_name_replaces_one_number(name, value, read, want):
    changed = with_parameters(BASE, small.TWO, (name,), np.array([value]))
    assert float(read(changed)) == pytest.approx(want)
    different = [a != b for a, b in zip(jax.tree.leaves(BASE), jax.tree.leaves(changed), strict=True)]
    assert sum(map(bool, different)) == 1


@pytest.mark.parametrize(
    ("name", "field"), [("pitch_moment_slope", "moment_slope"), ("pitch_damping", "pitch_damping")]
)
def test_a_canopys_moment_is_added_where_there_was_none(name, field):
    changed = with_parameters(BASE, small.TWO, (f"canopy_{name}",), np.array([-0.1]))
    assert getattr(BASE.canopies, field) is None
    assert float(getattr(changed.canopies, field)) == -0.1
    assert len(jax.tree.leaves(changed)) == len(jax.tree.leaves(BASE)) + 1


def test_the_simulator_flies_the_values_that_priors_tell():
    """Coefficients at the vehicle's apparent mass, and a factor on that."""
    names, shares = ("transverse[e]", "axial[1]", "enclosed_air_factor"), (0.8, 0.0, 0.0)
    theta = np.array([-0.2, 0.9, np.log(0.6)])
    flown = with_parameters(BASE, small.TWO, names, theta, shares)
    law = [Prior(n, 0.0, 1.0, n == names[2], "1", "", air_share=s) for n, s in zip(names, shares, strict=True)]
    told = [float(flown.transverse[0]), float(flown.axial[0]), float(flown.canopies.enclosed_volume) / 3969.0]
    np.testing.assert_allclose(told, values(law, theta))
    held = with_parameters(BASE, small.TWO, names[:2], theta[:2], shares[:2])
    assert float(held.transverse[0]) == -0.2


@pytest.mark.parametrize("name", ["axial[q]", "transverse[1]"])
def test_terms_outside_the_structure_are_refused(name):
    with pytest.raises(ValueError):
        with_parameters(BASE, small.TWO, (name,), np.ones(1))


def _tensor(xy, xz, yz):
    c = small.CAPSULE.inertia
    return np.array([[c.x, xy, xz], [xy, c.y, yz], [xz, yz, c.z]])


@pytest.mark.parametrize("products", [None, (0.0, 0.0, 0.0), (3e3, -5e3, 4e3), (-9e3, 9e3, 9e3)])
def test_the_inertia_tensor_and_its_inverse(products):
    capsule = replace(small.CAPSULE, products=None if products is None else Vec3(*products))
    tensor, rng = _tensor(*(products or (0.0, 0.0, 0.0))), np.random.default_rng(1)
    for v in (*np.eye(3), rng.normal(size=3)):
        momentum, turning = capsule.angular_momentum(Vec3(*v)), capsule.turned_by(Vec3(*(1e4 * v)))
        np.testing.assert_allclose(momentum.stack(), tensor @ v, rtol=1e-14, atol=1e-10)
        np.testing.assert_allclose(turning.stack(), np.linalg.solve(tensor, 1e4 * v), rtol=1e-12, atol=1e-15)
