"""A sound study of each model in a folder of its own, to be spoilt by the tests."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from bayeschute.study.templates import template

Spoil = Callable[..., Path]


@pytest.fixture
def descent(tmp_path: Path) -> Path:
    """A sound study of the descent model, its record beside it."""
    path = tmp_path / "descent.toml"
    path.write_text(template("descent.toml").read_text(encoding="utf-8"), encoding="utf-8")
    record = "time_s,altitude_m\n" + "".join(f"{i},{1000 - 5 * i}\n" for i in range(200))  # 5 m/s, one sample a second
    (tmp_path / "my-descent.csv").write_text(record, encoding="utf-8")
    return path


@pytest.fixture
def cluster(tmp_path: Path) -> Path:
    """A sound study of a virtual drop, its vehicle beside it."""
    for name in ("vehicle.toml", "virtual.toml"):
        (tmp_path / name).write_text(template(name).read_text(encoding="utf-8"), encoding="utf-8")
    return tmp_path / "virtual.toml"


@pytest.fixture
def spoil() -> Spoil:
    """Replace the first match of a pattern in a file, which must be there."""

    def change(path: Path, pattern: str, new: str) -> Path:
        text, count = re.subn(pattern, lambda _: new, path.read_text(encoding="utf-8"), count=1, flags=re.M)
        assert count == 1, f"{pattern} is not in {path}"
        path.write_text(text, encoding="utf-8")
        return path

    return change
