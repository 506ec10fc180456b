"""The value of an expression graph by NumPy, node after node: what the machine code must give."""

from __future__ import annotations

import numpy as np

_UFUNCS = {
    "add": np.add, "sub": np.subtract, "mul": np.multiply, "div": np.divide, "neg": np.negative, "abs": np.abs,
    "sqrt": np.sqrt, "floor": np.floor, "max": np.maximum, "min": np.minimum, "lt": np.less, "le": np.less_equal,
    "eq": np.equal, "ne": np.not_equal, "and": np.logical_and, "or": np.logical_or, "xor": np.logical_xor,
    "not": np.logical_not, "sin": np.sin, "cos": np.cos, "exp": np.exp, "log": np.log, "atan2": np.arctan2,
    "tan": np.tan, "tanh": np.tanh, "copysign": np.copysign, "select": np.where,
    "to_float": lambda a: np.asarray(a, float), "to_integer": lambda a: np.asarray(a).astype(np.int64),
    "power_of_two": lambda k: np.ldexp(1.0, k),
}  # fmt: skip


def evaluate(graph, wanted, inputs):
    """Values of nodes; `inputs` holds the rows of every group."""
    values = {}
    for node in graph.needed(wanted):
        op, args, value, (group, row) = graph.nodes[node]
        if value is not None:
            values[node] = value
        elif op == "input":
            values[node] = inputs[group][row]
        elif op == "lookup":
            values[node] = np.asarray(inputs[group])[row + values[args[0]]]
        else:
            with np.errstate(all="ignore"):
                values[node] = _UFUNCS[op](*(values[a] for a in args))
    return [values[node] for node in wanted]
