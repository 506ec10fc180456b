"""Named streams: stable, told apart by name and every key, and the only source of random numbers in the package."""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

import jax
import numpy as np
import pytest

from bayeschute.core.random import seed_of, stream

PACKAGE = Path(__file__).parents[2] / "src" / "bayeschute"
HOME = PACKAGE / "core" / "random.py"
MAKERS = {"default_rng", "SeedSequence", "PRNGKey"}


def test_a_stream_is_the_same_on_every_machine_and_in_every_version():
    np.testing.assert_array_equal(stream(1, "gusts", "cdt-3-11", 2).integers(0, 1000, 5), [779, 529, 464, 809, 843])
    assert seed_of(1, "gusts", "cdt-3-11", 2) == 217026942860100258


def test_every_name_and_key_has_numbers_of_its_own():
    told = [
        (),
        (0,),
        (0, 0),
        ("0",),
        ("",),
        ("", ""),
        (1,),
        (-1,),
        (2**70,),
        ("a", "b"),
        ("ab",),
        ('a", "b',),
        ("a", 1),
    ]
    every = [(seed, name, *keys) for seed in (0, 1, 2**32) for name in ("x", "y", 'x", "y', "") for keys in told]
    made = {tuple(stream(*one).integers(0, 2**62, 2)) for one in every}
    assert len(made) == len(every) == len({seed_of(*one) for one in every})


def test_streams_are_uncorrelated():
    drawn = np.array([stream(3, "noise", i).standard_normal(4000) for i in range(12)])
    off = np.corrcoef(drawn)[np.triu_indices(12, 1)]
    assert np.abs(off).max() < 4.5 / np.sqrt(4000)  # of 66 with that standard deviation


def test_keys_may_be_numpy_integers_and_nothing_that_is_rounded():
    assert seed_of(np.int64(5), "x", np.int32(3)) == seed_of(5, "x", 3)
    with pytest.raises(TypeError):
        stream(5, "x", 3.0)  # type: ignore[arg-type]
    with pytest.raises(ValueError):
        stream(-1, "x")


def test_jax_takes_the_seeds_as_they_are():
    near = [seed_of(0, "x", i) for i in range(64)]
    assert max(near) > 2**62 > min(near) >= 0
    keys = {tuple(np.asarray(jax.random.key_data(jax.random.key(one))).tolist()) for one in near}
    assert len(keys) == 64


def faults(text: str) -> list[str]:
    """What a module does with seeds other than by named streams."""
    found = []
    for node in ast.walk(ast.parse(text)):
        called = node.func if isinstance(node, ast.Call) else None
        called = getattr(called, "attr", getattr(called, "id", ""))
        name = getattr(node, "attr", getattr(node, "id", ""))
        if name in MAKERS:
            found.append(f"line {node.lineno}: {name}")
        if called in ("key", "RandomState", "seed") and isinstance(node.args[0] if node.args else None, ast.Constant):
            found.append(f"line {node.lineno}: {called} of a number")
        if isinstance(node, ast.BinOp):
            sides = [getattr(side, "attr", getattr(side, "id", "")) for side in (node.left, node.right)]
            if "seed" in sides:
                found.append(f"line {node.lineno}: arithmetic on a seed")
        if called in ("stream", "seed_of") and not (
            len(node.args) > 1 and isinstance(node.args[1], ast.Constant) and isinstance(node.args[1].value, str)
        ):
            found.append(f"line {node.lineno}: a stream without a name")
    return found


@pytest.mark.parametrize(
    "text",
    [
        "rng = np.random.default_rng(0)",
        "rng = np.random.default_rng([seed, 7])",
        "from numpy.random import default_rng\nrng = default_rng(seed)",
        "s = np.random.SeedSequence([seed, 2]).generate_state(1)",
        "key = jax.random.PRNGKey(seed + 1)",
        "key = jax.random.key(3)",
        "seed = study.seed + 100 + i",
        "rng = stream(seed, 7)",
        "rng = stream(seed, name)",
    ],
)
def test_hand_picked_numbers_are_seen(text: str):
    assert faults(text)


def test_no_random_numbers_but_by_named_streams():
    files = [path for path in sorted(PACKAGE.rglob("*.py")) if path != HOME]
    found = {path.name: made for path in files if (made := faults(path.read_text(encoding="utf-8")))}
    assert found == {}


def test_a_name_is_used_in_one_place_only():
    used = defaultdict(list)
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in ("stream", "seed_of") and path != HOME:
                used[node.args[1].value].append(f"{path.name}:{node.lineno}")  # type: ignore[attr-defined]
    assert len(used) > 25
    assert {name: places for name, places in used.items() if len(places) > 1} == {}
