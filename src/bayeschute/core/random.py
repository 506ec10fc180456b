"""Named random streams: each use of a seed is named for its purpose, and the streams are independent.

Numbers of different names or keys are independent, whatever the seed. Name and keys are written as a JSON list, which
is unique for every list of texts and integers, and 128 bits of its hash are the spawn key of NumPy's
`SeedSequence`, whose pool holds no more.
"""

from __future__ import annotations

import json
import operator
from hashlib import blake2b

import numpy as np


def stream(seed: int, name: str, *keys: int | str) -> np.random.Generator:
    """The generator of a named stream; every call restarts it.

    Args:
        seed: Seed, not negative.
        name: Purpose of the numbers; a name is used in one place only.
        *keys: Which of several streams of that name, e.g. a flight's name or a chain's number.

    Raises:
        TypeError: If a key is neither a text nor an integer.
        ValueError: If the seed is negative.
    """
    return np.random.default_rng(_sequence(seed, name, keys))


def seed_of(seed: int, name: str, *keys: int | str) -> int:
    """An integer seed of 63 bits instead of a named stream, for libraries such as JAX.

    Args:
        seed: Seed, not negative.
        name: Purpose, as for `stream`.
        *keys: Which of several of that name.

    Raises:
        TypeError: If a key is neither a text nor an integer.
        ValueError: If the seed is negative.
    """
    return int(_sequence(seed, name, keys).generate_state(1, np.uint64)[0] >> 1)


def _sequence(seed: int, name: str, keys: tuple[int | str, ...]) -> np.random.SeedSequence:
    said = json.dumps([name, *(key if isinstance(key, str) else int(operator.index(key)) for key in keys)])
    words = np.frombuffer(blake2b(said.encode(), digest_size=16).digest(), "<u4")
    return np.random.SeedSequence(operator.index(seed), spawn_key=words.tolist())
