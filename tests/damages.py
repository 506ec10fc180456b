"""Damages of text files at random."""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from time import process_time

from bayeschute.core.errors import InputError

ODD = (
    "nan", "inf", "-inf", "1e308", "1e-308", "-1", "0", '""', '"x"', "[]", "{}", "true", "1e400", "99999999999999999999",
    '"1 furlong"', '"nan m"', '"inf s"', '"-3 s"', '"1e999 m"', '"0 m"', '"<script>"', '"../../etc/passwd"', '"=cmd()"',
    "2020-01-01",
)  # fmt: skip
CELLS = (*ODD, "1,5", "", "--", "12:30", "NaN", "null", "\u0661\u0662")  # the last are digits to `str.isdigit`


def _cut(raw: bytes, rng: random.Random) -> bytes:
    return raw[: rng.randrange(len(raw))]


def _flip(raw: bytes, rng: random.Random) -> bytes:
    made = bytearray(raw)
    for _ in range(rng.choice([1, 1, 3])):
        made[rng.randrange(len(made))] ^= 1 << rng.randrange(8)
    return bytes(made)


def _drop(raw: bytes, rng: random.Random) -> bytes:
    lines = raw.split(b"\n")
    del lines[rng.randrange(len(lines))]
    return b"\n".join(lines)


def _repeat(raw: bytes, rng: random.Random) -> bytes:
    lines = raw.split(b"\n")
    lines.insert(rng.randrange(len(lines)), rng.choice(lines))
    return b"\n".join(lines)


def _swap(raw: bytes, rng: random.Random) -> bytes:
    lines = raw.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _value(raw: bytes, rng: random.Random) -> bytes:
    lines = raw.split(b"\n")
    i = rng.choice([i for i, line in enumerate(lines) if re.search(rb"=|,", line) and not line.startswith(b"#")])
    if b"=" in lines[i]:
        lines[i] = lines[i].split(b"=")[0] + b"= " + rng.choice(ODD).encode()
    else:
        cells = lines[i].split(b",")
        cells[rng.randrange(len(cells))] = rng.choice(CELLS).encode()
        lines[i] = b",".join(cells)
    return b"\n".join(lines)


def _hole(raw: bytes, rng: random.Random) -> bytes:
    first = rng.randrange(len(raw))
    return raw[:first] + raw[first + rng.randrange(200) :]


def _put_in(what: bytes) -> Callable[[bytes, random.Random], bytes]:
    def made(raw: bytes, rng: random.Random) -> bytes:
        first = rng.randrange(len(raw))
        return raw[:first] + what + raw[first:]

    return made


def _line_ends(raw: bytes, rng: random.Random) -> bytes:
    return raw.replace(b"\n", rng.choice([b"\r\n", b"\r"]))


DAMAGES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "cut": _cut, "flip": _flip, "drop": _drop, "repeat": _repeat, "swap": _swap, "value": _value, "hole": _hole,
    "byte order mark": lambda raw, rng: b"\xef\xbb\xbf" + raw, "Latin-1": _put_in(b"\xe9"), "NUL": _put_in(b"\0"),
    "line ends": _line_ends, "depth": lambda raw, rng: b"x = " + b"[" * 3000 + b"]" * 3000 + b"\n" + raw,
}  # fmt: skip
OFTEN = ("value", "value", "value", "flip")
SECONDS = 10.0  # of the processor, that no file may take


def outcomes(targets: Sequence[tuple[Path, Callable[[], bool]]], number: int, seed: int) -> Counter[tuple[str, str]]:
    """Damage files one by one and read them; how many of each damage were told of, or were clean.

    Args:
        targets: Files, each with what reads it: whether it told of a fault; an `InputError` tells of one too.
        number: How many damages.
        seed: Seed.
    """
    count: Counter[tuple[str, str]] = Counter()
    for k in range(number):
        rng, (path, read) = random.Random(f"{seed} {k}"), targets[k % len(targets)]
        kind, raw = rng.choice((*DAMAGES, *OFTEN)), path.read_bytes()
        path.write_bytes(DAMAGES[kind](raw, rng))
        began = process_time()
        try:
            told = read()
        except InputError as error:
            told = True
            assert all(str(fault).strip() for fault in error.faults)
        except Exception as error:
            raise AssertionError(f"input {k} ({kind} of {path.name}) ended in a traceback") from error
        assert process_time() - began < SECONDS, f"input {k} ({kind} of {path.name}) took too long"
        path.write_bytes(raw)
        count[kind, "told" if told else "clean"] += 1
    return count
