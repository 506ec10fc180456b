"""Test files that would notice a change in a module: the one that mirrors it, then its importers, nearest first.

Imports are read from the sources, inside functions and for type checkers too. A test file is the nearer, the fewer
imports lie between it and the module (one that imports it directly has one), then the more of the folder they share,
then the less else it imports.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self


@dataclass(frozen=True)
class Imports:
    """Who imports what, in the package and its tests.

    Attributes:
        root: Folder that holds ``src`` and ``tests``.
        files: File of every module, by its dotted name.
        graph: Modules that a module imports, both by dotted name.
    """

    root: Path
    files: Mapping[str, Path]
    graph: Mapping[str, frozenset[str]]

    @classmethod
    def read(cls, root: Path) -> Self:
        """Read the sources.

        Args:
            root: Folder that holds ``src`` and ``tests``.
        """
        files = {_name(path, root / "src"): path for path in sorted((root / "src").rglob("*.py"))}
        files |= {_name(path, root): path for path in sorted((root / "tests").rglob("*.py"))}
        return cls(root, files, {name: frozenset(_imported(path, files)) for name, path in files.items()})

    def nearest(self, path: Path) -> list[tuple[str, bool]]:
        """Test files that reach a module, from the root, and whether each mirrors it: mirrors first, then by distance.

        Args:
            path: Of the module.
        """
        room = path.relative_to(self.root / "src").parts[1:-1]
        folder = self.root / "tests" / room[0] if room else self.root / "tests"
        mirrors = set(folder.glob(f"**/test_{path.stem}.py" if room else f"test_{path.stem}.py"))
        steps = self._reaching(path)

        def rank(test: Path) -> tuple[object, ...]:
            pairs = zip(room, test.relative_to(self.root / "tests").parts, strict=False)
            apart = next((place for place, (a, b) in enumerate(pairs) if a != b), len(room))
            imports = len(self.graph[_name(test, self.root)])
            return test not in mirrors, steps.get(test, 0), -apart, imports, test.as_posix()

        ranked = sorted({*steps, *mirrors}, key=rank)
        return [(test.relative_to(self.root).as_posix(), test in mirrors) for test in ranked]

    def _reaching(self, path: Path) -> dict[Path, int]:
        """Test files from which imports lead to a module, and by how many."""
        users: dict[str, set[str]] = {}
        for user, used in self.graph.items():
            for one in used:
                users.setdefault(one, set()).add(user)
        now, steps = {_name(path, self.root / "src")}, 0
        seen, found = set(now), dict[Path, int]()
        while now:
            steps += 1
            now = {user for one in now for user in users.get(one, ())} - seen
            seen |= now
            found |= {file: steps for one in now if (file := self.files[one]).name.startswith("test_")}
        return found


def _name(path: Path, base: Path) -> str:
    parts = path.relative_to(base).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imported(path: Path, files: Mapping[str, Path]) -> set[str]:
    found = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            found |= {one if (one := f"{node.module}.{a.name}") in files else node.module for a in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found & set(files)
