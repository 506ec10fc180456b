"""Nested values in one ``.npz`` file that plain NumPy reads without pickle: ``optimum/flights/0/path``.

A tree is made of dataclasses, named tuples, tuples, lists and mappings with texts as keys; its leaves are arrays,
numbers, truth values and texts, or None, which leaves no entry.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import partial
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from bayeschute.core.files import write_whole

T = TypeVar("T")


def save_tree(path: Path, tree: Any) -> None:
    """Write a tree, whole or not at all.

    Args:
        path: The file, ``.npz``.
        tree: The tree.

    Raises:
        TypeError: If a leaf is no array of numbers, truth values or texts.
    """
    write_whole(path, partial(np.savez, **_leaves(tree)))


def load_tree(path: Path, kind: type[T], at: str = "") -> T:
    """Read a tree, or a part of one, as `save_tree` wrote it; leaves that are not of a plain type come as arrays.

    Args:
        path: The file.
        kind: Type of the tree; its fields have annotated types such as ``dict[str, X]``, ``tuple[X, ...]``.
        at: Where in the tree, e.g. ``"optimum/flights"``; all of it where empty.

    Raises:
        KeyError: If an entry is missing.
    """
    with np.load(path, allow_pickle=False) as file:
        made: T = _tree(kind, file, f"{at}/" if at else "")
    return made


def _leaves(tree: Any, at: str = "") -> dict[str, Any]:
    if is_dataclass(tree) or hasattr(tree, "_fields"):
        inside = {name: getattr(tree, name) for name in _fields(type(tree))}
    elif isinstance(tree, Mapping):
        inside = {key.replace("~", "~0").replace("/", "~1"): value for key, value in tree.items()}
    elif isinstance(tree, tuple | list):
        inside = {str(i): value for i, value in enumerate(tree)}
    elif tree is None:
        return {}
    elif (leaf := np.asarray(tree)).dtype.hasobject:
        raise TypeError(f"{at}: a {type(tree).__name__} can't be stored")
    else:
        return {at: leaf}
    named = ((f"{at}/{name}" if at else name, value) for name, value in inside.items())
    return {name: leaf for at_it, value in named for name, leaf in _leaves(value, at_it).items()}


def _fields(kind: Any) -> tuple[str, ...]:
    return tuple(kind.__dataclass_fields__) if is_dataclass(kind) else kind._fields


def _tree(kind: Any, leaves: Mapping[str, NDArray[Any]], at: str) -> Any:
    """The tree of a type whose leaves have names that begin with `at`."""
    inside = dict.fromkeys(name[len(at) :].split("/")[0] for name in leaves if name.startswith(at))
    origin, of = get_origin(kind) or kind, get_args(kind)
    if NoneType in of:
        (some,) = (one for one in of if one is not NoneType)
        return _tree(some, leaves, at) if inside or at[:-1] in leaves else None
    if is_dataclass(kind) or hasattr(kind, "_fields"):
        hints = get_type_hints(kind)
        return kind(**{name: _tree(hints[name], leaves, f"{at}{name}/") for name in _fields(kind)})
    if origin is tuple:
        return tuple(_tree(of[0], leaves, f"{at}{i}/") for i in range(len(inside)))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        names = {name: name.replace("~1", "/").replace("~0", "~") for name in inside}
        return {names[name]: _tree(of[1], leaves, f"{at}{name}/") for name in inside}
    leaf = leaves[at[:-1]]
    return kind(leaf.item()) if kind in (bool, int, float, str) else leaf
