"""Programs of Runge-Kutta steps through the samples of a record, in LLVM's intermediate language."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from bayeschute.compiler.elementary import written_out
from bayeschute.compiler.emit import Code, Program
from bayeschute.compiler.graph import FLOAT, Graph
from bayeschute.compiler.sections import RUN, SAMPLE, STATE, Memory, Place, Sections


class Stage(NamedTuple):
    """Numbers of a stage, on all lanes; `share` is the share of the sample that has passed."""

    way: str
    weight: str
    share: str


class Arrays(NamedTuple):
    """Offsets of a quantity at the begin of a step, at the present stage, and summed up so far."""

    begin: int
    stage: int
    total: int


def arrays(memory: Memory, size: int) -> Arrays:
    """Memory for a quantity with this number of rows."""
    return Arrays(memory.take(size), memory.take(size), memory.take(size))


def stage_of(code: Code, step: str, number: str) -> Stage:
    """Read the plan for a stage."""
    way, weight, within = (
        code.spread("%plan", code.integer("add", number, code.integer("mul", "%stages", row))) for row in range(3)
    )
    step, steps = (code.new(f"sitofp i64 {count} to double") for count in (step, "%substeps"))
    passed = code.everywhere(code.new(f"fdiv double {step}, {steps}"))
    return Stage(way, weight, code.operation("add", FLOAT, [passed, within]))


def begin(code: Code, values: Sequence[str], held: Arrays, base: str = "%scratch") -> None:
    """Start with a value in every row."""
    for i, value in enumerate(values):
        for array in held:
            code.store(value, base, array + i * code.lanes)


def advance(code: Code, stage: Stage, rates: Sequence[str], held: Arrays) -> None:
    """From the rates at a stage to the next stage, and to the sum."""
    for at, rate in zip(range(0, len(rates) * code.lanes, code.lanes), rates, strict=True):
        for array, factor, source in ((held.total, stage.weight, held.total), (held.stage, stage.way, held.begin)):
            change = code.operation("mul", FLOAT, [factor, rate])
            value = code.operation("add", FLOAT, [code.load("%scratch", source + at), change])
            code.store(value, "%scratch", array + at)


def finish(code: Code, size: int, held: Arrays) -> None:
    """The sum is where the next step begins."""
    for at in range(0, size * code.lanes, code.lanes):
        value = code.load("%scratch", held.total + at)
        code.store(value, "%scratch", held.begin + at)
        code.store(value, "%scratch", held.stage + at)


def simulation(graph: Graph, rates: Sequence[int], rows: Mapping[str, int], lanes: int) -> Program:
    """Fly blocks of flights, the flights of a block side by side.

    Arguments of the function: ``shared``; ``theta`` (P, stride); ``record`` (T, R); ``error`` (T, A, stride); ``plan``
    from `Stepping.plan`; ``path`` (given, X, stride), at whose states the first steps begin; ``states``
    (T, X, stride), where they lead; ``scratch``; then samples, stride, first and last block, substeps, stages, and how
    many states are given, at least one.

    Args:
        graph: Expressions.
        rates: Nodes of the rate of the state.
        rows: Rows of the groups of inputs.
        lanes: Flights per block.
    """
    code, memory = Code(lanes), Memory(lanes)
    graph, rates = written_out(graph, rates)
    size = len(rates)
    sections, held = Sections(graph, rates, code, memory), arrays(memory, size)
    steps = code.integer("sub", "%samples", 1)
    across = code.integer("mul", "%stride", size)
    wide = code.integer("mul", "%stride", rows["error_now"])
    with code.loop("%last", "%first") as block:
        lane = code.integer("mul", block, lanes)
        places = {"shared": Place("%shared"), "theta": Place(code.address("%theta", lane), "%stride")}
        sections.write(RUN, places)
        states, error, path = (code.address(f"%{name}", lane) for name in ("states", "error", "path"))
        with code.loop(steps) as sample:
            with code.loop(code.least(code.integer("add", sample, 1), "%given"), sample):  # once, or not at all
                here = code.address(path, code.integer("mul", sample, across))
                begin(code, [code.load(here, code.integer("mul", "%stride", i)) for i in range(size)], held)
            then = code.integer("add", sample, 1)
            for name, when in (("now", sample), ("then", then)):
                places[name] = Place(code.address("%record", code.integer("mul", when, rows["now"])))
                places[f"error_{name}"] = Place(code.address(error, code.integer("mul", when, wide)), "%stride")
            sections.write(SAMPLE, places)
            with code.loop("%substeps") as step:
                with code.loop("%stages") as number:
                    stage = stage_of(code, step, number)
                    places["x"] = Place(code.address("%scratch", held.stage), str(lanes))
                    name_of = sections.write(STATE, places, stage.share)
                    advance(code, stage, [name_of(k) for k in rates], held)
                finish(code, size, held)
            out = code.address(states, code.integer("mul", then, across))
            for i in range(size):
                value = code.load("%scratch", held.total + i * lanes)
                code.store(value, out, code.integer("mul", "%stride", i))
    pointers = ("shared", "theta", "record", "error", "plan", "path", "states", "scratch")
    return code.program(
        "simulate", pointers, ("samples", "stride", "first", "last", "substeps", "stages", "given"), memory.size
    )
