"""A study as plain JSON and back, all numbers in SI: stored with a posterior for later predictions.

Reading follows the declared types of the tables and runs none of the validators, which expect quantities with their
units.
"""

from __future__ import annotations

from typing import Any

from bayeschute.core.plain import from_plain, to_plain
from bayeschute.study.study import Study


def study_to_plain(study: Study) -> dict[str, Any]:
    """A study as plain values, without its path."""
    plain: dict[str, Any] = to_plain(study)
    return plain | {"vehicle_path": None}


def study_from_plain(value: Any) -> Study:
    """The study of `study_to_plain`.

    Raises:
        InputError: If a value does not fit its type.
    """
    return from_plain(Study, value, "study")
