"""From errors of pydantic and the TOML parser to faults with where, got, wanted, do."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from bayeschute.core.errors import Fault, InputError

Loc = Sequence[int | str]
Table = TypeVar("Table", bound=BaseModel)
_WANTED = {  # by pydantic's type of error, for errors that no validator of ours raised
    "tuple_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "string_type": "a text",
}
_WORST = 200


def show(value: object) -> str:
    """A value as shown to the reader: quoted if text, shortened."""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to write whole numbers of thousands of digits
        text = "a number of thousands of digits"
    return text if len(text) <= 80 else f"{text[:77]}..."


def _key(key: str) -> str:
    """A key as the reader wrote it; unusual ones are quoted, long ones cut."""
    bare = re.fullmatch(r"[A-Za-z0-9_.-]+", key)
    return key if bare and len(key) <= 60 else show(key)


def place(file: str, loc: Loc, raw: object = None) -> str:
    """Location of a value in a file.

    Args:
        file: Path of the file, as given by the user.
        loc: Keys and list positions from the top of the file; an empty last key means the table itself.
        raw: The whole content, from which flights and requirements get their names.

    Returns:
        For example ``"models/studies/x.toml [flight.virtual] swing (flight 'a')"``.
    """
    tables, of, item = [], "", ""
    for position, step in enumerate(loc):
        if isinstance(step, str):
            tables.append(_key(step) if step else "")
        elif position == 1:
            of = f" ({loc[0]} {_named(raw, str(loc[0]), step)})"
        else:
            item = f", item {step + 1}"
    if not tables:
        return file
    is_table = len(loc) == 2 and isinstance(loc[1], int)
    if is_table:
        return f"{file} [{tables[0]}]{of}"
    heading = f" [{'.'.join(tables[:-1])}]" if len(tables) > 1 else ""
    return f"{file}{heading} {tables[-1]}".rstrip() + item + of


def _named(raw: Any, table: str, index: int) -> str:
    """Name of an item of an array of tables, or its number from 1."""
    try:
        name = raw[table][index]["name"]
    except (KeyError, IndexError, TypeError):
        name = None
    return show(name) if isinstance(name, str) and name else str(index + 1)


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """The table types in an annotation, through unions, lists and dictionaries."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def known_keys(model: type[BaseModel], loc: Loc) -> list[str]:
    """Keys that the table at `loc` may have; empty where any key is allowed."""
    models = [model]
    for step in loc:
        if isinstance(step, str):
            fields = [m.model_fields[step] for m in models if step in m.model_fields]
            if fields:
                models = [m for field in fields for m in _models_in(field.annotation)]
    return [key for m in models for key in m.model_fields]


def unknown_key(file: str, loc: Loc, known: Sequence[str], raw: object) -> Fault:
    """Fault of a key that no table of this kind has; the nearest known key is suggested."""
    key = str(loc[-1])
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    do = f"Did you mean {near[0]!r}?" if near else "Remove it."
    return Fault(place(file, loc, raw), f"the unknown key {show(key)}", f"one of {', '.join(known)}", do)


def _fault(file: str, model: type[BaseModel], error: ErrorDetails, raw: object) -> Fault:
    """One fault from one pydantic error."""
    loc, kind = error["loc"], error["type"]
    context: Mapping[str, Any] = error.get("ctx", {})
    if kind == "extra_forbidden":
        return unknown_key(file, loc, known_keys(model, loc[:-1]), raw)
    if kind == "missing":
        return Fault(place(file, loc, raw), "nothing", "a value: this key is required", "Add it.")
    if kind == "fault":
        got = context["got"] if context["got"] is not None else show(error["input"])
        return Fault(place(file, loc, raw), got, context["wanted"], context["do"])
    if kind == "literal_error":  # pydantic's words end in "'b' or 'c'"
        return Fault(place(file, loc, raw), show(error["input"]), f"one of {context['expected'].replace(' or ', ', ')}")
    wanted = _WANTED.get(kind, error["msg"][:1].lower() + error["msg"][1:])
    if kind in ("too_short", "too_long"):
        wanted = f"a list of {context.get('min_length', context.get('max_length'))} values"
    return Fault(place(file, loc, raw), show(error["input"]), wanted)


def faults_of(file: str, model: type[BaseModel], error: ValidationError, raw: object) -> list[Fault]:
    """Every fault that pydantic found in a file.

    Args:
        file: Path of the file, as given by the user.
        model: The pydantic model of the file.
        error: The error of pydantic.
        raw: The content of the file.

    Returns:
        Faults in the order of the file's tables, the first two hundred.
    """
    details = error.errors(include_url=False)[:_WORST]
    return [_fault(file, model, detail, raw) for detail in details]


def validated(model: type[Table], file: str, raw: Any, context: Mapping[str, str] | None = None) -> Table:
    """The content of a file as its pydantic model.

    Args:
        model: The model.
        file: Path of the file, as given by the user.
        raw: The content.
        context: For validators, see `sidecar.context`.

    Raises:
        InputError: With every fault.
    """
    try:
        return model.model_validate(raw, context=context)
    except ValidationError as error:
        raise InputError(faults_of(file, model, error, raw)) from None


def fault_of_toml(file: str, error: tomllib.TOMLDecodeError) -> Fault:
    """Fault of a file that is no TOML, with the line where reading stopped."""
    text = str(error)
    at = re.search(r"\(at (line \d+, column \d+|end of document)\)", text)
    where = f"{file} {at[1]}" if at else file
    got = text.replace(at[0], "").strip() if at else text
    return Fault(where, f"TOML that can't be read: {got[:1].lower()}{got[1:]}"[:300], "a TOML file", "Mend that line.")
