"""Products of small matrices as machine code, row by row.

A row of the result stays in registers while rows of the second factor are added to it, each times one number of the
first. Numbers of a row lie side by side, in whole registers; sizes are known when the code is made.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bayeschute.compiler.emit import Code

WIDE = 4
"""Numbers in a register."""
_MOST = 12  # registers that a row may take at once


def padded(count: int) -> int:
    """Columns in whole registers."""
    return -(-count // WIDE) * WIDE


def parts(columns: int) -> list[tuple[int, int]]:
    """First column and number of columns of parts of a row that fit the registers."""
    registers = columns // WIDE
    count = -(-registers // _MOST)
    sizes = [registers // count + (k < registers % count) for k in range(count)]
    return [(WIDE * sum(sizes[:k]), WIDE * size) for k, size in enumerate(sizes)]


class RowCode(Code):
    """A function body that works on rows of matrices; addresses are those of doubles."""

    def __init__(self) -> None:
        super().__init__(WIDE)

    def row_of(self, base: str, row: str | int, stride: int, column: str | int = 0) -> str:
        """Address of a number of a matrix whose rows are `stride` apart."""
        return self.address(self.address(base, self.integer("mul", row, stride)), column)

    def number(self, base: str, index: str | int = 0) -> str:
        """One number."""
        return self.new(f"load double, ptr {self.address(base, index)}, align 8")

    def keep(self, number: str, base: str, index: str | int = 0) -> None:
        """Write one number."""
        self.line(f"store double {number}, ptr {self.address(base, index)}, align 8")

    def zeros(self, columns: int) -> list[str]:
        """A row of zeros."""
        return [self.constant(0.0)] * (columns // WIDE)

    def row(self, base: str, columns: int) -> list[str]:
        """A row in registers."""
        return [self.load(base, k) for k in range(0, columns, WIDE)]

    def read(self, base: str, count: int) -> list[str]:
        """A row of so many numbers, zeros behind; nothing beyond is read."""
        made = [self.load(base, k) for k in range(0, count - WIDE + 1, WIDE)]
        if count % WIDE:
            value, first = self.constant(0.0), count - count % WIDE
            for lane in range(count % WIDE):
                one = self.number(base, first + lane)
                value = self.new(f"insertelement {self.type()} {value}, double {one}, i64 {lane}")
            made.append(value)
        return made

    def put(self, row: Sequence[str], base: str, count: int | None = None) -> None:
        """Write a row; only so many numbers of it."""
        count = len(row) * WIDE if count is None else count
        for at, value in zip(range(0, count, WIDE), row, strict=False):
            if at + WIDE <= count:
                self.store(value, base, at)
                continue
            for lane in range(count - at):
                self.keep(self.new(f"extractelement {self.type()} {value}, i64 {lane}"), base, at + lane)

    def times(self, factor: str, row: Sequence[str]) -> list[str]:
        """A number, on all lanes, times a row."""
        return [self.new(f"fmul contract {self.type()} {factor}, {a}") for a in row]

    def plus(self, row: Sequence[str], other: Sequence[str], sign: str = "fadd") -> list[str]:
        """The sum of two rows; their difference by ``fsub``."""
        return [self.new(f"{sign} contract {self.type()} {a}, {b}") for a, b in zip(row, other, strict=True)]

    def combined(self, row: Sequence[str], pairs: Iterable[tuple[str, str]], sign: str = "fadd") -> list[str]:
        """A row plus, or less, numbers times rows, by their addresses."""
        made = list(row)
        for number, base in pairs:
            made = self.plus(made, self.times(self.spread(number, 0), self.row(base, len(row) * WIDE)), sign)
        return made

    def gathered(
        self, row: Sequence[str], numbers: str, rows: str, count: int, stride: int, columns: int, sign: str = "fadd"
    ) -> list[str]:
        """A row plus, or less, neighbouring numbers times so many rows of a matrix without padding.

        Args:
            row: The row, of as many registers as the columns take.
            numbers: Address of the first number.
            rows: Address of the first row.
            count: How many.
            stride: From row to row.
            columns: Of the rows.
            sign: As in `plus`.
        """
        made = list(row)
        for k in range(count):
            other = self.read(self.address(rows, k * stride), columns)
            made = self.plus(made, self.times(self.spread(numbers, k), other), sign)
        return made

    def copied(self, count: str | int, source: str, target: str, stride: int = 1) -> None:
        """Copy neighbouring numbers to places `stride` apart."""
        with self.loop(count) as i:
            self.keep(self.number(source, i), target, self.integer("mul", i, stride))

    def emptied(self, count: int, target: str) -> None:
        """Set numbers to zero."""
        with self.loop(count) as i:
            self.keep(self.scalar(0.0), target, i)

    def scalar(self, value: float) -> str:
        """A constant number."""
        return Code(1).constant(value)

    def turned(self, source: str, target: str, size: int) -> None:
        """Transpose a square matrix, of whole registers."""
        with self.loop(size // WIDE) as a, self.loop(size // WIDE) as b:
            i, j = (self.integer("mul", block, WIDE) for block in (a, b))
            block = [self.load(self.row_of(source, self.integer("add", i, k), size, j), 0) for k in range(WIDE)]
            for k, value in enumerate(self.transposed(block)):
                self.store(value, self.row_of(target, self.integer("add", j, k), size, i), 0)
