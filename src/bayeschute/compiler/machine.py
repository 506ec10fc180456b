"""From a program's text to a function in memory: LLVM's code generator, and object files kept between runs."""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayeschute.compiler.emit import Program
from bayeschute.core.array_library import traced
from bayeschute.core.files import write_whole
from bayeschute.core.numerics import compilation_cache, processors

Array = NDArray[np.float64]
_loaded: dict[tuple[str, bool], tuple[Callable, Any]] = {}  # by a program's text, and whether it is tuned
_lock = threading.Lock()


def available() -> bool:
    """Whether the code generator is installed."""
    return importlib.util.find_spec("llvmlite") is not None


def takes(*given: Any) -> bool:
    """Whether machine code can be called with pytrees of numbers: there is a code generator, and JAX traces none."""
    return available() and not traced(*given)


def aligned(*shape: int) -> Array:
    """An array of zeros that begins at a cache line."""
    size = int(np.prod(shape, dtype=int))
    room = np.zeros(size + 8)
    first = -room.ctypes.data % 64 // 8
    return room[first : first + size].reshape(shape)


def padded(a: Any, length: int) -> Array:
    """An array with its last axis continued to a length by its last entries."""
    a = np.asarray(a, float)
    made = aligned(*a.shape[:-1], length)
    made[..., : a.shape[-1]] = a
    made[..., a.shape[-1] :] = a[..., -1:]
    return made


def in_parts(count: int, work: Callable[[int, int], None]) -> None:
    """Do ranges of blocks on all processors."""
    shares = np.linspace(0, count, min(processors(), count) + 1).astype(int)
    if len(shares) == 2:
        return work(0, count)
    with ThreadPoolExecutor(len(shares) - 1) as pool:
        list(pool.map(work, shares[:-1].tolist(), shares[1:].tolist()))


def compiled(program: Program, tuned: bool = False) -> Callable[..., None]:
    """The function of a program; it takes arrays, then integers, and lets other threads run.

    Args:
        program: The program.
        tuned: Spend time on LLVM's own optimisations: pays for a single lane, whose operations it pairs.
    """
    with _lock:
        if (program.text, tuned) not in _loaded:
            _loaded[program.text, tuned] = _load(program, tuned)
        function = _loaded[program.text, tuned][0]

    def call(*given: Array | int) -> None:
        assert all(a.flags.c_contiguous and a.dtype == float for a in given if isinstance(a, np.ndarray))
        function(*(a.ctypes.data if isinstance(a, np.ndarray) else a for a in given))

    return call


def _load(program: Program, tuned: bool) -> tuple[Callable, Any]:
    """The function, and what has to live as long."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    host = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    machine = llvm.Target.from_default_triple().create_target_machine(*host, opt=3, jit=True, reloc="pic")
    made_of = (program.text, str(tuned), str(llvm.llvm_version_info), machine.triple, *host)
    key = hashlib.sha256("\0".join(made_of).encode()).hexdigest()
    code = _kept(key) or _keep(key, _object(program, machine, tuned))
    engine = llvm.create_lljit_compiler(machine)
    builder = llvm.JITLibraryBuilder().add_object_img(code).add_current_process()
    library = builder.export_symbol(program.name).link(engine, key)
    types = [ctypes.c_void_p] * len(program.pointers) + [ctypes.c_int64] * len(program.sizes)
    return ctypes.CFUNCTYPE(None, *types)(library[program.name]), (engine, library)


def _object(program: Program, machine: Any, tuned: bool) -> bytes:
    import llvmlite.binding as llvm

    module = llvm.parse_assembly(program.text)
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    if tuned:
        options = llvm.create_pipeline_tuning_options(speed_level=1)
        options.slp_vectorization = True
        passes = llvm.create_pass_builder(machine, options)
        passes.getModulePassManager().run(module, passes)
    return machine.emit_object(module)


def _file(key: str) -> Path:
    return compilation_cache() / "kernels" / f"{key}.o"


def _kept(key: str) -> bytes | None:
    """An object file made before, if it is there and whole."""
    try:
        stored = _file(key).read_bytes()
    except OSError:
        return None
    digest, code = stored[:32], stored[32:]
    return code if hashlib.sha256(code).digest() == digest else None


def _keep(key: str, code: bytes) -> bytes:
    """Store an object file; a folder that can't be written only means that it is made again next time."""
    try:
        write_whole(_file(key), partial(Path.write_bytes, data=hashlib.sha256(code).digest() + code), shared=True)
    except OSError:
        pass
    return code
