"""Files of a study on disk: TOML files and records that must exist."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Any

from bayeschute.core.errors import Fault
from bayeschute.study.schema.draft import Draft
from bayeschute.study.schema.schema_faults import fault_of_toml, show
from bayeschute.study.schema.sidecar import DATA, DATA_VARIABLE, data_folder

LARGEST = 1_000_000  # [bytes] of a study or vehicle file


def read_toml(path: Path) -> tuple[dict[str, Any] | None, str, list[Fault]]:
    """Content and text of a TOML file, or why it can't be read."""
    shown = str(path)
    wanted = "a TOML file"
    try:
        if not path.is_file():
            got = "a folder" if path.is_dir() else "no such file"
            return None, "", [Fault(shown, got, wanted, "Check the path.")]
        if path.stat().st_size > LARGEST:
            return None, "", [Fault(shown, f"{path.stat().st_size} bytes", f"a TOML file of at most {LARGEST} bytes")]
        text = path.read_bytes().decode("utf-8-sig")
        return tomllib.loads(text), text, []
    except UnicodeDecodeError:
        return None, "", [Fault(shown, "bytes that are no UTF-8 text", wanted, "Is it the right file?")]
    except tomllib.TOMLDecodeError as error:
        return None, "", [fault_of_toml(shown, error)]
    except RecursionError:
        return None, "", [Fault(shown, "brackets nested too deep", wanted)]
    except ValueError as error:
        return None, "", [Fault(shown, f"a value that can't be read ({error})"[:200], wanted)]
    except OSError as error:
        return None, "", [Fault(shown, f"a file that can't be read ({error.strerror})", wanted)]


def record_paths(draft: Draft, folder: Path, data_dir: Path | str | None) -> tuple[dict[int, Path], list[Fault]]:
    """Paths of the records by the flights' places in the file, and faults of those that aren't there.

    Args:
        draft: The study as far as its tables could be read.
        folder: Folder of the study file; paths of records are relative to it.
        data_dir: Folder that replaces ``${DATA}``; default: the environment variable BAYESCHUTE_DATA.
    """
    data = data_folder(data_dir)
    paths: dict[int, Path] = {}
    faults: list[Fault] = []
    files = {
        index: file for index, flight in draft.flights.items() if (file := getattr(flight, "file", None)) is not None
    }
    asks_for_data = [index for index, file in files.items() if DATA in file]
    how = f"Give it as --data DIR or in the environment variable {DATA_VARIABLE}."
    if asks_for_data and not data:
        where = draft.at("flight", asks_for_data[0], "file")
        got = f"{show(files[asks_for_data[0]])} and no data folder"
        faults.append(Fault(where, got, f"a folder that {DATA} stands for", how))
    elif asks_for_data and not Path(data).is_dir():
        faults.append(Fault(f"data folder {data}", "no such folder", "the folder with the records", how))
    data_is_there = bool(data) and Path(data).is_dir()
    for index, file in files.items():
        if DATA in file and not data_is_there:
            continue
        path = Path(os.path.normpath(folder / file.replace(DATA, data)))
        where = draft.at("flight", index, "file")
        try:
            size = path.stat().st_size if path.is_file() else -1
        except (OSError, ValueError):  # a name too long, or with a null byte
            size = -1
        if size < 0:
            faults.append(Fault(where, f"no such file {path}", "a record that exists", "Put the record there."))
        elif size == 0:
            faults.append(Fault(str(path), "an empty file", "a record"))
        else:
            paths[index] = path
    return paths, faults
