"""LLVM's intermediate language for straight-line expressions on `lanes` numbers at once, and for counted loops."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from bayeschute.compiler.graph import BOOLEAN, FLOAT, INTEGER

_TYPES = {FLOAT: "double", INTEGER: "i64", BOOLEAN: "i1"}
_ARITHMETIC = {
    FLOAT: {"add": "fadd contract", "sub": "fsub contract", "mul": "fmul contract", "div": "fdiv"},
    INTEGER: {"add": "add", "sub": "sub", "mul": "mul", "div": "sdiv"},
}
_COMPARE = {
    FLOAT: {"lt": "fcmp olt", "le": "fcmp ole", "eq": "fcmp oeq", "ne": "fcmp une"},
    INTEGER: {"lt": "icmp slt", "le": "icmp sle", "eq": "icmp eq", "ne": "icmp ne"},
    BOOLEAN: {"eq": "icmp eq", "ne": "icmp ne"},
}
_INTRINSICS = {"sqrt": "sqrt", "abs": "fabs", "floor": "floor", "copysign": "copysign"} | {
    name: name for name in ("log", "tan", "tanh", "asin", "acos", "atan", "sinh", "cosh", "pow")
}


class Program(NamedTuple):
    """A module's text, the name and arguments of its function, and the scratch memory it needs [doubles].

    The function takes addresses of arrays of doubles, then 64-bit integers, and returns nothing.
    """

    text: str
    name: str
    pointers: tuple[str, ...]
    sizes: tuple[str, ...]
    scratch: int


class Code:
    """A function body under construction.

    Attributes:
        lanes: Numbers computed side by side.
        lines: Instructions so far.
        declared: Intrinsics in use.
    """

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        self.lines: list[str] = []
        self.declared: set[str] = set()
        self._count = 0

    def type(self, kind: str = FLOAT) -> str:
        """The type of a value."""
        return _TYPES[kind] if self.lanes == 1 else f"<{self.lanes} x {_TYPES[kind]}>"

    def line(self, text: str) -> None:
        """An instruction without result."""
        self.lines.append(f"  {text}")

    def new(self, text: str) -> str:
        """Name of the result of an instruction."""
        self._count += 1
        self.lines.append(f"  %v{self._count} = {text}")
        return f"%v{self._count}"

    def constant(self, value: float | int | bool) -> str:
        """A number on every lane."""
        if isinstance(value, bool):
            kind, text = BOOLEAN, "true" if value else "false"
        elif isinstance(value, int):
            kind, text = INTEGER, str(value)
        else:
            kind, text = FLOAT, f"0x{struct.pack('>d', value).hex().upper()}"
        return text if self.lanes == 1 else "<" + ", ".join([f"{_TYPES[kind]} {text}"] * self.lanes) + ">"

    def call(self, name: str, *args: str) -> str:
        """The result of an intrinsic of floats."""
        t = self.type()
        full = f"@llvm.{name}.{'f64' if self.lanes == 1 else f'v{self.lanes}f64'}"
        self.declared.add(f"declare {t} {full}({', '.join([t] * len(args))})")
        return self.new(f"call nsz contract {t} {full}({', '.join(f'{t} {a}' for a in args)})")

    def address(self, base: str, index: str | int) -> str:
        """Address of a double."""
        return self.new(f"getelementptr double, ptr {base}, i64 {index}")

    def load(self, base: str, index: str | int) -> str:
        """Neighbouring doubles, one per lane."""
        return self.new(f"load {self.type()}, ptr {self.address(base, index)}, align 8")

    def store(self, value: str, base: str, index: str | int) -> None:
        """Write neighbouring doubles."""
        self.line(f"store {self.type()} {value}, ptr {self.address(base, index)}, align 8")

    def spread(self, base: str, index: str | int) -> str:
        """One double on every lane."""
        return self.everywhere(self.new(f"load double, ptr {self.address(base, index)}, align 8"))

    def everywhere(self, one: str) -> str:
        """A scalar on every lane."""
        if self.lanes == 1:
            return one
        first = self.new(f"insertelement {self.type()} poison, double {one}, i64 0")
        zeros = f"<{self.lanes} x i32> zeroinitializer"
        return self.new(f"shufflevector {self.type()} {first}, {self.type()} poison, {zeros}")

    def integer(self, op: str, a: str | int, b: str | int) -> str:
        """Arithmetic of addresses and counters."""
        return self.new(f"{op} i64 {a}, {b}")

    def least(self, a: str, b: str) -> str:
        """The smaller of two counters."""
        return self.new(f"select i1 {self.new(f'icmp slt i64 {a}, {b}')}, i64 {a}, i64 {b}")

    @contextmanager
    def loop(self, count: str | int, first: str | int = 0) -> Iterator[str]:
        """Repeat what is written inside for a counter from `first` to below `count`; not at all if there is none."""
        self._count += 1
        k = self._count
        enter = self.new(f"icmp slt i64 {first}, {count}")
        self.lines += [f"  br i1 {enter}, label %before{k}, label %after{k}", f"before{k}:", f"  br label %loop{k}"]
        self.lines += [f"loop{k}:", f"  %i{k} = phi i64 [ {first}, %before{k} ], [ %next{k}, %end{k} ]"]
        yield f"%i{k}"
        self.lines += [f"  br label %end{k}", f"end{k}:", f"  %next{k} = add i64 %i{k}, 1"]
        again = self.new(f"icmp slt i64 %next{k}, {count}")
        self.lines += [f"  br i1 {again}, label %loop{k}, label %after{k}", f"after{k}:"]

    def program(self, name: str, pointers: Sequence[str], sizes: Sequence[str], scratch: int) -> Program:
        """The module that holds what was written, as one function."""
        arguments = [f"ptr noalias %{p}" for p in pointers] + [f"i64 %{s}" for s in sizes]
        # A local of full width makes the frame aligned, so that no vector kept there straddles two cache lines.
        frame = [
            f"  %frame = alloca {self.type()}, align 64",
            f"  store volatile {self.type()} zeroinitializer, ptr %frame",
        ]
        body = ["entry:", *(frame if self.lanes > 1 else []), *self.lines, "  ret void"]
        text = "\n".join([f"define void @{name}({', '.join(arguments)}) {{", *body, "}", *sorted(self.declared), ""])
        return Program(text, name, tuple(pointers), tuple(sizes), scratch)

    def gather(self, base: str, index: str) -> str:
        """Doubles at a separate index for each lane."""
        if self.lanes == 1:
            return self.load(base, index)
        made = "poison"
        for lane in range(self.lanes):
            place = self.new(f"extractelement {self.type(INTEGER)} {index}, i64 {lane}")
            one = self.new(f"load double, ptr {self.address(base, place)}, align 8")
            made = self.new(f"insertelement {self.type()} {made}, double {one}, i64 {lane}")
        return made

    def scatter(self, value: str, addresses: Iterable[str]) -> None:
        """Write every lane to a separate address."""
        for lane, address in enumerate(addresses):
            one = value if self.lanes == 1 else self.new(f"extractelement {self.type()} {value}, i64 {lane}")
            self.line(f"store double {one}, ptr {address}, align 8")

    def operation(self, op: str, kind: str, args: list[str], last: float | int | bool | None = None) -> str:
        """The result of an operation of a `Graph`.

        Args:
            op: The operation.
            kind: Type of its last operand.
            args: Names of the operands.
            last: The last operand's value if it is a constant.
        """
        t = self.type(kind)
        if op in _ARITHMETIC.get(kind, ()):
            return self.new(f"{_ARITHMETIC[kind][op]} {t} {args[0]}, {args[1]}")
        if op == "neg":
            return self.new(f"fneg {t} {args[0]}" if kind == FLOAT else f"sub {t} {self.constant(0)}, {args[0]}")
        if op in _COMPARE.get(kind, ()):
            return self.new(f"{_COMPARE[kind][op]} {t} {args[0]}, {args[1]}")
        if op in ("and", "or", "xor"):
            return self.new(f"{op} {t} {args[0]}, {args[1]}")
        if op == "not":
            return self.new(f"xor {t} {args[0]}, {self.constant(True)}")
        if op == "select":
            return self.new(f"select {self.type(BOOLEAN)} {args[0]}, {t} {args[1]}, {t} {args[2]}")
        if op in ("max", "min"):
            return self._extreme(op, kind, args, last)
        if op == "to_float":
            how = "uitofp" if kind == BOOLEAN else "sitofp"
            return self.new(f"{how} {t} {args[0]} to {self.type()}")
        if op == "to_integer":
            return self._truncated(kind, args[0])
        if op == "power_of_two":
            shifted = self.new(f"add {t} {args[0]}, {self.constant(1023)}")
            bits = self.new(f"shl {t} {shifted}, {self.constant(52)}")
            return self.new(f"bitcast {t} {bits} to {self.type()}")
        return self.call(_INTRINSICS[op], *args)

    def _extreme(self, op: str, kind: str, args: list[str], last: float | int | bool | None) -> str:
        """Larger or smaller of two; NaN if either is."""
        t = self.type(kind)
        if kind == FLOAT and last is None:
            return self.call("maximum" if op == "max" else "minimum", *args)
        better = {"max": "ugt", "min": "ult"} if kind == FLOAT else {"max": "sgt", "min": "slt"}
        compare = "fcmp" if kind == FLOAT else "icmp"
        first = self.new(f"{compare} {better[op]} {t} {args[0]}, {args[1]}")
        return self.new(f"select {self.type(BOOLEAN)} {first}, {t} {args[0]}, {t} {args[1]}")

    def _truncated(self, kind: str, value: str) -> str:
        t, i = self.type(kind), self.type(INTEGER)
        if kind == BOOLEAN:
            return self.new(f"zext {t} {value} to {i}")
        suffix = ("i64", "f64") if self.lanes == 1 else (f"v{self.lanes}i64", f"v{self.lanes}f64")
        full = f"@llvm.fptosi.sat.{suffix[0]}.{suffix[1]}"  # NaN and what is too large have a value, too
        self.declared.add(f"declare {i} {full}({t})")
        return self.new(f"call {i} {full}({t} {value})")

    def transposed(self, rows: list[str]) -> list[str]:
        """Square of as many vectors as lanes, transposed."""
        step = 1
        while step < self.lanes:
            new = list(rows)
            for i in range(self.lanes):
                if not i & step:
                    low = [k if not k & step else self.lanes + k - step for k in range(self.lanes)]
                    high = [k + step if not k & step else self.lanes + k for k in range(self.lanes)]
                    new[i], new[i + step] = (self._shuffle(rows[i], rows[i + step], pick) for pick in (low, high))
            rows, step = new, 2 * step
        return rows

    def _shuffle(self, a: str, b: str, pick: list[int]) -> str:
        t, mask = self.type(), ", ".join(f"i32 {k}" for k in pick)
        return self.new(f"shufflevector {t} {a}, {t} {b}, <{self.lanes} x i32> <{mask}>")
