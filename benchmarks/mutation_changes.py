"""Small changes that can be made in a Python source, found by its syntax tree, each told by where it stands.

A change replaces a piece of the text: an operator, a comparison, ``and`` or ``or``, ``not``, a condition by its
contrary, a number, ``True``, ``min`` by ``max`` and the like, a sign, an index or a bound by its neighbour. Left alone
are strings, docstrings, annotations, decorators, ``__all__``, asserts, what is raised and the texts of faults, which no
test need know by heart; and what could only ever fail, such as a difference of lists.
"""

from __future__ import annotations

import ast
import io
import tokenize
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

ARITHMETIC = {
    ast.Add: ("-",), ast.Sub: ("+",), ast.Mult: ("/",), ast.Div: ("*",), ast.Pow: ("*",), ast.FloorDiv: ("*",),
    ast.Mod: ("*",), ast.MatMult: ("*",), ast.BitOr: ("&",), ast.BitAnd: ("|",),
}  # fmt: skip
COMPARISONS = {
    ast.Lt: ("<=", ">="), ast.LtE: ("<", ">"), ast.Gt: (">=", "<="), ast.GtE: (">", "<"), ast.Eq: ("!=",),
    ast.NotEq: ("==",), ast.Is: ("is not",), ast.IsNot: ("is",), ast.In: ("not in",), ast.NotIn: ("in",),
}  # fmt: skip
_PAIRS = (
    ("min", "max"), ("minimum", "maximum"), ("argmin", "argmax"), ("nanmin", "nanmax"), ("fmin", "fmax"),
    ("any", "all"), ("sin", "cos"), ("floor", "ceil"), ("zeros", "ones"), ("zeros_like", "ones_like"),
    ("logical_and", "logical_or"), ("cumsum", "cumprod"), ("exp", "expm1"), ("log", "log1p"),
)  # fmt: skip
FUNCTIONS = dict(_PAIRS) | {b: a for a, b in _PAIRS}
NUMERIC = {"np", "jnp", "math", "linalg", "special", "lax"}
"""What functions of numbers are called by: a sign of an argument of theirs can be changed."""
TEXTS = (
    ast.JoinedStr, ast.List, ast.Tuple, ast.Dict, ast.Set, ast.ListComp, ast.DictComp, ast.SetComp, ast.GeneratorExp,
)  # fmt: skip
PATHS = {"path", "folder", "place", "root", "run", "out", "home", "directory", "package"}
"""Names of paths, for which ``/`` is no division."""
UNSIGNED = {
    "abs", "fabs", "square", "cos", "cosh", "norm", "any", "all", "flatnonzero", "nonzero", "count_nonzero", "where",
    "isnan", "isfinite", "isinf", "logical_not", "logical_and", "logical_or", "zeros", "ones", "full", "empty", "eye",
    "zeros_like", "ones_like", "full_like", "empty_like", "arange", "shape", "ndim", "size", "sqrt", "log", "split",
    "stop_gradient",
}  # fmt: skip
"""Functions for which the sign of their first argument is no matter, or only ever fails."""
LEFT_ALONE = (ast.Raise, ast.Assert, ast.JoinedStr, ast.Import, ast.ImportFrom)
SIMPLE = (ast.Name, ast.Attribute, ast.Call, ast.Subscript)
"""What needs no parentheses."""
NO_MATTER = {"strict", "stacklevel", "indent", "maxsize"}
"""Keyword arguments that change nothing that is computed."""
LONGEST = 200


@dataclass(frozen=True)
class Change:
    """One place where a source can be changed.

    Attributes:
        kind: What is changed there, such as ``arithmetic``.
        line: Where it begins, from 1.
        start: First character of the text that is replaced.
        end: Its end.
        choices: Texts that can stand there instead.
    """

    kind: str
    line: int
    start: int
    end: int
    choices: tuple[str, ...]


def changes(text: str) -> list[Change]:
    """All places where a source can be changed, in their order.

    Args:
        text: Of a module.
    """
    finder = _Finder(text)
    finder.visit(ast.parse(text))
    return sorted(finder.found, key=lambda one: (one.start, one.end, one.kind))


def applied(text: str, change: Change, choice: str) -> str:
    """The source with a change made.

    Args:
        text: Of a module.
        change: One of its places.
        choice: What to put there.
    """
    return text[: change.start] + choice + text[change.end :]


def sound(text: str, changed: str) -> bool:
    """Whether a changed source compiles and is another program than before.

    Args:
        text: Before.
        changed: After.
    """
    try:
        tree = ast.parse(changed)
        compile(changed, "<changed>", "exec", dont_inherit=True)
    except (SyntaxError, ValueError):
        return False
    return ast.dump(tree) != ast.dump(ast.parse(text))


