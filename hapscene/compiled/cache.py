"""Disk cache of compiled functions, and the compiled code that a wheel contains.

A file holds one function for one signature. Its name contains a digest of the code of the function and its callees,
of the signature, and of the versions of numba, Python and the processor. Files are thus never out of date. Each file
ends with a digest of its content; a damaged file counts as absent and is replaced.
"""

# mypy: allow-untyped-calls

import hashlib
import os
import pickle
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeAlias

import llvmlite
import llvmlite.binding as llvm
import numba
from numba import config
from numba.core import caching, compiler
from numba.core.cpu import CPUContext
from numba.core.runtime.nrt import rtsys
from numba.core.types import Type
from numba.core.typing.templates import Signature
from platformdirs import user_cache_path

from hapscene.errors import warn
from hapscene.io.files import whole_file

__all__ = ["DiskCache", "cache_folder", "is_known", "locked", "warn_not_kept"]

SHIPPED: Final = Path(__file__).with_name("shipped")
"""Folder of compiled code in a wheel; absent in a checkout."""

V3_FEATURES: Final = "avx avx2 bmi bmi2 cx16 f16c fma lzcnt movbe popcnt sse3 sse4.1 sse4.2 ssse3"
"""Features that a processor needs to run code for x86-64-v3, by LLVM's names."""

PORTABLE_CPU: Final = "x86-64-v3" if llvm.get_default_triple().startswith("x86_64") else "generic"
"""Processor for which the code in a wheel is compiled."""

_KEPT_S: Final = 30 * 24 * 3600.0
"""Time after which an unused file is removed [s]."""

_CODE: Final = ("pipeline.py", "block.py", "digest.py", "native.py")
"""Files that determine how functions are compiled; a change in them recompiles everything."""

_BUILD: Final = hashlib.sha256(
    b"".join(Path(__file__).with_name(name).read_bytes() for name in _CODE)
    + f"1 {numba.__version__} {llvmlite.__version__} {sys.version_info[:2]} {sys.implementation.cache_tag}".encode()
).hexdigest()

Kinds: TypeAlias = Signature | tuple[Type, ...]
"""The types for which a function is compiled."""


class DiskCache(caching._Cache):
    """Cache that numba uses for one function, with a file for each signature."""

    def __init__(self, name: str, digest: str) -> None:
        self._name, self._digest = name, digest

    @property
    def cache_path(self) -> str:
        return str(cache_folder() or "")

    def load_overload(self, signature: Kinds, target_context: CPUContext) -> Any:
        for path in self._places(signature, target_context):
            content = _whole_content(path)
            if content is not None:
                if b"NRT_" in content:  # symbols of numba's runtime, which is made by its first use
                    rtsys.initialize(target_context)
                with suppress(Exception):  # made by another build of a library: recompile
                    found = compiler.CompileResult._rebuild(target_context, *pickle.loads(content))
                    with suppress(OSError):
                        os.utime(path)
                    return found
        return None

    def save_overload(self, signature: Kinds, result: Any) -> None:
        folder = cache_folder()
        if folder is None or result.library.has_dynamic_globals:
            return
        # a full disk, or a type that cannot be pickled, as of a notebook
        with suppress(OSError, pickle.PicklingError, AttributeError, TypeError):
            content = pickle.dumps(result._reduce(), protocol=pickle.HIGHEST_PROTOCOL)
            path = folder / self._file(signature, target=result.target_context.codegen().magic_tuple())
            with whole_file(path) as part:
                part.write_bytes(content + hashlib.sha256(content).digest())
            _remove_old(folder)

    def enable(self) -> None:
        pass

    def disable(self) -> None:
        pass

    def flush(self) -> None:
        pass

    def lock_path(self) -> Path | None:
        """Return the file that a process locks while it compiles this function; None without a cache folder."""
        folder = cache_folder()
        return folder / f"{self._name}-{self._digest}.lock" if folder is not None else None

    def _places(self, signature: Kinds, target_context: CPUContext) -> Iterator[Path]:
        """Yield the files that may hold the function."""
        target = target_context.codegen().magic_tuple()
        folder = cache_folder()
        if folder is not None:
            yield folder / self._file(signature, target)
        if SHIPPED.is_dir() and _runs_portable_code():
            yield SHIPPED / self._file(signature, (target[0], PORTABLE_CPU, ""))

    def _file(self, signature: Kinds, target: tuple[str, ...]) -> str:
        key = hashlib.sha256(f"{_BUILD} {signature!s} {target}".encode()).hexdigest()[:32]
        return f"{self._name}-{self._digest}-{key}.nbc"


def _whole_content(path: Path) -> bytes | None:
    """Return the content of a file that ends with its digest; None if it is damaged or absent."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    return content[:-32] if hashlib.sha256(content[:-32]).digest() == content[-32:] else None


def is_known(digest: str) -> bool:
    """Return whether a function with this digest is in the cache for any signature."""
    places = (cache_folder(), SHIPPED if _runs_portable_code() else None)
    folders = [folder for folder in places if folder is not None and folder.is_dir()]
    return any(next(folder.glob(f"*-{digest}-*.nbc"), None) is not None for folder in folders)


@cache
def _runs_portable_code() -> bool:
    """Return whether this processor runs code for `PORTABLE_CPU` and the user selected no other processor."""
    if vars(config)["CPU_NAME"] is not None:
        return False
    features = llvm.get_host_cpu_features()
    return PORTABLE_CPU == "generic" or all(features.get(name, False) for name in V3_FEATURES.split())


def cache_folder() -> Path | None:
    """Return the cache folder, in NUMBA_CACHE_DIR or the user's cache; None if it is unusable."""
    return _folder(vars(config)["CACHE_DIR"])


@cache
def _folder(chosen: str) -> Path | None:
    """Return the folder, or None if it is not writable, or if other users could place code in it."""
    folder = Path(chosen) / "hapscene" if chosen else user_cache_path("hapscene", appauthor=False)
    try:
        folder.mkdir(0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        warn_not_kept(f"{folder}: {error.strerror}")
        return None
    if (place := _others_write(folder.resolve())) is not None:
        warn_not_kept(f"{place} can be written by other users")
        return None
    return folder


@cache
def warn_not_kept(reason: str) -> None:
    """Warn once that every start compiles again."""
    text = f"compiled code cannot be cached, so every start takes about 20 s longer: {reason}"
    warn(f"{text}; set the environment variable NUMBA_CACHE_DIR to a private folder", RuntimeWarning)


def _others_write(folder: Path) -> Path | None:
    """Return the folder, or the one above it, that other users can write to; None if there is no such folder."""
    if not hasattr(os, "geteuid"):
        return None
    state = folder.stat()
    if state.st_mode & (stat.S_IWGRP | stat.S_IWOTH) or state.st_uid not in (0, os.geteuid()):
        return folder
    modes = ((place, place.stat().st_mode) for place in folder.parents)
    return next((place for place, mode in modes if mode & stat.S_IWOTH and not mode & stat.S_ISVTX), None)


@cache
def _remove_old(folder: Path) -> None:
    """Remove files that were not used for a long time; once per process."""
    with suppress(OSError):
        for path in folder.iterdir():
            if path.is_file() and time.time() - path.stat().st_mtime > _KEPT_S:
                path.unlink(missing_ok=True)


@contextmanager
def locked(path: Path | None) -> Iterator[None]:
    """Hold a lock between processes; without a file, do nothing."""
    if path is None:
        yield
        return
    from filelock import FileLock

    with FileLock(path):
        yield
