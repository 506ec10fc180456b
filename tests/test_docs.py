"""Documentation: no dead link, every public name and page is in it, its code runs, and the site builds."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import draw
import pytest

import bayeschute as bc
from bayeschute.study.evidence.numerics_hash import numerics
from tests.pages import anchors, blocks, dead_links, faults_of_commands

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
MARK = "<!-- compiled only"
PYTHON = re.compile(r"(<!-- compiled only[^\n]*\n)?^```python\n(.*?)^```$", re.S | re.M)


def _python(page: Path) -> list[tuple[bool, str]]:
    """Python blocks of a page: whether they are to be run, and their lines."""
    return [(not mark, text) for mark, text in PYTHON.findall(page.read_text(encoding="utf-8"))]


def test_dead_links_are_found(tmp_path):
    page = tmp_path / "a.md"
    page.write_text("# One two\n[x](#one-two) [y](#three) [z](b.md) [w](https://example.org)\n")
    assert dead_links(page, tmp_path) == ["a.md: no heading #three", "a.md: no file b.md"]


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda p: p.relative_to(ROOT).as_posix())
def test_no_link_is_dead(page):
    assert dead_links(page, ROOT) == []


def test_no_page_keeps_both_sides_of_a_merge():
    mark = re.compile(r"^(<{7}|={7}|>{7})( |$)", re.M)
    assert mark.search("a\n<<<<<<< HEAD\nb") and not mark.search("=========\n <<<<<<< \n")
    pages = [*ROOT.glob("*.md"), *PAGES, *(ROOT / "notebooks").glob("*.py"), *(ROOT / "models").rglob("*.toml")]
    assert [page for page in pages if mark.search(page.read_text(encoding="utf-8"))] == []


def test_every_public_name_has_a_page():
    told = "\n".join(page.read_text(encoding="utf-8") for page in (DOCS / "reference").glob("*.md"))
    assert set(re.findall(r"^::: bayeschute\.(\w+)$", told, re.M)) == set(bc.__all__) - {"__version__"}


def test_every_page_is_in_the_contents():
    contents = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert [page for page in PAGES if page.relative_to(DOCS).as_posix() not in contents] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(DOCS).as_posix())
def test_code_of_every_page_is_sound(page):
    for _, text in _python(page):
        ast.parse(text)
    for text in blocks(page, "toml"):
        tomllib.loads(text)
    assert faults_of_commands(blocks(page, "sh")) == []


def test_there_are_twenty_questions_and_most_answers_run():
    page = DOCS / "howto.md"
    assert page.read_text(encoding="utf-8").count("\n### ") >= 20
    run = [ran for ran, _ in _python(page)]
    assert sum(run) >= 15 and len(run) - sum(run) <= 2


def test_answers_of_the_how_to_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    space: dict[str, object] = {}
    for ran, text in _python(DOCS / "howto.md"):
        if ran:
            exec(compile(text, "howto.md", "exec"), space)
    assert space["posterior"].passed and abs(space["posterior"]["cds_over_mass"].values.mean() - 0.16) < 0.03
    assert "True" in capsys.readouterr().out.splitlines()[-1]


def test_commands_are_all_described():
    import typer

    from bayeschute.cli import app

    text = (DOCS / "commands.md").read_text(encoding="utf-8")
    assert [name for name in typer.main.get_command(app).commands if f"| `{name} " not in text] == []


def test_a_gallery_picture_is_there_for_every_block_and_the_reverse():
    named = re.findall(r"^# (\S+\.svg)$", (DOCS / "gallery.md").read_text(encoding="utf-8"), re.M)
    shown = re.findall(r"\(figures/(\S+\.svg)\)", (DOCS / "gallery.md").read_text(encoding="utf-8"))
    assert named == shown and set(named) == {path.name for path in (DOCS / "figures").glob("*.svg")}


def test_a_block_of_the_gallery_draws_its_picture(tmp_path):
    (path,) = draw.draw(["limit-cycle"], tmp_path)
    assert path.read_text(encoding="utf-8").startswith("<?xml") and not list(tmp_path.glob("*.png"))


def test_a_notebook_on_measured_records_is_not_rendered_without_them(monkeypatch):
    """It would end with nothing found; the shipped one has found something."""
    import render

    about, other = (render.NOTEBOOKS / f"{name}.py" for name in ("population", "cluster"))
    monkeypatch.delenv(render.DATA, raising=False)
    assert render.lacks_records(about) and not render.lacks_records(other)
    monkeypatch.setenv(render.DATA, "measured")
    assert not render.lacks_records(about)
    assert "8 records of dropsondes" in about.with_suffix(".ipynb").read_text(encoding="utf-8")


def test_a_notebook_is_rendered_with_its_outputs(tmp_path):
    import render

    source = tmp_path / "one.py"
    source.write_text("# %% [markdown]\n# # One\n\n# %%\n1 + 1\n", encoding="utf-8")
    told = json.loads(render.render(source).read_text(encoding="utf-8"))
    assert [cell["cell_type"] for cell in told["cells"]] == ["markdown", "code", "markdown"]
    assert told["cells"][1]["outputs"][0]["data"]["text/plain"] == ["2"]
    assert f"numerics `{numerics()[:8]}`" in "".join(told["cells"][2]["source"])


def test_every_file_and_function_of_the_report_index_exists():
    faults, rows = [], 0
    for line in (DOCS / "report-index.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("| ") or len(cells) < 4 or cells[2].startswith("file"):
            continue
        rows += 1
        paths = [ROOT / "src/bayeschute" / name for name in re.findall(r"`([^`]+)`", cells[2])]
        missing = [path.name for path in paths if not path.is_file()]
        text = "".join(path.read_text(encoding="utf-8") for path in paths if path.is_file())
        names = re.findall(r"`(\w+)`", cells[3])
        faults += [f"{cells[0]}: no file {name}" for name in missing]
        faults += [f"{cells[0]}: no {n}" for n in names if not re.search(rf"^(def|class) {n}\b|^{n}\b", text, re.M)]
    assert rows > 50 and not faults, "\n".join(faults)


def test_the_report_index_has_every_equation():
    """Equation numbers of each section without a gap: 6.1 to 6.3.7."""
    last = {"6.1": 20, "6.3.1": 33, "6.3.2": 29, "6.3.3": 22, "6.3.5": 15, "6.3.6": 14, "6.3.7": 8}
    found: dict[str, set[int]] = {section: set() for section in last}
    for cell in re.findall(r"^\| ([67][\d., -]*) \|", (DOCS / "report-index.md").read_text(encoding="utf-8"), re.M):
        section = cell.split("-")[0]
        for first, end in re.findall(r"-(\d+)(?:\.\.(\d+))?", cell):
            if section in found:
                found[section] |= set(range(int(first), int(end or first) + 1))
    lacking = {s: sorted(set(range(1, n + 1)) - found[s]) for s, n in last.items() if set(range(1, n + 1)) - found[s]}
    assert lacking == {}


def test_the_anchors_of_headings_are_those_of_the_site():
    assert {"methods", "structure-and-priors"} & anchors(DOCS / "howto.md") == {"structure-and-priors"}


@pytest.mark.skipif(importlib.util.find_spec("mkdocs") is None, reason="mkdocs is not installed: make docs")
def test_the_site_builds_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    )
    assert done.returncode == 0, done.stdout + done.stderr
    index = (tmp_path / "site/index.html").read_text(encoding="utf-8")
    assert not re.search(r'(?:src|rel="stylesheet" href)="https?://', index)
    assert "<math" in (tmp_path / "site/methods/prediction.html").read_text(encoding="utf-8")
