"""The notebooks run from top to bottom, and find what they say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jupytext
import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"


def _values(name: str, expression: str, folder: Path) -> Any:
    """Execute a notebook in a kernel of its own and a last cell that tells an expression's value."""
    notebook = jupytext.read(NOTEBOOKS / name)
    last = nbformat.v4.new_code_cell(f"import json\nprint(json.dumps({expression}))")
    notebook.cells.append(last)
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": folder}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs), "no figure is shown"
    return json.loads(last["outputs"][-1]["text"])


def test_quickstart(tmp_path: Path):
    expression = """dict(
        mean=drag.mean(), sd=drag.std(), truth=TRUE_DRAG, covered=covered, risk=vars(risk),
        plain=[float(theirs.mean()), float(theirs.std())], held=[float(held.mean()), float(held.std())],
        contraction=contraction, share=share, partner=partner,
        kinds=[repair.kind for repair in flight.repairs], groups=sorted(posterior.data.children),
        widths=[float((band["high"] - band["low"]).values[part].mean()) for part in (~held_out, held_out)],
    )"""
    found = _values("quickstart.py", expression, tmp_path)
    assert abs(found["mean"] - found["truth"]) < 4.0 * found["sd"] < 0.1
    mean, sd = found["held"]
    assert abs(found["plain"][0] - mean) < 0.35 * sd and 0.8 < found["plain"][1] / sd < 1.25
    assert found["contraction"] > 0.95 and 0.2 < found["share"] < 0.5 and "wind" in found["partner"]
    assert 1.0 - (sd / found["sd"]) ** 2 == pytest.approx(found["share"], abs=0.15)  # 800 draws
    assert "spike" in found["kinds"]
    assert {"posterior", "prior", "log_likelihood"} <= set(found["groups"])
    assert found["widths"][1] > found["widths"][0]
    assert 0.3 < found["covered"] <= 1.0  # one or two independent gusts
    risk = found["risk"]
    assert 0.0 < risk["low"] <= risk["met"] <= risk["high"] <= 1.0
    assert risk["failed"] == 0


def test_behaviour(tmp_path: Path):
    expression = """dict(
        cycle=cycle, endings=[one.ending for one in configurations], both=both.tolist(), slope=slope,
        elasticity=sensitivity.elasticity.tolist(),
    )"""
    found = _values("behaviour.py", expression, tmp_path)
    amplitude, frequency, descent = found["cycle"]
    assert abs(amplitude - 0.380) < 0.005 and abs(frequency - 0.0698) < 0.0005 and 10.2 < descent < 10.4
    assert found["endings"] == ["limit cycle", "limit cycle", "glide", "vertical descent"]
    assert min(found["both"]) < -0.09 and max(found["both"]) > -0.03
    assert 1.0 < found["slope"] < 1.25
    assert found["elasticity"][0] < 0.0 < min(found["elasticity"][1:])
