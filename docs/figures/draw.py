"""Draw the figures of README and gallery: ``python docs/figures/draw.py [NAME ...]``, all where none is named.

Each figure is made by a block of ``docs/gallery.md`` that leaves it in ``figure``; the comment at its head names it.
Run it from the project's folder, where ``make demo`` has left its run.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from bayeschute.report.figures.canvas import save

HERE = Path(__file__).parent
BLOCK = re.compile(r"^```python\n# (\S+)\.svg\n(.*?)^```$", re.S | re.M)


def blocks() -> dict[str, str]:
    """Lines that make each figure, by its name."""
    return dict(BLOCK.findall((HERE.parent / "gallery.md").read_text(encoding="utf-8")))


def draw(names: list[str], folder: Path = HERE) -> list[Path]:
    """Run the blocks of some figures, and save these; returns their paths."""
    lines, made = blocks(), []
    for name in names:
        if name not in lines:
            raise SystemExit(f"no figure {name!r}; there are {', '.join(lines)}")
    for name in names or list(lines):
        space: dict[str, object] = {}
        exec(compile(lines[name], f"gallery.md, {name}", "exec"), space)
        made.append(save(space["figure"], folder, name))
        made[-1].with_suffix(".png").unlink()
    return made


if __name__ == "__main__":
    for path in draw(sys.argv[1:]):
        print(f"{path}: {path.stat().st_size / 1024:.0f} kB")
