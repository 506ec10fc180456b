"""The made-up run folder and its report, built once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from bayeschute.report import page
from bayeschute.report.page import Picture, build_report
from bayeschute.report.run_results import Results, read_results
from tests.report.synthetic_run import build_run


@pytest.fixture(scope="session")
def make_run() -> Callable[..., Path]:
    return build_run


@pytest.fixture(scope="session")
def run_dir(make_run, tmp_path_factory) -> Path:
    folder = make_run(tmp_path_factory.mktemp("run"), quick=True)
    build_report(folder)
    return folder


@pytest.fixture(scope="session")
def results(run_dir) -> Results:
    return read_results(run_dir)


@pytest.fixture
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports whose pictures nobody looks at: drawing them takes four fifths of the time."""
    monkeypatch.setattr(page, "_picture", lambda figure, folder, name, alt, caption: Picture("data:,", alt, caption))
