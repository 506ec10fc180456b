"""Run notebooks and write them as ``.ipynb`` beside their sources: ``python docs/render.py [NAME ...]``, else all.

One that reads measured records is left as it is where BAYESCHUTE_DATA does not say where they lie: without them it
would end with nothing found. They are part of the project; a test compares ``source_sha256`` of their metadata with
their sources, and the last line names the code that made their numbers. What a notebook writes to the error stream
(warnings, which name files of this machine) is printed here and left out.
"""

from __future__ import annotations

import hashlib
import os
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient

from bayeschute import __version__
from bayeschute.study.evidence.numerics_hash import ENGINE, engine, numerics

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
DATA = "BAYESCHUTE_DATA"


def source_hash(source: Path) -> str:
    """SHA-256 of a notebook's source."""
    return hashlib.sha256(source.read_text(encoding="utf-8").encode()).hexdigest()


def lacks_records(source: Path) -> bool:
    """Whether a notebook reads measured records, and nothing says where they lie."""
    return DATA in source.read_text(encoding="utf-8") and not os.environ.get(DATA)


def made_by() -> str:
    """Last line of a rendered notebook: when it was run, and by which code on which libraries."""
    today, on = datetime.now(UTC).date().isoformat(), engine({name: version(name) for name in ENGINE})
    made = f"*Run on {today} by bayeschute {__version__}, numerics `{numerics()[:8]}`"
    return f"{made} on {on} (`docs/render.py`).*"


def render(source: Path, folder: Path | None = None) -> Path:
    """Run a notebook with the kernel of this environment; returns the path of what was written.

    Args:
        source: Plain Python with cell marks.
        folder: Where to; beside the source where None.
    """
    notebook = jupytext.read(source)
    where = {"metadata": {"path": str(source.parent)}}
    NotebookClient(notebook, timeout=3600, kernel_name="python3", resources=where, record_timing=False).execute()
    notebook.cells.append(nbformat.v4.new_markdown_cell(made_by()))
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number}"
        for output in cell.get("outputs", []):
            if output.get("name") == "stderr":
                print(f"{source.name}: {output['text'].strip()}", file=sys.stderr)
        if "outputs" in cell:
            cell["outputs"] = [output for output in cell["outputs"] if output.get("name") != "stderr"]
    notebook.metadata["source_sha256"] = source_hash(source)
    path = (folder or source.parent) / source.with_suffix(".ipynb").name
    aside = path.with_suffix(".part")
    nbformat.write(notebook, aside)
    os.replace(aside, path)
    return path


if __name__ == "__main__":
    for name in sys.argv[1:] or sorted(path.stem for path in NOTEBOOKS.glob("*.py")):
        source = NOTEBOOKS / f"{name}.py"
        if lacks_records(source):
            print(f"{source}: left as it is; it reads measured records, {DATA} says where they lie", flush=True)
            continue
        path = render(source)
        print(f"{path}: {path.stat().st_size / 1024:.0f} kB", flush=True)
