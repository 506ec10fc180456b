"""Calibration label of a run's intervals: "verified: ..." or "not verified: ..."."""

from __future__ import annotations

from collections.abc import Sequence

VERIFIED = "verified"


def label_of(lacking: Sequence[str], kept: str) -> str:
    """The label of intervals.

    Args:
        lacking: What is missing for the label "verified", in words.
        kept: Coverage over replicates, in words.

    Returns:
        ``verified: ...`` where nothing is missing, else ``not verified: ...``.
    """
    return f"not {VERIFIED}: {'; '.join(lacking)}" if lacking else f"{VERIFIED}: {kept}"


def is_verified(label: str) -> bool:
    """Whether a label of `label_of` says verified."""
    return label.partition(":")[0].strip().lower() == VERIFIED
