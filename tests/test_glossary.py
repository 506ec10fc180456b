"""The glossary names files that exist and words that occur in them."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
HEAD = ["symbol", "word in code", "what the field calls it", "unit", "paper or equation", "file"]


def _rows() -> list[list[str]]:
    """Cells of every row of every table, without headings and rules."""
    lines = (ROOT / "docs/glossary.md").read_text(encoding="utf-8").splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    return [row for row in rows if row != HEAD and set(row[0]) != {"-"} or len(row) > 1 and row[1].startswith("`")]


def test_every_row_has_every_cell():
    rows = _rows()
    assert len(rows) > 60
    assert not [row for row in rows if len(row) != len(HEAD) or not row[2]]


def test_every_file_exists_and_contains_the_word():
    faults = []
    for _, words, meaning, _, _, file in _rows():
        path = ROOT / "src/bayeschute" / file.strip("`")
        if not path.is_file():
            faults.append(f"{meaning}: no file {file}")
            continue
        text = path.read_text(encoding="utf-8")
        faults += [
            f"{meaning}: no {word} in {file}"
            for word in re.findall(r"`([A-Za-z_]\w*)`", words)
            if not re.search(rf"\b{word}\b", text)
        ]
    assert not faults, "\n".join(faults)


def test_every_word_is_an_identifier_in_code_marks():
    assert not [row for row in _rows() if not re.fullmatch(r"`[A-Za-z_]\w*`(, `[A-Za-z_]\w*`)*", row[1])]
