from __future__ import annotations

from pathlib import Path

import numpy as np

from bayeschute.core.trees import load_tree, save_tree
from bayeschute.posterior.best_path import BestPath


def _path(name: str) -> BestPath:
    residual = np.array([[3.0, np.nan, np.nan], [-4.0, np.nan, 2.0]])
    outputs = ("canopy_position.1.north", "capsule_velocity.east", "descent_rate")
    return BestPath(name, np.array([0.0, 0.5]), outputs, residual, np.array([0.1, 0.2, 0.3]), np.array([0.4]))


def test_residuals_are_of_what_was_recorded():
    np.testing.assert_allclose(_path("a").rms(), [np.sqrt(12.5), np.nan, 2.0])


def test_paths_come_back_from_a_file(tmp_path: Path):
    file = tmp_path / "failed.npz"
    save_tree(file, (_path("first flight"), _path("b.flight")))
    made = load_tree(file, tuple[BestPath, ...])
    assert [one.flight for one in made] == ["first flight", "b.flight"]
    assert made[0].outputs == _path("").outputs
    for name in ("time", "residual", "noise", "defect"):
        np.testing.assert_array_equal(getattr(made[1], name), getattr(_path(""), name))
    save_tree(file, ())
    assert load_tree(file, tuple[BestPath, ...]) == ()
