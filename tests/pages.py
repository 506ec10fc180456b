"""Code blocks, commands, links and anchors of Markdown pages."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import typer

from bayeschute.cli import app

_BLOCK = re.compile(r"^```(\w+)[^\n]*\n(.*?)^```$", re.S | re.M)


def blocks(page: Path, language: str) -> list[str]:
    """Code blocks of a language, in their order."""
    return [text for kind, text in _BLOCK.findall(page.read_text(encoding="utf-8")) if kind == language]


def prose(page: Path) -> str:
    """A page without its code blocks."""
    return _BLOCK.sub("", page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as GitHub and MkDocs make them."""
    found = set()
    for title in re.findall(r"^#+ (.*)$", prose(page), re.M):
        words = re.sub(r"[^\w\- ]", "", re.sub(r"[`*]", "", title).lower()).strip()
        found.add(re.sub(r"[ -]+", "-", words))
    return found


def dead_links(page: Path, root: Path) -> list[str]:
    """Links of a page to files or headings that are not there."""
    dead = []
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"[a-z]+:", target):
            continue
        name, _, anchor = target.partition("#")
        other = (page.parent / name).resolve() if name else page
        if not other.exists() or root not in other.parents:
            dead.append(f"{page.name}: no file {target}")
        elif anchor and other.suffix == ".md" and anchor not in anchors(other):
            dead.append(f"{page.name}: no heading {target}")
    return dead


def faults_of_commands(scripts: list[str]) -> list[str]:
    """Commands and options of ``bayeschute`` in shell blocks that the program does not have."""
    known = typer.main.get_command(app).commands
    faults = []
    for line in "\n".join(scripts).replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if not words or not words[0].endswith("bayeschute"):
            continue
        command = known.get(words[1])
        if command is None:
            faults.append(f"{line}: no command {words[1]}")
            continue
        options = {option for one in command.params for option in one.opts}
        faults += [f"{line}: no option {word}" for word in words[2:] if word.startswith("--") and word not in options]
    return faults
