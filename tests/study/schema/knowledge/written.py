"""Tables of what others know, as they are written in a study."""

from __future__ import annotations

from pathlib import Path

COEFFICIENT = """
[[knowledge]]
name = "handbook"
source = "Knacke, table 5-1"
kind = "coefficient"
target = "axial[1]"
mean = 0.85
sd = 0.05
use = "prior"
"""
CURVE = """
[[knowledge]]
name = "tunnel"
source = "wind tunnel, 1/10 scale"
kind = "curve"
target = "C_N"
points = [["20 deg", 0.03, 0.01], ["10 deg", -0.01, 0.01]]
common_sd = 0.005
"""


def with_text(study: Path, text: str) -> Path:
    study.write_text(study.read_text(encoding="utf-8") + text, encoding="utf-8")
    return study
