"""Tables as plain values and back: what is written is read, and what does not fit is refused with its place."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from bayeschute.core.errors import InputError
from bayeschute.core.plain import from_plain, to_plain


@dataclass(frozen=True)
class Leaf:
    value: float
    unit: str | None = None


@dataclass(frozen=True)
class Tree:
    leaves: Mapping[str, Leaf]
    row: tuple[float | None, ...] = ()
    more: Mapping[str, int] = field(default_factory=dict)


TREE = Tree({"a": Leaf(1.5, "m"), "b": Leaf(2.0)}, (0.5, None), {"n": 3})


@pytest.mark.parametrize("without_none", [False, True])
def test_what_is_written_is_read_back(without_none):
    plain = json.loads(json.dumps(to_plain(TREE, without_none=without_none)))
    assert from_plain(Tree, plain) == TREE
    assert ("unit" in plain["leaves"]["b"]) is not without_none and plain["row"] == [0.5, None]


def test_arrays_are_written_as_lists():
    assert json.loads(json.dumps(to_plain({"x": np.array([[1.0], [2.0]])}))) == {"x": [[1.0], [2.0]]}


@pytest.mark.parametrize(
    ("plain", "where"),
    [
        ({"leaves": {"a": {"value": "far"}}}, "tree.leaves.a.value"),
        ({"leaves": {"a": {"value": 1.0, "colour": "red"}}}, "tree.leaves.a"),
        ({"leaves": {"a": {}}}, "tree.leaves.a"),
        ({"leaves": {}, "row": [1.0, "x"]}, "tree.row[1]"),
        ({"leaves": {}, "more": {"n": 1.5}}, "tree.more.n"),
        (3, "tree"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(plain, where):
    with pytest.raises(InputError) as refused:
        from_plain(Tree, plain, "tree")
    assert str(refused.value).startswith(f"{where}:")
