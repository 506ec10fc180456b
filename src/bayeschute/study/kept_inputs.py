"""Inputs of a run, kept in its folder: ``study.toml`` and ``inputs/``, from which the run can be made again.

Study and vehicle are kept as they were written, comments included; only the paths of the files that they name, and the
seed where the command gave another one, are changed.
"""

from __future__ import annotations

import json
import os
import re
import tomllib
from functools import partial
from pathlib import Path

from bayeschute.core.files import write_whole
from bayeschute.study.load import load_study
from bayeschute.study.schema.sidecar import DATA, data_folder
from bayeschute.study.study import Study, study_hash

FOLDER = "inputs"
"""Of a run's folder, with the files that its study names."""
_NAMED_FILE = re.compile(r"""\b(file|vehicle)(["']?\s*=\s*)("(?:[^"\\\n]|\\.)*"|'[^'\n]*')""")  # key, between, value


class _Copies:
    """Files to be copied into one folder, each once, under its own name or, where that is taken, with a number.

    All are read before the first is written, since the originals may lie in that folder under other names.
    """

    def __init__(self, data: str) -> None:
        self._data, self._names, self._contents = data, dict[Path, str](), dict[str, bytes]()

    def named(self, text: str, beside: Path, prefix: str) -> str:
        """A TOML text with the paths of its files replaced by those of their copies.

        Args:
            text: The text.
            beside: Folder that its paths are relative to.
            prefix: Of the copies' paths in the new text.
        """

        def changed(found: re.Match[str]) -> str:
            key, between, quoted = found.groups()
            name = tomllib.loads(f"it = {quoted}")["it"]
            path = Path(os.path.normpath(beside / name.replace(DATA, self._data or DATA)))
            if not path.is_file():  # of a comment
                return found[0]
            return f"{key}{between}{json.dumps(prefix + self._copied(path, key == 'vehicle'), ensure_ascii=False)}"

        return _NAMED_FILE.sub(changed, text)

    def _copied(self, path: Path, is_toml: bool) -> str:
        """Name of the copy."""
        path = path.resolve()
        if path not in self._names:
            taken, number, name = {other.lower() for other in self._names.values()}, 1, path.name
            while name.lower() in taken:
                number += 1
                name = f"{path.stem}-{number}{path.suffix}"
            self._names[path] = name
            content = path.read_bytes()
            if is_toml:
                content = self.named(content.decode("utf-8-sig"), path.parent, "").encode()
            self._contents[name] = content
        return self._names[path]

    def write(self, folder: Path) -> None:
        """Write the copies, and remove what an earlier study left."""
        for name, content in self._contents.items():
            write_whole(folder / name, partial(Path.write_bytes, data=content))
        for path in folder.glob("*"):
            if path.name not in self._contents and path.is_file():
                path.unlink()


def keep(study: Study, folder: Path, head: str, data_dir: Path | str | None = None) -> str:
    """Write ``study.toml`` and ``inputs/`` into a run's folder.

    Args:
        study: As it was read, with the seed of the run.
        folder: The run's folder; the study may itself lie there.
        head: Comment lines for the head of ``study.toml``.
        data_dir: What ``${DATA}`` stands for; default: the environment variable BAYESCHUTE_DATA.

    Returns:
        Why the run can't be made again from its folder; empty where it can.
    """
    copies, copy = _Copies(data_folder(data_dir)), folder / "study.toml"
    text = _seeded(copies.named(study.text, study.path.parent, f"{FOLDER}/"), study.seed)
    copies.write(folder / FOLDER)
    write_whole(copy, partial(Path.write_text, data=f"{head}\n\n{text}", encoding="utf-8"))
    if not study.text:
        return "its study was not read from a file"
    if study_hash(load_study(copy)) != study_hash(study):
        return f"{copy.name} with the files in {FOLDER} is not the study that was run"
    return ""


def _seeded(text: str, seed: int) -> str:
    """A study with another seed."""
    if not text or tomllib.loads(text).get("seed") == seed:
        return text
    line, had = re.subn(r"(?m)^seed\s*=\s*\d+", f"seed = {seed}", text, count=1)
    return line if had else f"seed = {seed}\n{text}"
