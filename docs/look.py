"""Look at pages in a browser: pictures at two widths, light, dark and printed, and an accessibility check.

``python docs/look.py PAGE.html [...] --out FOLDER [--axe axe.min.js]`` writes ``NAME-WIDTH-SCHEME.png``, ``NAME.pdf``
and, with axe-core (``npm pack axe-core``), its findings, which are printed too; exit code 1 if any is serious. Qt's
Chromium needs no display: ``pip install 'PySide6-Addons==6.8.*'`` in an environment of its own.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

WIDTHS, SCHEMES = (1280, 400), ("light", "dark")
_TALLEST = 16_000  # of a picture [pixels]
_SETTLED = 2_000  # [ms] until fonts and pictures are there
_RULES = """axe.run().then(
    found => window.found = JSON.stringify(found.violations),
    error => window.found = JSON.stringify([{id: `${error}`}]));"""


def look(page: Path, out: Path, width: int, scheme: str, axe: Path | None, printed: bool) -> list[dict]:
    """Picture and findings of a page; one process for each, as the scheme is set once for all of a browser."""
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    os.environ["QTWEBENGINE_DISABLE_SANDBOX"] = "1"
    os.environ["QTWEBENGINE_CHROMIUM_FLAGS"] = (
        f"--disable-gpu --blink-settings=preferredColorScheme={0 if scheme == 'dark' else 1}"
    )
    from PySide6.QtCore import QEventLoop, QTimer, QUrl
    from PySide6.QtWebEngineWidgets import QWebEngineView
    from PySide6.QtWidgets import QApplication

    app, view, loop = QApplication([]), QWebEngineView(), QEventLoop()

    def told(script: str) -> object:
        got: list[object] = []
        view.page().runJavaScript(script, 0, lambda value: (got.append(value), loop.quit()))
        loop.exec()
        return got[0]

    def wait(milliseconds: int) -> None:
        QTimer.singleShot(milliseconds, loop.quit)
        loop.exec()

    view.resize(width, 900)
    view.show()
    view.loadFinished.connect(loop.quit)
    view.load(QUrl.fromLocalFile(str(page.resolve())))
    loop.exec()
    wait(_SETTLED)
    height, wide = json.loads(
        str(told("JSON.stringify([document.documentElement.scrollHeight, document.documentElement.scrollWidth])"))
    )
    view.resize(width, min(int(height), _TALLEST))
    wait(_SETTLED)
    name = f"{page.parent.name}-{page.stem}" if page.stem == "index" else page.stem
    view.grab().save(str(out / f"{name}-{width}-{scheme}.png"))
    findings: list[dict] = []
    if wide > width:
        findings.append(
            {"id": "wider-than-the-window", "impact": "serious", "help": f"{wide} pixels at {width}", "nodes": []}
        )
    if axe is not None:
        told(axe.read_text(encoding="utf-8") + f"; {_RULES} 0")
        while not (found := told("window.found || ''")):
            wait(200)
        findings += json.loads(str(found))
    if printed:
        view.page().pdfPrintingFinished.connect(loop.quit)
        view.page().printToPdf(str(out / f"{name}.pdf"))
        loop.exec()
    app.quit()
    return findings


def main() -> int:
    """Look at all pages; returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("pages", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--axe", type=Path, help="axe.min.js of axe-core")
    parser.add_argument("--one", nargs=2, metavar=("WIDTH", "SCHEME"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    if given.one:
        width, scheme = int(given.one[0]), given.one[1]
        first = (width, scheme) == (WIDTHS[0], SCHEMES[0])
        print(json.dumps(look(given.pages[0], given.out, width, scheme, given.axe, first)))
        return 0
    serious = 0
    if missing := [str(page) for page in given.pages if not page.is_file()]:
        raise SystemExit(f"no such page: {', '.join(missing)}")
    for page in given.pages:
        for width in WIDTHS:
            for scheme in SCHEMES:
                command = [sys.executable, __file__, str(page), "--out", str(given.out), "--one", str(width), scheme]
                command += ["--axe", str(given.axe)] if given.axe else []
                made = subprocess.run(command, capture_output=True, text=True, check=False)
                if made.returncode:
                    raise SystemExit(f"{page} at {width} pixels, {scheme}: {made.stderr.strip()[-2000:]}")
                findings = json.loads(made.stdout.splitlines()[-1])
                print(f"{page}, {width} pixels, {scheme}: {len(findings)} findings")
                for one in findings:
                    where = ", ".join(" ".join(map(str, node["target"])) for node in one.get("nodes", [])[:5])
                    print(f"  {one.get('impact')}: {one['id']}: {one.get('help', '')} ({where})")
                    serious += one.get("impact") in ("serious", "critical", None)
    return 1 if serious else 0


if __name__ == "__main__":
    raise SystemExit(main())
