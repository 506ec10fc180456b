"""Nested values come back from a file to the bit, and plain NumPy reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from bayeschute.core.trees import load_tree, save_tree


class Point(NamedTuple):
    place: Any
    weight: float


@dataclass(frozen=True)
class Fit:
    points: tuple[Point, ...]
    scores: Mapping[str, float]
    tables: dict[str, dict[str, np.ndarray]]
    names: tuple[str, ...]
    good: bool
    count: int
    k: float | None
    note: str = ""
    none: Mapping[str, float] = field(default_factory=dict)


def fit(k: float | None = None, points: int = 12) -> Fit:
    rng = np.random.default_rng(1)
    made = tuple(Point(rng.standard_normal((2, i)), float(rng.random())) for i in range(points))
    tables = {"a/b": {"x|max": np.array([1, 2])}, "~1": {"x": np.array([True])}, "": {"y": np.zeros(0)}}
    return Fit(made, {"axial[alpha^2]": -0.0, "p@q.canopy1": np.nan}, tables, ("é", ""), True, 2**40, k, "two\nlines")


@pytest.mark.parametrize("given", [fit(), fit(1.0 / 3.0), fit(points=0)])
def test_a_tree_comes_back_to_the_bit(tmp_path: Path, given: Fit):
    save_tree(tmp_path / "fit.npz", given)
    back = load_tree(tmp_path / "fit.npz", Fit)
    assert repr(back) == repr(given)  # plain values have their types again
    for one, other in zip(back.points, given.points, strict=True):
        assert one.place.tobytes() == other.place.tobytes() and one.place.shape == other.place.shape
    assert back.tables["a/b"]["x|max"].dtype == int


def test_plain_numpy_reads_it(tmp_path: Path):
    save_tree(tmp_path / "fit.npz", {"fit": fit(), "more": (jnp.arange(3), None)})
    with np.load(tmp_path / "fit.npz", allow_pickle=False) as file:
        np.testing.assert_array_equal(file["fit/points/3/place"], fit().points[3].place)
        assert str(file["fit/note"]) == "two\nlines" and "fit/k" not in file and "more/1" not in file
    assert load_tree(tmp_path / "fit.npz", float, "fit/points/3/weight") == fit().points[3].weight
    assert len(load_tree(tmp_path / "fit.npz", tuple[Point, ...], "fit/points")) == 12


def test_a_missing_entry_is_told_and_what_needs_pickle_refused(tmp_path: Path):
    save_tree(tmp_path / "a.npz", {"place": np.zeros(2)})
    with pytest.raises(KeyError, match="weight"):
        load_tree(tmp_path / "a.npz", Point)
    with pytest.raises(TypeError, match="a/0"):
        save_tree(tmp_path / "b.npz", {"a": [object()]})
    assert not (tmp_path / "b.npz").exists()
