"""Tables as plain values for JSON, and back by their declared types: dataclasses, pydantic models, and what they hold.

Reading runs no validators; a value that does not fit its type is refused.
"""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel

from bayeschute.core.errors import Fault, InputError

T = TypeVar("T")
_ATOMS = (bool, int, float, str)


def to_plain(value: Any, *, without_none: bool = False) -> Any:
    """A table, or a part of one, as plain values for JSON: mappings, lists, numbers, strings and None.

    Args:
        value: Pydantic models, dataclasses, mappings, sequences, arrays, numbers, strings, paths, None.
        without_none: Leave out fields of models and dataclasses that are None.
    """
    if isinstance(value, BaseModel) or is_dataclass(value):
        names = type(value).model_fields if isinstance(value, BaseModel) else [field.name for field in fields(value)]
        inside = {name: to_plain(getattr(value, name), without_none=without_none) for name in names}
        return {name: item for name, item in inside.items() if item is not None} if without_none else inside
    if isinstance(value, Mapping):
        return {str(key): to_plain(item, without_none=without_none) for key, item in value.items()}
    if isinstance(value, str | int | float) or value is None:
        return value
    if isinstance(value, Path):
        return str(value)
    return [to_plain(item, without_none=without_none) for item in value]


def from_plain(kind: type[T], value: Any, where: str = "value") -> T:
    """The inverse of `to_plain`.

    Args:
        kind: Its type: a pydantic model or a dataclass.
        value: From `to_plain`.
        where: Location of the value, for faults.

    Raises:
        InputError: If a value does not fit its type.
    """
    made: T = _read(kind, value, where)
    return made


def _refuse(where: str, value: Any, wanted: str) -> InputError:
    shown = repr(value)
    return InputError(Fault(where, shown if len(shown) < 80 else type(value).__name__, wanted, "Is the file damaged?"))


def _read(kind: Any, value: Any, where: str) -> Any:
    origin = get_origin(kind)
    if origin is Annotated:
        return _read(get_args(kind)[0], value, where)
    if origin in (Union, types.UnionType):
        return _read_union(get_args(kind), value, where)
    if origin is Literal:
        if value not in get_args(kind):
            raise _refuse(where, value, f"one of {get_args(kind)}")
        return value
    if origin is tuple:
        return _read_tuple(get_args(kind), value, where)
    if origin in (dict, Mapping):
        if not isinstance(value, dict):
            raise _refuse(where, value, "a table")
        return {key: _read(get_args(kind)[1], item, f"{where}.{key}") for key, item in value.items()}
    if kind is Any:
        return value
    if kind in _ATOMS:
        return _atom(kind, value, where)
    if kind is Path and isinstance(value, str):
        return Path(value)
    return _read_table(kind, value, where)


def _atom(kind: type, value: Any, where: str) -> Any:
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not kind:
        raise _refuse(where, value, kind.__name__)
    return value


def _read_union(kinds: Sequence[Any], value: Any, where: str) -> Any:
    if value is None and type(None) in kinds:
        return None
    refused: InputError | None = None
    for kind in kinds:
        if kind is type(None):
            continue
        try:
            return _read(kind, value, where)
        except InputError as error:
            refused = refused or error
    raise refused or _refuse(where, value, "a value of another type")


def _read_tuple(kinds: Sequence[Any], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise _refuse(where, value, "a list")
    if len(kinds) == 2 and kinds[1] is ...:
        return tuple(_read(kinds[0], item, f"{where}[{i}]") for i, item in enumerate(value))
    if len(kinds) != len(value):
        raise _refuse(where, value, f"{len(kinds)} values")
    return tuple(_read(kind, item, f"{where}[{i}]") for i, (kind, item) in enumerate(zip(kinds, value, strict=True)))


def _read_table(kind: Any, value: Any, where: str) -> Any:
    """A pydantic model or a dataclass."""
    model = isinstance(kind, type) and issubclass(kind, BaseModel)
    if not model and not is_dataclass(kind):
        raise _refuse(where, value, getattr(kind, "__name__", str(kind)))
    names = list(kind.model_fields) if model else [field.name for field in fields(kind)]
    if not isinstance(value, dict) or set(value) - set(names):
        raise _refuse(where, value, f"a table of {', '.join(names)}")
    if model:
        hints = {name: info.annotation for name, info in kind.model_fields.items()}
    else:
        hints = get_type_hints(kind)
    made = {name: _read(hints[name], item, f"{where}.{name}") for name, item in value.items()}
    try:
        return kind.model_construct(**made) if model else kind(**made)
    except TypeError as error:  # a field is missing
        raise _refuse(where, value, str(error)) from None
