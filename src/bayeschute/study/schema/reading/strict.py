"""Tables of a file that refuse what they don't know, try every rule between their values, and tell all faults at once.

A value that is refused raises a `PydanticCustomError` of type ``"fault"`` whose context holds what was wanted and what
to do; `bayeschute.study.schema.schema_faults` turns it into a `Fault`.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, NoReturn, Self, TypeVar, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    ModelWrapValidatorHandler,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError


class UnknownValueError(AttributeError):
    """A value of a table that could not be read; its fault is told already."""


def rule(check: Callable[[Any], None]) -> Callable[[Any], None]:
    """Mark a method of a table as a rule between its values, which refuses them by `refuse`.

    Every rule of a table is tried, also where other values of the table have faults; one that asks for a value that
    could not be read is left out.
    """
    check.is_rule = True  # type: ignore[attr-defined]
    return check


class Strict(BaseModel):
    """A table of a file: unknown keys are refused and nothing changes after reading."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name in type(self).model_fields:
                raise UnknownValueError(name)
            return super().__getattr__(name)

    @model_validator(mode="wrap")
    @classmethod
    def _tells_all_at_once(cls, raw: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo) -> Self:
        """Faults of values and of the rules between them, together."""
        try:
            made, faults = handler(raw), list[InitErrorDetails]()
        except ValidationError as error:
            if not isinstance(raw, Mapping):
                raise
            made, faults = _part(cls, raw, _places(error), info.context), _told(error)
        for check in _rules(cls):
            try:
                check(made)
            except UnknownValueError:
                continue
            except PydanticCustomError as fault:
                faults.append(InitErrorDetails(type=fault, input=raw))
        if faults:
            raise ValidationError.from_exception_data(cls.__name__, faults)
        return made


def _rules(table: type[Strict]) -> list[Callable[[Any], None]]:
    owned = (found for one in reversed(table.__mro__) for found in vars(one).values())
    return [found for found in owned if getattr(found, "is_rule", False)]


def _told(error: ValidationError) -> list[InitErrorDetails]:
    """The faults of an error, to be raised again."""
    found = []
    for one in error.errors(include_url=False):
        kind, context = one["type"], one.get("ctx", {})
        again = PydanticCustomError("fault", "wanted {wanted}", context) if kind == "fault" else kind
        found.append(InitErrorDetails(type=again, loc=one["loc"], input=one["input"], ctx=context))
    return found


Table = TypeVar("Table", bound=Strict)


def part_of(table: type[Table], raw: Mapping[str, Any], context: Mapping[str, str] | None = None) -> Table:
    """A table as far as its values are sound; asking for others raises `UnknownValueError`.

    Args:
        table: Its type.
        raw: Its content.
        context: For validators.

    Returns:
        The table. Values that a misspelt key may have meant are unknown, not left out.
    """
    try:
        return table.model_validate(raw, context=context)
    except ValidationError as error:
        return _part(table, raw, _places(error), context)


Loc = tuple[int | str, ...]


def _places(error: ValidationError) -> list[Loc]:
    return [one["loc"] for one in error.errors(include_url=False, include_input=False)]


def _part(table: Any, raw: Mapping[str, Any], faulty: Iterable[Loc], context: Any) -> Any:
    """A table without the values at places that have faults."""
    known = table.model_fields
    absent = [name for name in known if name not in raw]
    unknown = {name for name in absent if known[name].is_required()}
    for key in (str(key) for key in raw if key not in known):
        unknown |= set(difflib.get_close_matches(key, absent, n=1, cutoff=0.5))
    sound: dict[str, Any] = {}
    for name, field in known.items():
        if name not in raw:
            continue
        inside = [place[1:] for place in faulty if place[:1] == (name,)]
        found = _tables_in(field.annotation)
        if len(found) == 1 and isinstance(raw[name], Mapping) and inside:
            sound[name] = _part(found[0], raw[name], inside, context)
            continue
        kind: Any = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
        try:
            sound[name] = None if inside else TypeAdapter(kind).validate_python(raw[name], context=context)
        except ValidationError:
            inside = [()]
        if inside:
            unknown.add(name)
    made = table.model_construct({name for name in raw if name in known}, **sound)
    for name in unknown:
        made.__dict__.pop(name, None)
    return made


def _tables_in(annotation: Any) -> list[type[Strict]]:
    """The tables that an annotation names itself, or as one that may be left out."""
    if isinstance(annotation, type) and issubclass(annotation, Strict):
        return [annotation]
    parts = [one for one in get_args(annotation) if one is not type(None)]
    return [one for one in parts if isinstance(one, type) and issubclass(one, Strict)] if len(parts) == 1 else []


def refuse(wanted: str, got: Any = None, do: str = "") -> NoReturn:
    """Raise a fault for the reader of the file.

    Args:
        wanted: What would be accepted.
        got: Description of the value, if not the value itself.
        do: What to do about it.
    """
    raise PydanticCustomError("fault", "wanted {wanted}", {"wanted": wanted, "got": got, "do": do})
