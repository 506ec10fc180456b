"""The notebooks run from top to bottom, at small size where they have one, and find what they say."""

from __future__ import annotations

import ast
import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

import jupytext
import nbformat
import pytest
from jupyter_client import AsyncKernelManager
from jupyter_core.utils import run_sync
from nbclient import NotebookClient

from bayeschute.study.evidence.numerics_compared import comparisons, same_as
from bayeschute.study.evidence.numerics_hash import PACKAGE, hash_of

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
DATA = Path(os.environ.get("BAYESCHUTE_DATA") or "no-such-folder")

SETTINGS = "BAYESCHUTE_SMALL", "BAYESCHUTE_DATA"  # of the environment, that notebooks heed
Values = Callable[[str, str, Path], Any]

numerics_on = cache(partial(hash_of, PACKAGE))  # by libraries: a second of reading sources

MOST_IMPORTS = {"modal": 14}  # it calls the swing's parts one by one; others keep under a dozen


@pytest.fixture
def small(monkeypatch):
    """A small size: enough to run every line, not for use."""
    monkeypatch.setenv("BAYESCHUTE_SMALL", "1")


@pytest.fixture(scope="module")
def values() -> Iterator[Values]:
    """Execute a notebook and a last cell that tells an expression's value.

    All of a worker have one kernel, emptied before each, so that libraries are loaded and functions compiled once. In a
    kernel of its own each was run when it was rendered.
    """
    manager = AsyncKernelManager(kernel_name="python3")

    def of(name: str, expression: str, folder: Path) -> Any:
        notebook = jupytext.read(NOTEBOOKS / name)
        told = {name: os.environ[name] for name in SETTINGS if name in os.environ}
        lines = ["%reset -f", "import os", *(f"os.environ.pop({name!r}, None)" for name in SETTINGS)]
        first = nbformat.v4.new_code_cell(
            "\n".join([*lines, f"os.environ.update({told})", f"os.chdir({str(folder)!r})"])
        )
        last = nbformat.v4.new_code_cell(f"import json\nprint(json.dumps({expression}))")
        notebook.cells = [first, *notebook.cells, last]
        client = NotebookClient(notebook, timeout=600, km=manager, resources={"metadata": {"path": folder}})
        client.execute()
        client.kc.stop_channels()
        outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
        assert any("image/png" in output.get("data", {}) for output in outputs), "no figure is shown"
        return json.loads(last["outputs"][-1]["text"])

    yield of
    if manager.has_kernel:
        run_sync(manager.shutdown_kernel)(now=True)


def test_quickstart(values: Values, tmp_path: Path):
    expression = """dict(
        mean=drag.mean(), sd=drag.std(), truth=TRUE_DRAG, covered=covered, risk=vars(risk),
        plain=[float(theirs.mean()), float(theirs.std())], held=[float(held.mean()), float(held.std())],
        contraction=contraction, share=share, partner=partner,
        kinds=[repair.kind for repair in flight.repairs], groups=sorted(posterior.data.children),
        widths=[float((band["high"] - band["low"]).values[part].mean()) for part in (~held_out, held_out)],
    )"""
    found = values("quickstart.py", expression, tmp_path)
    assert abs(found["mean"] - found["truth"]) < 4.0 * found["sd"] < 0.1
    mean, sd = found["held"]
    assert abs(found["plain"][0] - mean) < 0.35 * sd and 0.8 < found["plain"][1] / sd < 1.25
    assert found["contraction"] > 0.95 and 0.2 < found["share"] < 0.5 and "wind" in found["partner"]
    wider = 1.0 - (sd / found["sd"]) ** 2  # of 800 draws; parts of the record that disagree widen it further
    assert found["share"] - 0.15 < wider < found["share"] + 0.3
    assert "spike" in found["kinds"]
    assert {"posterior", "prior", "log_likelihood"} <= set(found["groups"])
    assert found["widths"][1] > found["widths"][0]
    assert 0.3 < found["covered"] <= 1.0  # one or two independent gusts
    risk = found["risk"]
    assert 0.0 < risk["low"] <= risk["met"] <= risk["high"] <= 1.0
    assert risk["failed"] == 0


