"""The notebook on swings runs from top to bottom without any data, and finds what it made."""

from __future__ import annotations

import json
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient

NOTEBOOK = Path(__file__).parents[1] / "notebooks" / "modal.py"


def test_made_up_log(tmp_path: Path, monkeypatch):
    monkeypatch.delenv("BAYESCHUTE_DATA", raising=False)
    notebook = jupytext.read(NOTEBOOK)
    expression = """dict(
        frequency=found["made up"].fit.frequency, damping=found["made up"].fit.damping_ratio,
        free=free["made up"].frequency, domain=domain["made up"], trusted=found["made up"].fit.trusted,
        truth=[TRUE_FREQUENCY, TRUE_DAMPING],
    )"""
    last = nbformat.v4.new_code_cell(f"import json\nprint(json.dumps({expression}))")
    notebook.cells.append(last)
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs), "no figure is shown"
    made = json.loads(last["outputs"][-1]["text"])
    for (mean, sd, low, high), truth in zip((made["frequency"], made["damping"]), made["truth"], strict=True):
        assert abs(mean - truth) < 3.0 * sd and low < mean < high
    assert made["trusted"]
    assert made["free"][1] < made["frequency"][1]
    assert abs(made["domain"] - made["frequency"][0]) < 4.0 * made["frequency"][1]
