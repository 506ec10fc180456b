"""What bayeschute runs on: a lock with hashes, licences, and installs in empty environments.

    python benchmarks/supply.py lock        # requirements.lock, from pyproject.toml and constraints.txt
    python benchmarks/supply.py install     # wheel and sdist in empty environments: newest, locked, oldest versions
    python benchmarks/supply.py licences    # licences of the packages that this environment runs on
    python benchmarks/supply.py page        # docs/supply.md, from what the last two have stored

`install` builds the wheel and the source distribution, puts each into environments that hold nothing else, and has
``init``, ``check`` and ``run --quick`` work there. ``uv`` does lock, builds and environments (extra ``bench``).
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from email.message import Message
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from calibration_page import _table as table
from command import parser_of
from packaging.requirements import Requirement

from bayeschute.study.evidence.provenance import provenance

Result = dict[str, Any]
ROOT = Path(__file__).parents[1]
LOCK = ROOT / "requirements.lock"
PAGE = ROOT / "docs/supply.md"
STORED = ROOT / "models/reference/supply"
OLDEST = "3.11"  # Python that the lock must serve
_SPDX = {  # names that packages write in their licence field or classifier, and what they mean
    "Apache Software License": "Apache-2.0",
    "Apache License": "Apache-2.0",
    "BSD License": "BSD",
    "BSD 3-Clause License": "BSD-3-Clause",
    "MIT License": "MIT",
    "ISC License": "ISC",
    "ISC License (ISCL)": "ISC",
    "Python Software Foundation License": "PSF-2.0",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0",
}
_PERMISSIVE = re.compile(r"(Apache-2\.0|BSD|MIT|ISC|PSF|HPND|Zlib|0BSD|CC0|Unlicense)[\w.-]*")
_EXPLAINED = {
    "tqdm": "MPL-2.0 covers files of its own; it is used unchanged, which asks for nothing but its notice",
}
"""Packages whose licence is not only a permissive one, and why they may be used."""


class Licence(NamedTuple):
    """Of a package.

    Attributes:
        package: Its name.
        version: Its version.
        licence: SPDX expression where the package gives one, else the words of its metadata.
        permissive: Whether every part of it is.
        note: Why it is used where not.
    """

    package: str
    version: str
    licence: str
    permissive: bool
    note: str


def same_name(package: str) -> str:
    """A package's name as indices compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", package).lower()


def licence_of(metadata: Message) -> str:
    """The licence that a package's metadata states: expression, then a short field, then classifiers; or `unknown`."""
    if expression := metadata.get("License-Expression"):
        return str(expression)
    field = str(metadata.get("License") or "").strip()
    if field and "\n" not in field and len(field) <= 40 and not field.lower().startswith("copyright"):
        return _SPDX.get(field, field)
    told = [str(line).split("::")[-1].strip() for line in metadata.get_all("Classifier") or ()
            if str(line).startswith("License ::")]  # fmt: skip
    return " AND ".join(_SPDX.get(one, one) for one in told if one != "OSI Approved") or "unknown"


def is_permissive(licence: str) -> bool:
    """Whether every licence that must be kept is permissive: of alternatives one is enough."""
    parts = re.split(r"\s+AND\s+", licence.replace("(", "").replace(")", ""))
    return all(any(_PERMISSIVE.match(one.strip()) for one in re.split(r"\s+OR\s+", part)) for part in parts)


def needed(
    package: str = "bayeschute", extras: Sequence[str] = (), seen: set[tuple[str, ...]] | None = None
) -> set[str]:
    """Names of a package and all that it needs here, declared dependencies of dependencies included.

    Raises:
        PackageNotFoundError: If one of them is not installed.
    """
    seen = set() if seen is None else seen
    key = (same_name(package), *sorted(extras))
    if key in seen:
        return set()
    seen.add(key)
    found = {same_name(package)}
    for text in distribution(package).requires or ():
        one = Requirement(text)
        if one.marker is None or any(one.marker.evaluate({"extra": extra}) for extra in (*extras, "")):
            found |= needed(one.name, tuple(one.extras), seen)
    return found


def licences() -> list[Licence]:
    """Of everything that this environment runs bayeschute on, but for itself."""
    made = []
    for name in sorted(needed() - {"bayeschute"}):
        metadata = distribution(name).metadata
        said = licence_of(metadata)
        made.append(Licence(name, str(metadata["Version"]), said, is_permissive(said), _EXPLAINED.get(name, "")))
    return made