def shown(text: str, change: Change, choice: str) -> tuple[str, str]:
    """The lines of a change before and after, as one line each."""
    first, last = text.rfind("\n", 0, change.start) + 1, text.find("\n", change.end)
    last = len(text) if last < 0 else last
    pair = text[first:last], text[first : change.start] + choice + text[change.end : last]
    before, after = (" ".join(line.strip() for line in one.split("\n")) for one in pair)
    return before[:LONGEST], after[:LONGEST]


class _Finder(ast.NodeVisitor):
    """Collects the places of a source where it can be changed."""

    def __init__(self, text: str) -> None:
        self.text, self.found, self.indexing = text, list[Change](), False
        self.lines = text.split("\n")
        self.begins = [0]
        for line in self.lines:
            self.begins.append(self.begins[-1] + len(line) + 1)
        left_out = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT)
        read = tokenize.generate_tokens(io.StringIO(text).readline)
        tokens = [token for token in read if token.type not in left_out and token.string not in ("(", ")")]
        self.tokens = [(self.begins[t.start[0] - 1] + t.start[1], t.string) for t in tokens]

    # where things stand

    def _place(self, line: int, column: int) -> int:
        """Character of a line and a column that is counted in bytes, as the syntax tree does."""
        return self.begins[line - 1] + len(self.lines[line - 1].encode()[:column].decode())

    def _start(self, node: ast.expr) -> int:
        return self._place(node.lineno, node.col_offset)

    def _end(self, node: ast.expr) -> int:
        return self._place(node.end_lineno or node.lineno, node.end_col_offset or 0)

    def _between(self, left: ast.expr, right: ast.expr) -> tuple[int, int]:
        """Start and end of the operator between two operands, whatever parentheses and comments stand there too."""
        first = bisect_left(self.tokens, (self._end(left), ""))
        last = bisect_left(self.tokens, (self._start(right), ""))
        begin, word = self.tokens[last - 1]
        return self.tokens[first][0], begin + len(word)

    def _add(self, kind: str, start: int, end: int, *choices: str) -> None:
        line = self.text.count("\n", 0, start) + 1
        self.found.append(Change(kind, line, start, end, choices))

    def _wrap(self, kind: str, node: ast.expr, *words: tuple[str, str]) -> None:
        """Put words before and after an expression."""
        start, end = self._start(node), self._end(node)
        text = self.text[start:end] if isinstance(node, SIMPLE) else f"({self.text[start:end]})"
        self._add(kind, start, end, *(f"{before}{text}{after}" for before, after in words))

    # what is left alone

    def visit(self, node: ast.AST) -> None:
        """Look for changes in a piece of the tree, unless it is left alone."""
        if not isinstance(node, LEFT_ALONE):
            super().visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        for inner in (*node.args.defaults, *node.args.kw_defaults, *node.body):
            if inner is not None:
                self.visit(inner)

    def visit_AsyncFunctionDef(self, node: ast.AsyncFunctionDef) -> None:
        self.visit_FunctionDef(node)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for inner in node.body:
            self.visit(inner)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_Assign(self, node: ast.Assign) -> None:
        if not any(isinstance(one, ast.Name) and one.id == "__all__" for one in node.targets):
            self.generic_visit(node)

    def visit_keyword(self, node: ast.keyword) -> None:
        if node.arg not in NO_MATTER:
            self.generic_visit(node)

    # what is changed

    def visit_BinOp(self, node: ast.BinOp) -> None:
        if type(node.op) in ARITHMETIC and not _fails(node.op, node.left, node.right):
            self._add("arithmetic", *self._between(node.left, node.right), *ARITHMETIC[type(node.op)])
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        if isinstance(node.op, ast.Add | ast.Sub | ast.Mult | ast.Div) and not _texty(node.value):
            start, end = self._between(node.target, node.value)
            self._add("arithmetic", start, end, ARITHMETIC[type(node.op)][0] + "=")
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        sides = [node.left, *node.comparators]
        for op, left, right in zip(node.ops, sides, sides[1:], strict=False):
            self._add("comparison", *self._between(left, right), *COMPARISONS[type(op)])
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        other = "or" if isinstance(node.op, ast.And) else "and"
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._add("boolean", *self._between(left, right), other)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        start = self._start(node)
        if isinstance(node.op, ast.Not):
            self._add("boolean", start, start + len("not "), "")
        elif isinstance(node.op, ast.USub) and self.indexing and isinstance(node.operand, ast.Constant):
            if isinstance(node.operand.value, int):
                self._add("index", start, self._end(node), str(-node.operand.value - 1))
            return
        elif isinstance(node.op, ast.USub):
            self._add("sign", start, start + 1, "")
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        names = {one.id for one in ast.walk(node.test) if isinstance(one, ast.Name)}
        if names & {"TYPE_CHECKING", "__name__"}:
            for inner in node.orelse:
                self.visit(inner)
        else:
            self._contrary(node.test)
            self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        self._contrary(node.test)
        self.generic_visit(node)

    def visit_comprehension(self, node: ast.comprehension) -> None:
        for test in node.ifs:
            self._contrary(test)
        self.generic_visit(node)

    def _contrary(self, test: ast.expr) -> None:
        """A condition that can't be changed otherwise."""
        if not isinstance(test, ast.Compare | ast.BoolOp | ast.UnaryOp | ast.Constant | ast.NamedExpr):
            self._wrap("boolean", test, ("not ", ""))

    def visit_Constant(self, node: ast.Constant) -> None:
        value, place = node.value, (self._start(node), self._end(node))
        if isinstance(value, bool):
            self._add("boolean", *place, str(not value))
        elif isinstance(value, int):
            self._add(
                "index" if self.indexing else "number",
                *place,
                *(("1",) if not value else (str(value + 1), str(value - 1))),
            )
        elif isinstance(value, float):
            self._add("number", *place, *((f"{2.0 * value!r}", f"{0.5 * value!r}") if value else ("1.0",)))

    def visit_Call(self, node: ast.Call) -> None:
        name, owner = _last(node.func), _last(node.func.value) if isinstance(node.func, ast.Attribute) else ""
        if name.endswith(("Fault", "Error", "Warning")):
            return
        built_in = isinstance(node.func, ast.Name) and name in ("min", "max", "any", "all")
        if name in FUNCTIONS and (owner in NUMERIC or built_in or (owner and not node.args)):
            end = self._end(node.func)
            self._add("function", end - len(name), end, FUNCTIONS[name])
        for place, argument in enumerate(node.args):
            numeric = (
                owner in NUMERIC
                and name not in UNSIGNED
                and not place
                and isinstance(argument, ast.Name | ast.Attribute | ast.Subscript)
            )
            if numeric or _arithmetic(argument):
                self._wrap("sign", argument, ("-", ""))
        if name == "range" and isinstance(node.func, ast.Name) and not isinstance(node.args[-1], ast.Constant):
            self._neighbour(node.args[0] if len(node.args) == 1 else node.args[1])
        outside, self.indexing = self.indexing, False
        self.generic_visit(node)
        self.indexing = outside

    def visit_Return(self, node: ast.Return) -> None:
        if node.value is not None and _arithmetic(node.value):
            self._wrap("sign", node.value, ("-", ""))
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        self.visit(node.value)
        outside, self.indexing = self.indexing, True
        self.visit(node.slice)
        self.indexing = outside

    def visit_Slice(self, node: ast.Slice) -> None:
        for bound in (node.lower, node.upper):
            if bound is not None and not isinstance(bound, ast.Constant | ast.UnaryOp):
                self._neighbour(bound)
        self.generic_visit(node)

    def _neighbour(self, bound: ast.expr) -> None:
        """A bound that is computed, off by one."""
        if isinstance(bound, (*SIMPLE, ast.BinOp)):
            self._wrap("index", bound, ("", " + 1"), ("", " - 1"))


