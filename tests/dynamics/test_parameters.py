"""Which number each parameter name replaces."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import jax
import numpy as np
import pytest

from bayeschute.dynamics.cluster_flight import with_parameters

_spec = importlib.util.spec_from_file_location(
    "small_cluster", Path(__file__).parents[1] / "twins" / "small_cluster.py"
)
small = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(small)
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
        ("enclosed_air_factor", 1.1, lambda c: c.canopies.enclosed_volume, 1.1 * 3969.0),
    ],
)
def test_a_name_replaces_one_number(name, value, read, want):
    changed = with_parameters(BASE, small.TWO, (name,), np.array([value]))
    assert float(read(changed)) == pytest.approx(want)
    different = [a != b for a, b in zip(jax.tree.leaves(BASE), jax.tree.leaves(changed), strict=True)]
    assert sum(map(bool, different)) == 1


@pytest.mark.parametrize("name", ["axial[q]", "transverse[1]"])
def test_terms_outside_the_structure_are_refused(name):
    with pytest.raises(ValueError):
        with_parameters(BASE, small.TWO, (name,), np.ones(1))
