"""Where a stored number comes from: a checkout, a changed one, or none."""

from __future__ import annotations

import re
import shutil
import subprocess

import pytest

from bayeschute.study.evidence import provenance as module


def git(folder, *words):
    who = ["-c", "user.name=a", "-c", "user.email=a@b"]
    return subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    if shutil.which("git") is None:
        pytest.skip("no git")
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    place = tmp_path / "provenance.py"
    place.write_text("one\n")
    git(tmp_path, "init", "-q")
    monkeypatch.setattr(module, "__file__", str(place))
    return place


def test_a_commit_is_marked_where_any_file_was_changed_and_told_only_for_a_file_of_it(checkout):
    assert module.commit() is None  # a package inside somebody else's checkout
    git(checkout.parent, "add", "provenance.py")
    git(checkout.parent, "commit", "-qm", "one")
    head = git(checkout.parent, "rev-parse", "HEAD")
    assert module.commit() == head
    checkout.write_text("two\n")
    assert module.commit() == f"{head}+"


def test_what_lies_in_no_checkout_or_has_no_git_has_no_commit(checkout, monkeypatch):
    shutil.rmtree(checkout.parent / ".git")
    assert module.commit() is None
    monkeypatch.setenv("PATH", "")
    assert module.commit() is None


def test_a_result_tells_how_it_was_made(monkeypatch):
    monkeypatch.setattr(module, "commit", lambda: "abc+")
    monkeypatch.setattr(module, "numerics", lambda: "a hash")
    told = module.provenance("make it")
    assert (told["command"], told["commit"], told["numerics"]) == ("make it", "abc+", "a hash")
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", told["date"]) and " cores, " in told["machine"]
    assert set(told["versions"]) == {"bayeschute", "jax", "numpy", "scipy", "python"} and all(told["versions"].values())