def _last(node: ast.expr) -> str:
    """Last name of a dotted one, else nothing."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _texty(node: ast.expr) -> bool:
    """Whether an operand is seen to be a text or a container, with which other operators only fail."""
    if isinstance(node, ast.BinOp):
        return _texty(node.left) or _texty(node.right)
    if isinstance(node, ast.Call):
        return _last(node.func) in ("str", "repr", "list", "tuple", "dict", "set", "sorted", "join", "model_dump")
    return isinstance(node, TEXTS) or (isinstance(node, ast.Constant) and isinstance(node.value, str | bytes | None))


def _fails(op: ast.operator, left: ast.expr, right: ast.expr) -> bool:
    """Whether another operator could only fail: texts, containers, paths, unions of types."""
    if _texty(left) or _texty(right):
        return True
    if isinstance(op, ast.Div):
        return any(set(_last(side).lower().split("_")) & PATHS for side in (left, right))
    if isinstance(op, ast.BitOr):
        return any(
            _last(s)[:1].isupper() or _last(s) in ("int", "float", "str", "bool", "ndarray") for s in (left, right)
        )
    return False


def _arithmetic(node: ast.expr) -> bool:
    """Whether an expression is arithmetic of numbers, by its looks."""
    kinds: Sequence[type[ast.operator]] = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.MatMult)
    return isinstance(node, ast.BinOp) and type(node.op) in kinds and not _fails(node.op, node.left, node.right)