def lock() -> None:
    """Write the lock anew: versions of constraints.txt for every Python and platform, each with its files' hashes."""
    asked = ["pip", "compile", "pyproject.toml", "--universal", "--python-version", OLDEST, "--generate-hashes"]
    given = ["-c", "constraints.txt", "--no-header", "--no-annotate", "--quiet", "-o", LOCK.name]
    _uv([*asked, *given], cwd=ROOT)


def pinned(text: str) -> Iterator[tuple[str, str, str, int]]:
    """Package, version, marker and number of hashes of every entry of a lock."""
    for entry in re.split(r"\n(?=\S)", text.strip()):
        head, *hashes = entry.replace("\\\n", "").split("--hash=")
        one = Requirement(head.strip())
        (spec,) = one.specifier
        yield same_name(one.name), spec.version, str(one.marker or ""), len(hashes)


def _uv(given: Sequence[str], cwd: Path | None = None, **more: Any) -> subprocess.CompletedProcess[str]:
    tool = shutil.which("uv", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")]))
    if tool is None:
        sys.exit("uv is not installed: pip install -e '.[bench]'")
    return subprocess.run([tool, *given], cwd=cwd, check=True, text=True, **more)


def build(folder: Path) -> tuple[Path, Path]:
    """The wheel and the source distribution, built of the checkout's committed and uncommitted files."""
    _uv(["build", "--quiet", "--out-dir", str(folder), str(ROOT)])
    (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
    return wheel, sdist


_WAYS = {
    "declared": "newest versions that pyproject.toml allows",
    "locked": "versions of requirements.lock, their files checked by hash",
    "oldest": "oldest versions that pyproject.toml allows of what it names, on the oldest Python",
}


def install(built: Path, python: str, way: str, folder: Path) -> Result:
    """Install in an empty environment, have the commands work there, and tell what came of it.

    Args:
        built: Wheel or source distribution.
        python: Interpreter, as uv finds it.
        way: Key of `_WAYS`.
        folder: Empty folder for environment and work.
    """
    home, work = folder / "env", folder / "work"
    work.mkdir()
    _uv(["venv", "--quiet", "--python", python, str(home)])
    into = ["pip", "install", "--quiet", "--python", str(home / "bin" / "python")]
    told: Result = {"python": python, "of": "wheel" if built.suffix == ".whl" else "sdist", "way": way}
    begun = perf_counter()
    try:
        if way == "locked":
            _uv([*into, "--require-hashes", "-r", str(LOCK)], stderr=subprocess.PIPE)
        more = {"locked": ["--no-deps"], "oldest": ["--resolution", "lowest-direct"], "declared": []}[way]
        _uv([*into, *more, str(built)], stderr=subprocess.PIPE)
    except subprocess.CalledProcessError as error:
        return told | {"failed": "install", "words": error.stderr.strip()[-2000:]}
    told["install_s"] = perf_counter() - begun
    command, cleared = str(home / "bin" / "bayeschute"), {"PYTHONPATH", "PYTHONHOME"}
    environment = {key: value for key, value in os.environ.items() if key not in cleared}
    for step in (
        ["init", "mine"],
        ["check", "mine/virtual.toml"],
        ["run", "mine/virtual.toml", "--quick", "--out", "run"],
    ):
        begun = perf_counter()
        made = subprocess.run([command, *step], cwd=work, env=environment, text=True, capture_output=True)
        told[f"{step[0]}_s"] = perf_counter() - begun
        summary = work / "run" / "summary.json"
        if made.returncode not in (0, 1) or (step[0] == "run") != summary.is_file():
            return told | {"failed": step[0], "words": (made.stdout + made.stderr)[-2000:]}
    found = json.loads(summary.read_text(encoding="utf-8"))
    told["versions"] = found["versions"]
    told["parameters"] = {name: [one["mean"], one["sd"]] for name, one in found["parameters"].items()}
    return told


def apart(rows: Sequence[Result]) -> float:
    """Largest difference of a parameter's mean between installs, in its standard deviations; NaN with less than two."""
    done = [row["parameters"] for row in rows if "parameters" in row]
    if len(done) < 2:
        return float("nan")
    first = done[0]
    return max(abs(other[name][0] - first[name][0]) / first[name][1] for other in done[1:] for name in first)


_TOP = """\
# What bayeschute runs on

Written by `python benchmarks/supply.py page`; do not edit. Numbers behind it, with the command, machine and versions of
each: `models/reference/supply/*.json`.

`requirements.lock` holds versions for Python 3.11 to 3.13 and all platforms, with the hashes of their files:

```sh
python -m pip install --require-hashes -r requirements.lock
python -m pip install --no-deps .
```

Known vulnerabilities are listed by `pip-audit --require-hashes -r requirements.lock`, which asks a service on the
internet. What it says changes from day to day, so no result is kept here: run it before you rely on an install.
"""
_INSTALLS = """\
## Installs in empty environments

Wheel and source distribution, installed where there was nothing else (`benchmarks/supply.py install`); then `init`,
`check` and `run --quick` work there. *quick run*: seconds on the clock, beside other work. *versions*:

{ways}
"""
_APART = """\
Means of the parameters of these quick runs, on other versions of Python and of libraries, differ by at most
{apart:.2g} of their standard deviations.
"""
_LICENCES = """\
## Licences

Of {count} packages that an install runs on ({python}), by their own metadata.
"""


def page(installs: Mapping[str, Any] | None, found: Mapping[str, Any] | None) -> str:
    """The page, of what is stored."""
    made = [_TOP]
    if installs is not None:
        rows = [
            (
                row["python"], row["of"], row["way"],
                f"`{row['failed']}` failed" if "failed" in row else "works",
                f"{row['run_s']:.0f}" if "run_s" in row else "–",
            )
            for row in installs["rows"]
        ]  # fmt: skip
        ways = "\n".join(f"- {name}: {words}" for name, words in _WAYS.items())
        made.append(_INSTALLS.format(ways=ways))
        made.append("\n".join(table(("Python", "of", "versions", "outcome", "quick run, s"), rows)))
        if np.isfinite(far := apart(installs["rows"])):
            made.append(_APART.format(apart=far))
        made.append(_by(installs))
    if found is not None:
        python = f"Python {found['provenance']['versions']['python']}"
        made.append(_LICENCES.format(count=len(found["rows"]), python=python))
        rows = [(one.package, one.version, one.licence, one.note or ("" if one.permissive else "not explained"))
                for one in (Licence(*row) for row in found["rows"])]  # fmt: skip
        made.append("\n".join(table(("package", "version", "licence", "note"), rows)))
        made.append(_by(found))
    return "\n".join(f"{part.rstrip()}\n" for part in made)


def _by(found: Mapping[str, Any]) -> str:
    by = found["provenance"]
    return f"Made by `{by['command']}`, commit `{by['commit'][:7]}`, {by['date']}, {by['machine']}."


def stored(name: str) -> Result | None:
    """A stored result, if there is one."""
    path = STORED / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def _store(name: str, rows: Sequence[Any], command: str) -> None:
    STORED.mkdir(parents=True, exist_ok=True)
    kept = {"rows": list(rows), "provenance": provenance(f"benchmarks/supply.py {command}")}
    (STORED / f"{name}.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Do what is asked; exit code 1 where an install fails or a licence is neither permissive nor explained."""
    parser = parser_of(__doc__)
    parser.add_argument("what", choices=("lock", "install", "licences", "page"))
    parser.add_argument("--python", nargs="+", default=["3.11", "3.13"], metavar="X.Y", help="interpreters of install")
    given, bad = parser.parse_args(), False
    rows: list[Any] = []
    match given.what:
        case "lock":
            lock()
        case "licences":
            rows = [tuple(one) for one in licences()]
            bad = any(not one.permissive and not one.note for one in (Licence(*row) for row in rows))
            _store("licences", rows, "licences")
            print("\n".join(table(Licence._fields, [tuple(map(str, row)) for row in rows])))
        case "install":
            with tempfile.TemporaryDirectory() as at:
                wheel, sdist = build(Path(at))
                for python in given.python:  # before anything long: uv would look for it on the internet
                    _uv(["python", "find", "--quiet", "--no-python-downloads", python], stdout=subprocess.DEVNULL)
                first = given.python[0]  # for which there are files of the oldest versions
                asked = [(wheel, python, way) for python in given.python for way in ("declared", "locked")]
                asked += [(wheel, first, "oldest"), (sdist, first, "declared")]
                for number, (built, python, way) in enumerate(asked):
                    (folder := Path(at) / str(number)).mkdir()
                    rows.append(install(built, python, way, folder))
                    print({key: value for key, value in rows[-1].items() if key != "parameters"}, flush=True)
                    _store("installs", rows, f"install --python {' '.join(given.python)}")
            bad = any("failed" in row for row in rows)
        case "page":
            PAGE.write_text(page(stored("installs"), stored("licences")), encoding="utf-8")
    if given.json:
        print(json.dumps(rows))
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    try:
        main()
    except PackageNotFoundError as error:
        sys.exit(f"{error} is not installed: pip install -e . in this environment first")
    except subprocess.CalledProcessError as error:
        sys.exit(f"{' '.join(map(str, error.cmd))} ended with {error.returncode}")