def test_behaviour(values: Values, tmp_path: Path):
    expression = """dict(
        cycle=cycle, endings=[one.ending for one in configurations], both=both.tolist(), slope=slope,
        elasticity=sensitivity.elasticity.tolist(),
    )"""
    found = values("behaviour.py", expression, tmp_path)
    amplitude, frequency, descent = found["cycle"]
    assert abs(amplitude - 0.380) < 0.005 and abs(frequency - 0.0698) < 0.0005 and 10.2 < descent < 10.4
    assert found["endings"] == ["limit cycle", "limit cycle", "glide", "vertical descent"]
    assert min(found["both"]) < -0.09 and max(found["both"]) > -0.03
    assert 1.0 < found["slope"] < 1.25
    assert found["elasticity"][0] < 0.0 < min(found["elasticity"][1:])


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.py")), ids=lambda p: p.stem)
def test_a_notebook_has_few_imports_and_says_what_it_found(path):
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    assert sum(isinstance(node, ast.Import | ast.ImportFrom) for node in ast.walk(tree)) < MOST_IMPORTS.get(
        path.stem, 12
    )
    assert text.count("# %% [markdown]") >= 3
    page = NOTEBOOKS.parent / "docs/notebooks.md"
    assert f"`{path.name}`" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.py")), ids=lambda p: p.stem)
def test_a_rendered_notebook_is_current(path):
    """The one beside a source was run, as a whole and without error, from this very text."""
    notebook = nbformat.read(path.with_suffix(".ipynb"), as_version=4)
    nbformat.validate(notebook)
    told = hashlib.sha256(path.read_text(encoding="utf-8").encode()).hexdigest()
    assert notebook.metadata["source_sha256"] == told, f"{path.name} was changed since: make notebooks"
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert all(output.output_type != "error" and output.get("name") != "stderr" for output in outputs)
    said = [output.get("text", "") + json.dumps(output.get("data", {}).get("text/plain", "")) for output in outputs]
    assert not re.search(r"/(tmp|home|root|work|Users)/|site-packages", " ".join(said)), "a path of some machine"


@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda p: p.stem)
def test_numbers_of_a_rendered_notebook_are_those_of_the_present_code(path):
    """Or count as those by a stored comparison. On the libraries that it was run on, which may be others here."""
    last = nbformat.read(path, as_version=4).cells[-1].source
    told = re.search(r"^\*Run on \d{4}-\d\d-\d\d by .*, numerics `(\w{8})` on (.*) \(`docs/render.py`\)", last)
    assert told, "no last line names the code that it was run by: make notebooks"
    here, found = numerics_on(told[2]), comparisons()
    kinds = {row.configuration for one in found for row in one.studies}
    alike = {here}.union(*(same_as(here, kind, found) for kind in kinds))
    assert told[1] in {one[:8] for one in alike}, f"{path.name} is of other numerics: make notebooks"


def test_quick_start_on_a_cluster(values: Values, small, tmp_path: Path):
    found = values("cluster.py", "dict(risk=vars(risk), shares=shares, terms=len(posterior.names))", tmp_path)
    assert 0.0 < found["risk"]["low"] <= found["risk"]["met"] <= 1.0 and found["risk"]["failed"] == 0
    assert sum(found["shares"].values()) == pytest.approx(1.0) and min(found["shares"].values()) >= 0.0
    assert found["shares"]["wind"] > found["shares"]["initial state"] and found["terms"] == 8


def test_landings(values: Values, small, tmp_path: Path):
    expression = """dict(
        met=[chance.low, chance.met, chance.high], failed=landings.failed, cells=len(placard.cells),
        drops=ranking.table.set_index("candidate")[["shrinking", "information"]].T.to_dict(), share=float(together),
    )"""
    found = values("landings.py", expression, tmp_path)
    assert found["failed"] == 0 and 0.0 <= found["met"][0] <= found["met"][1] <= found["met"][2] <= 1.0
    assert found["cells"] == 2 and 0.0 < found["share"] < 1.2 and set(found["drops"]) == {"calm-light", "swinging-long"}
    assert all(0.0 < drop["shrinking"] < 1.0 and drop["information"] > 0.0 for drop in found["drops"].values())


