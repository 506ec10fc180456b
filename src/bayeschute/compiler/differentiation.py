"""Forward sensitivities along a known trajectory: the program that propagates tangents through all Runge-Kutta steps.

For a block of samples, side by side, the sparse Jacobian of the rate is computed at every stage of every step and kept
in a table. Then, sample by sample, blocks of tangents go through the stages, side by side too: a straight run of
multiply-adds that has the Jacobian's sparsity written into it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from bayeschute.compiler.derivative import jacobian
from bayeschute.compiler.elementary import written_out
from bayeschute.compiler.emit import Code, Program
from bayeschute.compiler.graph import FLOAT, Graph
from bayeschute.compiler.sections import RUN, SAMPLE, STATE, Memory, Place, Sections
from bayeschute.compiler.simulation import Arrays, Stage, advance, arrays, begin, finish, stage_of


class Slopes:
    """The rate's Jacobian in a graph, and where its entries lie in the table, per stage and sample.

    Attributes:
        graph: Expressions of rates and entries.
        rates: Nodes of the rates.
        by_state: Columns and nodes of the entries by state, for each row.
        by_input: Nodes by column of the tangents, for each row that has entries by inputs.
        blocks: Blocks of tangents that `by_input` reaches.
        place: Offset of every distinct entry by state that is no constant.
        size: Doubles per sample and stage.
    """

    def __init__(
        self, graph: Graph, rates: Sequence[int], rows: Mapping[str, int], groups: Sequence[str], lanes: int
    ) -> None:
        entries = jacobian(graph, rates, ("x", *groups))
        self.graph, nodes = written_out(graph, [*rates, *(slope for _, _, slope in entries)])
        self.rates = nodes[: len(rates)]
        self.by_state: list[list[tuple[int, int]]] = [[] for _ in rates]
        self.by_input: dict[int, dict[int, int]] = {}
        first = {group: sum(rows[g] for g in groups[:i]) for i, group in enumerate(groups)}
        for (i, (group, row), _), node in zip(entries, nodes[len(rates) :], strict=True):
            if group == "x":
                self.by_state[i].append((row, node))
            else:
                self.by_input.setdefault(i, {})[first[group] + row] = node
        self.blocks = -(-sum(rows[g] for g in groups) // lanes)
        varying = dict.fromkeys(n for row in self.by_state for _, n in row if self.graph.value(n) is None)
        self.place = {node: i for i, node in enumerate(varying)}
        self._lanes, self._inputs = lanes, -(-len(varying) // lanes) * lanes
        self.size = self._inputs + lanes * self.blocks * len(self.by_input)

    @property
    def nodes(self) -> list[int]:
        """All nodes that the program computes."""
        return [*self.rates, *self.place, *(n for row in self.by_input.values() for n in row.values())]

    def input_place(self, block: int, row: int) -> int:
        """Offset of the entries by inputs for a block of tangents, in a row of `by_input`."""
        return self._inputs + (block * len(self.by_input) + list(self.by_input).index(row)) * self._lanes

    def pieces(self) -> list[tuple[int, list[int | None]]]:
        """What the table holds: offset and nodes of pieces as long as there are lanes; None is zero."""
        lanes, varying = self._lanes, list(self.place)
        found: list[tuple[int, list[int | None]]] = [
            (at, [*varying[at : at + lanes], *[None] * (at + lanes - len(varying))])
            for at in range(0, len(varying), lanes)
        ]
        for block in range(self.blocks):
            for i, row in self.by_input.items():
                found.append((self.input_place(block, i), [row.get(block * lanes + k) for k in range(lanes)]))
        return found


def differentiation(
    graph: Graph, rates: Sequence[int], rows: Mapping[str, int], groups: Sequence[str], lanes: int
) -> tuple[Program, int]:
    """Carry tangents along blocks of samples of one flight.

    The first columns of the tangents are derivatives by the inputs of `groups`; those after have no input.
    At each sample they start from ``source`` (block of columns, X, lanes) and end in ``out`` (T, X, blocks of columns
    times lanes). Where the state itself gets to from each sample is left in ``reached`` (X, stride).

    Other arguments of the function: ``shared``; ``theta`` (P,); ``record`` (R, stride); ``error`` (A, stride);
    ``plan``; ``states`` (X, stride); ``table``; ``scratch``; then stride, first and last block of samples, substeps,
    stages, first block of columns that is wanted, blocks of columns. Rows of record, error and states must extend one
    sample beyond the last block.

    Args:
        graph: Expressions; grows.
        rates: Nodes of the rate of the state.
        rows: Rows of the groups of inputs.
        groups: Groups of inputs to differentiate by, besides the state.
        lanes: Samples per block, and columns per block.

    Returns:
        The program, and the doubles that ``table`` must hold for each stage of each substep.
    """
    code, memory = Code(lanes), Memory(lanes)
    slopes = Slopes(graph, rates, rows, groups, lanes)
    size = len(rates)
    sections = Sections(slopes.graph, slopes.nodes, code, memory)
    held, tangents = arrays(memory, size), arrays(memory, size)
    places = {"shared": Place("%shared"), "theta": Place("%theta")}
    sections.write(RUN, places)
    width = code.integer("mul", "%blocks", lanes)
    with code.loop("%last", "%first") as block:
        lane = code.integer("mul", block, lanes)
        _tabulate(code, slopes, sections, places, lane, held)
        with code.loop(lanes) as sample:
            line = code.integer("mul", code.integer("add", lane, sample), code.integer("mul", width, size))
            out = code.address("%out", line)
            with code.loop(slopes.blocks, "%wanted") as column:
                _carry(code, slopes, sample, column, True, tangents, (out, width))
            with code.loop("%blocks", slopes.blocks) as column:
                _carry(code, slopes, sample, column, False, tangents, (out, width))
    pointers = "shared theta record error plan states source out reached table scratch".split()
    program = code.program(
        "differentiate", pointers, "stride first last substeps stages wanted blocks".split(), memory.size
    )
    return program, lanes * slopes.size


def _through_step(code: Code, slopes: Slopes, body: Callable[[Stage, str], None], size: int, held: Arrays) -> None:
    """Write `body`, which gets a stage and the address of its table, into the loops over substeps and stages."""
    with code.loop("%substeps") as step:
        with code.loop("%stages") as number:
            count = code.integer("add", code.integer("mul", step, "%stages"), number)
            table = code.address("%table", code.integer("mul", count, slopes.size * code.lanes))
            body(stage_of(code, step, number), table)
        finish(code, size, held)


def _tabulate(
    code: Code, slopes: Slopes, sections: Sections, places: Mapping[str, Place], lane: str, held: Arrays
) -> None:
    """Fill the table for the samples from `lane` on."""
    size, lanes = len(slopes.rates), code.lanes
    states, here = code.address("%states", lane), dict(places)
    begin(code, [code.load(states, code.integer("mul", "%stride", i)) for i in range(size)], held)
    for name, shift in (("now", 0), ("then", 1)):
        for base, group in (("%record", name), ("%error", f"error_{name}")):
            here[group] = Place(code.address(code.address(base, lane), shift), "%stride")
    sections.write(SAMPLE, here)
    here["x"] = Place(code.address("%scratch", held.stage), str(lanes))

    def body(stage: Stage, table: str) -> None:
        name_of = sections.write(STATE, here, stage.share)
        rates = [name_of(k) for k in slopes.rates]
        zero = code.constant(0.0)
        for at, nodes in slopes.pieces():
            turned = code.transposed([zero if n is None else name_of(n) for n in nodes])
            for sample, value in enumerate(turned):
                code.store(value, table, at + sample * slopes.size)
        advance(code, stage, rates, held)

    _through_step(code, slopes, body, size, held)
    reached = code.address("%reached", lane)
    for i in range(size):
        code.store(code.load("%scratch", held.total + i * lanes), reached, code.integer("mul", "%stride", i))


def _carry(
    code: Code, slopes: Slopes, sample: str, column: str, driven: bool, held: Arrays, out: tuple[str, str]
) -> None:
    """Carry a block of tangents through one sample; `driven` ones have inputs."""
    size, lanes = len(slopes.rates), code.lanes
    place = code.integer("mul", column, size * lanes)
    source = code.address("%source", place)
    begin(code, [code.load(source, i * lanes) for i in range(size)], held)

    def body(stage: Stage, table: str) -> None:
        entries = code.address(table, code.integer("mul", sample, slopes.size))
        inputs = code.address(entries, code.integer("mul", column, len(slopes.by_input) * lanes))
        tangents = [code.load("%scratch", held.stage + j * lanes) for j in range(size)]
        factors: dict[int, str] = {}
        moved = []
        for i, row in enumerate(slopes.by_state):
            terms = [code.load(inputs, slopes.input_place(0, i))] if driven and i in slopes.by_input else []
            for j, node in row:
                value = slopes.graph.value(node)
                if node not in factors:
                    known = None if value is None else code.constant(value)
                    factors[node] = known or code.spread(entries, slopes.place[node])
                plain = value == 1.0
                terms.append(tangents[j] if plain else code.operation("mul", FLOAT, [factors[node], tangents[j]]))
            total = terms[0] if terms else code.constant(0.0)
            for term in terms[1:]:
                total = code.operation("add", FLOAT, [total, term])
            moved.append(total)
        advance(code, stage, moved, held)

    _through_step(code, slopes, body, size, held)
    out_base, width = out
    block = code.address(out_base, code.integer("mul", column, lanes))
    for i in range(size):
        code.store(code.load("%scratch", held.total + i * lanes), block, code.integer("mul", width, i))
