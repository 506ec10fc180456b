"""Command line of a benchmark: its docstring as help, and with ``--json`` one object as the last line."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from typing import Any


def parser_of(description: str | None) -> argparse.ArgumentParser:
    """A parser with the option ``--json``.

    Args:
        description: Docstring of the benchmark, shown as it is.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line")
    return parser


def print_result(given: argparse.Namespace, ratios: Mapping[str, Any], context: Mapping[str, Any]) -> None:
    """Print ratios and their context as one JSON object where ``--json`` asks for it."""
    if given.json:
        print(json.dumps({"ratios": ratios, "context": context}))
