"""Rooms: no import circle, no crowded folder, no file name twice, no module that nobody can reach."""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "bayeschute"
MOST_FILES = 15  # of a folder, __init__.py aside
KEPT = {  # nothing reaches them yet
    "bayeschute.likelihood.extended_kalman",  # an independent likelihood to judge the default one by
}


def _name(path: Path) -> str:
    parts = ("bayeschute", *path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def imports(path: Path) -> set[str]:
    """Modules of the package that a file imports, inside functions and for type checkers too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found |= {one if (one := f"{node.module}.{a.name}") in FILES else node.module for a in node.names}
        elif isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
    return found & set(FILES)


GRAPH = {name: imports(path) for name, path in FILES.items()}


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Sets of modules that import each other: those that can be reached from each other."""
    below = {name: reached(graph, graph[name]) for name in graph}
    found = {frozenset(other for other in below[name] if name in below[other]) for name in graph if name in below[name]}
    return [set(one) for one in found]


def reached(graph: dict[str, set[str]], start: set[str]) -> set[str]:
    """Modules that can be reached from some, these included."""
    seen: set[str] = set()
    todo = list(start)
    while todo:
        name = todo.pop()
        if name not in seen:
            seen.add(name)
            todo += graph.get(name, ())
    return seen


def test_circles_are_found():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [{"b", "c"}]
    assert circles({"a": {"b"}, "b": set()}) == []


def test_no_module_imports_itself_by_way_of_others():
    assert circles(GRAPH) == []


@pytest.mark.parametrize("folder", sorted({path.parent for path in FILES.values()}), ids=lambda p: p.name)
def test_no_folder_is_crowded(folder):
    assert len([path for path in folder.glob("*.py") if path.name != "__init__.py"]) <= MOST_FILES


def test_no_file_name_stands_twice():
    count = Counter(path.name for path in FILES.values() if path.name != "__init__.py")
    assert [name for name, times in count.items() if times > 1] == []


def test_every_room_says_what_it_is_for():
    without = [
        name for name, path in FILES.items() if not ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert without == []


def test_every_module_is_reached_by_a_command_a_notebook_or_a_benchmark():
    users = [path for folder in ("notebooks", "benchmarks") for path in (ROOT / folder).glob("*.py")]
    start = {"bayeschute", "bayeschute.__main__"}.union(*(imports(path) for path in users))
    live = reached(GRAPH, start)
    rooms = {name for name, path in FILES.items() if path.name == "__init__.py"}
    assert set(FILES) - live - rooms == KEPT
