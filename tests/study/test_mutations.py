"""Studies and vehicles changed at random are either sound or refused in words; nothing else ever comes out."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bayeschute.core.errors import InputError
from bayeschute.study.load import load_study, load_vehicle
from bayeschute.study.templates import template

TEXTS = {name: template(name).read_text(encoding="utf-8") for name in ("vehicle.toml", "virtual.toml", "descent.toml")}
PIECES = ["-", '"', "[", "]", "{", "}", "=", "nan", "inf", "1e999", "0", "9" * 400, "true", "''", "[[flight]]", "ft",
          "\n", "\x00", "²", "1979-05-27", "../", "${DATA}", "%", "[1,2]", "{a=1}", "\\", "0xffffffffffffffff"]  # fmt: skip


@st.composite
def mutated(draw: st.DrawFn, text: str) -> str:
    """A text with one to three of its words or lines replaced, removed, doubled or added to."""
    for _ in range(draw(st.integers(1, 3))):
        lines = text.split("\n")
        row = draw(st.integers(0, len(lines) - 1))
        kind = draw(st.sampled_from(["piece", "cut", "double", "remove", "value", "swap"]))
        line = lines[row]
        at = draw(st.integers(0, len(line)))
        if kind == "piece":
            lines[row] = line[:at] + draw(st.sampled_from(PIECES)) + line[at:]
        elif kind == "cut":
            lines[row] = line[:at]
        elif kind == "double":
            lines.insert(row, line)
        elif kind == "remove":
            del lines[row]
        elif kind == "value" and "=" in line:
            key = line.split("=")[0]
            lines[row] = f"{key}= {draw(st.sampled_from([*PIECES, '0', '-1.5', '[]', '{}', '0.1', '[[]]', '99']))}"
        else:
            other = draw(st.integers(0, len(lines) - 1))
            lines[row], lines[other] = lines[other], lines[row]
        text = "\n".join(lines)
    return text


@pytest.mark.parametrize("name", list(TEXTS))
@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_mutated_files_are_read_or_refused(tmp_path: Path, name: str, data: st.DataObject):
    for other, text in TEXTS.items():
        (tmp_path / other).write_text(text, encoding="utf-8")
    (tmp_path / "my-descent.csv").write_text("time_s,altitude_m\n0,1\n", encoding="utf-8")
    path = tmp_path / name
    path.write_text(data.draw(mutated(TEXTS[name])), encoding="utf-8")
    try:
        load_vehicle(path) if name == "vehicle.toml" else load_study(path)
    except InputError as error:
        assert error.faults
        for fault in error.faults:
            assert fault.where and fault.got and fault.wanted
            assert len(str(fault)) < 1500
