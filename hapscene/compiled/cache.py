"""The cache on disk of what is compiled, and the compiled code that a wheel carries.

A file holds one function for one signature; its name holds a digest of the function's own code and all below it, of the
signature, of numba, Python and the processor. So nothing in it is ever out of date, and a file that fits is the right
one. Files end with a digest of their content: a damaged one counts as absent, and is replaced.
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
from typing import Any, Final

import llvmlite
import llvmlite.binding as llvm
import numba
from numba import config
from numba.core import caching, compiler
from platformdirs import user_cache_path

from hapscene.errors import warn
from hapscene.io.files import whole_file

__all__ = ["DiskCache", "cache_folder", "is_known", "locked", "warn_not_kept"]

SHIPPED: Final = Path(__file__).with_name("shipped")
"""The folder of compiled code that a wheel carries; absent in a checkout."""

V3_FEATURES: Final = "avx avx2 bmi bmi2 cx16 f16c fma lzcnt movbe popcnt sse3 sse4.1 sse4.2 ssse3"
"""What a processor has on which code for x86-64-v3 runs, in LLVM's words."""

PORTABLE_CPU: Final = "x86-64-v3" if llvm.get_default_triple().startswith("x86_64") else "generic"
"""The processor for which a wheel's code is compiled."""

_KEPT_S: Final = 30 * 24 * 3600.0
"""Files are removed when unused for this long [s]."""

_CODE: Final = ("pipeline.py", "block.py", "digest.py", "native.py")
"""Files that decide how a function is compiled: a change of theirs compiles everything anew."""

_BUILD: Final = hashlib.sha256(
    b"".join(Path(__file__).with_name(name).read_bytes() for name in _CODE)
    + f"1 {numba.__version__} {llvmlite.__version__} {sys.version_info[:2]} {sys.implementation.cache_tag}".encode()
).hexdigest()

_Cache: Any = caching._Cache


class DiskCache(_Cache):  # type: ignore[misc]
    """Where numba looks for a compiled function, and puts it: files of one function, a signature each."""

    def __init__(self, name: str, digest: str) -> None:
        self._name, self._digest = name, digest

    @property
    def cache_path(self) -> str:
        return str(cache_folder() or "")

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        target_context.refresh()  # numba's runtime, whose symbols the code may need, is made by its first use
        for path in self._places(signature, target_context):
            content = _whole_content(path)
            if content is not None:
                with suppress(Exception):  # of another build of a library: compiled anew
                    found = compiler.CompileResult._rebuild(target_context, *pickle.loads(content))
                    with suppress(OSError):
                        os.utime(path)
                    return found
        return None

    def save_overload(self, signature: Any, result: Any) -> None:
        folder = cache_folder()
        if folder is None or result.library.has_dynamic_globals:
            return
        with suppress(OSError, pickle.PicklingError, AttributeError, TypeError):  # a full disk; a type of a notebook's
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
        """A file that who compiles this locks; None where nothing is kept."""
        folder = cache_folder()
        return folder / f"{self._name}-{self._digest}.lock" if folder is not None else None

    def _places(self, signature: Any, target_context: Any) -> Iterator[Path]:
        """The files in which it may be."""
        target = target_context.codegen().magic_tuple()
        folder = cache_folder()
        if folder is not None:
            yield folder / self._file(signature, target)
        if SHIPPED.is_dir() and _runs_portable_code():
            yield SHIPPED / self._file(signature, (target[0], PORTABLE_CPU, ""))

    def _file(self, signature: Any, target: tuple[str, ...]) -> str:
        key = hashlib.sha256(f"{_BUILD} {signature!s} {target}".encode()).hexdigest()[:32]
        return f"{self._name}-{self._digest}-{key}.nbc"


def _whole_content(path: Path) -> bytes | None:
    """The content of a file that ends with its digest; None where it is damaged or absent."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    return content[:-32] if hashlib.sha256(content[:-32]).digest() == content[-32:] else None


def is_known(digest: str) -> bool:
    """Whether a function of this digest was compiled before, for whatever signature."""
    places = (cache_folder(), SHIPPED if _runs_portable_code() else None)
    folders = [folder for folder in places if folder is not None and folder.is_dir()]
    return any(next(folder.glob(f"*-{digest}-*.nbc"), None) is not None for folder in folders)


@cache
def _runs_portable_code() -> bool:
    """Whether this processor runs what was compiled for `PORTABLE_CPU`, and no other is asked for."""
    if vars(config)["CPU_NAME"] is not None:
        return False
    features = llvm.get_host_cpu_features()
    return PORTABLE_CPU == "generic" or all(features.get(name, False) for name in V3_FEATURES.split())


def cache_folder() -> Path | None:
    """The folder of the cache: below the one that NUMBA_CACHE_DIR names, else the user's. None where it is unusable."""
    return _folder(vars(config)["CACHE_DIR"])


@cache
def _folder(chosen: str) -> Path | None:
    """None where others may write, since code is taken from what lies there, or where we may not."""
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
    """Warn once that every start compiles."""
    text = f"compiled code is not cached, so that every start takes about 20 s longer: {reason}"
    warn(f"{text}; set the environment variable NUMBA_CACHE_DIR to a folder of yours", RuntimeWarning)


def _others_write(folder: Path) -> Path | None:
    """The folder, ours or one above it, into which other users could put something."""
    if not hasattr(os, "geteuid"):
        return None
    state = folder.stat()
    if state.st_mode & (stat.S_IWGRP | stat.S_IWOTH) or state.st_uid not in (0, os.geteuid()):
        return folder
    modes = ((place, place.stat().st_mode) for place in folder.parents)
    return next((place for place, mode in modes if mode & stat.S_IWOTH and not mode & stat.S_ISVTX), None)


@cache
def _remove_old(folder: Path) -> None:
    """Remove files that were not used for long; once in a process."""
    with suppress(OSError):
        for path in folder.iterdir():
            if path.is_file() and time.time() - path.stat().st_mtime > _KEPT_S:
                path.unlink(missing_ok=True)


@contextmanager
def locked(path: Path | None) -> Iterator[None]:
    """Hold a lock between processes; nothing where there is no file for it."""
    if path is None:
        yield
        return
    from filelock import FileLock

    with FileLock(path):
        yield