def test_own_record(values: Values, small, tmp_path: Path):
    expression = """dict(
        faults=faults, shift=shift, size=report.stat().st_size, kinds=[r.kind for r in flight.repairs],
        held={k: [float(np.quantile(v, q)) for q in (0.001, 0.999)] for k, v in found.items()},
    )"""
    found = values("own_record.py", expression, tmp_path)
    assert found["faults"] == 3 and {"spike", "gap"} <= set(found["kinds"])
    assert found["shift"] == pytest.approx(-0.04, abs=0.01)  # the air is 4 % thinner than standard
    low, high = found["held"]["with density"]
    assert low < 0.16 < high and 50_000 < found["size"] < 2_000_000


def test_structure(values: Values, small, tmp_path: Path):
    found = values("structure.py", "dict(within=within, false=stand_ins, missed=missed, chosen=dict(chosen))", tmp_path)
    assert found["chosen"]["axial[1]"] == found["chosen"]["transverse[rate]"] == 3
    assert found["within"] < 0.8 and found["false"] > 0  # else the text would say what isn't so


def test_reading_a_posterior(values: Values, small, tmp_path: Path):
    expression = """dict(
        correlation=correlation, narrowing=narrowing, outside=outside, least=least, flown=[low, high],
        contraction=told["contraction"].astype(float).to_dict(),
    )"""
    found = values("reading_a_posterior.py", expression, tmp_path)
    assert found["correlation"] < -0.5 and found["narrowing"] < 0.5 and found["outside"] > 2.0
    assert found["least"].startswith("riser_") and found["contraction"][found["least"]] < 0.3
    assert found["contraction"]["axial[1]"] > 0.8 and 0.0 < found["flown"][0] < found["flown"][1] < 0.7


def test_white_noise(values: Values, small, tmp_path: Path):
    found = values("white_noise.py", "dict(held=held, factor=factor)", tmp_path)
    assert found["held"]["white"] < 0.7 <= found["held"]["latent"] and found["factor"] > 4.0


def test_predict_and_check(values: Values, small, tmp_path: Path):
    expression = "dict(coverage={' '.join(k): v for k, v in coverage.items()}, loss=loss)"
    found = values("predict_and_check.py", expression, tmp_path)
    assert all(0.4 < share <= 1.0 for share in found["coverage"].values())
    assert found["coverage"]["calmer as fitted"] >= found["coverage"]["rougher as fitted"] and found["loss"] > 0.0


def test_next_test(values: Values, small, tmp_path: Path):
    expression = "dict(narrower=narrower, spread=spread, before=before, met=[m.met for m in met], shares=shares)"
    found = values("next_test.py", expression, tmp_path)
    assert 0.5 < found["narrower"] < 1.0 and found["met"] == sorted(found["met"])
    assert found["spread"] > 0.1 and found["before"] > 0.1 and found["shares"]["parameter"] < 0.5


def test_population_says_that_there_are_no_records(values: Values, small, monkeypatch, tmp_path: Path):
    monkeypatch.delenv("BAYESCHUTE_DATA", raising=False)
    assert values("population.py", "dict(files=len(files), members=len(members))", tmp_path) == {
        "files": 0,
        "members": 0,
    }


@pytest.mark.skipif(not DATA.is_dir(), reason="BAYESCHUTE_DATA names no folder of records")
def test_population_of_measured_drops(values: Values, small, tmp_path: Path):
    found = values("population.py", "dict(members=list(members), factor=factor, spread=float(spread.mean()))", tmp_path)
    assert len(found["members"]) == 3 and found["factor"] > 1.0 and 0.0 < found["spread"] < 1.0
