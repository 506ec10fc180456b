"""The made-up run folder and its report, built once."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import pytest

from bayeschute.report.page import build_report
from bayeschute.report.run_results import Results, read_results


@pytest.fixture(scope="session")
def make_run() -> Callable[..., Path]:
    spec = importlib.util.spec_from_file_location("synthetic_run", Path(__file__).with_name("synthetic_run.py"))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.build_run


@pytest.fixture(scope="session")
def run_dir(make_run, tmp_path_factory) -> Path:
    folder = make_run(tmp_path_factory.mktemp("run"), quick=True)
    build_report(folder)
    return folder


@pytest.fixture(scope="session")
def results(run_dir) -> Results:
    return read_results(run_dir)
