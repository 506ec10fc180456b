"""Where shipped results lie: those of the package go before those of a checkout."""

from __future__ import annotations

from pathlib import Path

from bayeschute.study.evidence import shipped as module


def test_data_of_the_package_go_before_the_checkout(tmp_path, monkeypatch):
    package = tmp_path / "src" / "bayeschute"
    monkeypatch.setattr(module.resources, "files", lambda name: {"bayeschute": package}[name])
    stored = Path("reference/calibration")
    assert module.shipped(stored) == tmp_path / "models" / stored
    (package / stored).mkdir(parents=True)
    assert module.shipped(stored) == package / stored
