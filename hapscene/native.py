"""Compiled functions: numba with the project's options, and a cache on disk that knows when the code has changed.

Numba's own cache looks only at the file of the function itself: change a function that another file calls, and the
caller goes on with the old one. Here the cache lies in a folder named after a digest of the file and of all of
hapscene's sources that it imports, directly or through others; what is damaged in it is compiled anew.
With NUMBA_DISABLE_JIT=1 the same functions run interpreted.
"""

import hashlib
import os
import re
import shutil
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from typing import Any, Final, TypeVar

from numba import config, njit, types
from numba.core import caching
from platformdirs import user_cache_path

from hapscene.errors import warn

_OPTIONS: Final = {"nogil": True, "error_model": "numpy", "_nrt": False}
INTERPRETED: Final = bool(vars(config)["DISABLE_JIT"])
"""True under NUMBA_DISABLE_JIT=1."""

_HERE: Final = Path(__file__).parent
_IMPORT: Final = re.compile(rb"^\s*from hapscene\.([\w.]+) import", re.MULTILINE)

Function = TypeVar("Function", bound=Callable[..., Any])

_njit: Any = njit  # numba types its options by name, not as a dictionary
_NumbaFile: Any = caching.IndexDataCacheFile
_Record: Any = types.Record

# Numba names what it compiles for a record by the order in which the process met that type. Code that two processes
# kept then has one name for two layouts: a third, which loads both, runs the one on the other's memory.
_Record.mangling_args = property(lambda self: ("Record", (hashlib.sha256(self.name.encode()).hexdigest()[:32],)))

_KEPT_S: Final = 30 * 24 * 3600.0
"""Caches of other versions are removed when unused for this long [s]."""


def native(function: Function) -> Function:
    """Decorator: compile without the GIL, with NumPy's rules for division by zero, cached on disk."""
    compiled: Function = kept(function, partial(_njit, **_OPTIONS))
    return compiled


def inlined(function: Function) -> Function:
    """Decorator: `native`, and a part of whatever calls it.

    For what a tick calls with all of `world` or `surface`, in few places, and for its small geometry: an array is seven
    words, so that the call would hand over up to 250 of them, and the tick, whose calls lie in one another, write 8 kB
    of stack.
    """
    compiled: Function = kept(function, partial(_njit, forceinline=True, **_OPTIONS))
    return compiled


def native_for(signature: Any, function: Callable[..., Any]) -> Any:
    """Compile at once for one signature; cached where the function's source is a file."""
    return kept(function, partial(_njit, signature, **_OPTIONS))


def kept(function: Callable[..., Any], compiler: Callable[..., Any]) -> Any:
    """What a decorator of numba's makes of a function, kept on disk in this version's folder where that can be."""
    source = function.__code__.co_filename
    folder = _folder(vars(config)["CACHE_DIR"], source)
    if folder is not None:
        try:
            with _keeping_in(folder, own=Path(source).is_relative_to(_HERE)):
                return compiler(cache=True)(function)
        except RuntimeError:  # no place to keep it
            if Path(source).is_file():  # else a notebook, an exec
                _warn_once("nothing can be written into its folder")
    return compiler()(function)


@cache
def _warn_once(reason: str) -> None:
    text = f"what is compiled is not kept, so that every start takes half a minute to two longer: {reason}"
    warn(f"{text}; the environment variable NUMBA_CACHE_DIR can name a folder of yours", RuntimeWarning)


@contextmanager
def _keeping_in(folder: str, own: bool) -> Iterator[None]:
    """Have numba keep what is compiled meanwhile in that folder; other packages' caches stay as they are."""
    before, parts = vars(config)["CACHE_DIR"], vars(caching)
    vars(config)["CACHE_DIR"], parts["IndexDataCacheFile"] = folder, partial(_CacheFile, own=own)
    try:
        yield
    finally:
        vars(config)["CACHE_DIR"], parts["IndexDataCacheFile"] = before, _NumbaFile


class _CacheFile(_NumbaFile):  # type: ignore[misc]
    """Numba's files of one function, each with a digest at its end: a damaged one counts as none, and is replaced."""

    def __init__(self, *arguments: Any, own: bool, **more: Any) -> None:
        super().__init__(*arguments, **more)
        self._own = own

    def load(self, key: Any) -> Any:
        found = super().load(key)
        if found is None and self._own:
            _tell_compiling()
        return found

    def save(self, key: Any, data: Any) -> None:
        with suppress(OSError):  # a full disk, something in its place: not kept
            super().save(key, data)

    def _load_index(self) -> Any:
        try:
            return super()._load_index() if _is_whole(self._index_path) else {}
        except (ImportError, AttributeError):  # it was compiled for a type that this process does not know
            return {}

    def _load_data(self, name: str) -> Any:
        if not _is_whole(self._data_path(name)):
            raise FileNotFoundError
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BytesIO]:
        with super()._open_for_write(filepath) as file:
            yield (content := BytesIO())
            file.write(content.getvalue() + hashlib.sha256(content.getvalue()).digest())


def _is_whole(path: str) -> bool:
    """Whether a file ends with its digest."""
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-32]).digest() == content[-32:]


_say: list[Callable[[str], object]] = []
_told = False


@contextmanager
def compiling_told(say: Callable[[str], object]) -> Iterator[None]:
    """Meanwhile, `say` is told when the functions of this version are compiled, once in a process."""
    _say.append(say)
    try:
        yield
    finally:
        _say.pop()


def _tell_compiling() -> None:
    global _told
    if _say and not _told:
        _told = True
        _say[-1]("compiling, once; half a minute to two … ")


@cache
def _folder(chosen: str, source: str) -> str | None:
    """The folder for what the file `source` compiles; under the one that NUMBA_CACHE_DIR names, where it does.

    None where others may write: numba takes code from what it finds there.
    """
    digest = hashlib.sha256()
    for file in sorted(_sources(source)):
        digest.update(file.name.encode())
        digest.update(_text(file))
    root = Path(chosen) / "hapscene" if chosen else user_cache_path("hapscene", appauthor=False)
    folder = root / digest.hexdigest()[:16]
    try:
        if not folder.is_dir():
            _remove_old(root)
        root.mkdir(0o700, parents=True, exist_ok=True)
        folder.mkdir(0o700, exist_ok=True)
        os.utime(folder)
    except OSError:
        return chosen  # no place to write: numba's own choice
    if (place := _others_write(root.resolve(), folder.name)) is not None:
        _warn_once(f"{place} can be written by others")
        return None
    return str(folder)


def _others_write(root: Path, name: str) -> Path | None:
    """The folder, one of the two that are ours or one above them, in which others could put something of their own."""
    if not hasattr(os, "geteuid"):
        return None
    for place, denied in ((root / name, stat.S_IWGRP | stat.S_IWOTH), (root, stat.S_IWOTH)):
        state = place.stat()
        if state.st_mode & denied or state.st_uid not in (0, os.geteuid()):
            return place
    modes = ((place, place.stat().st_mode) for place in root.parents)
    return next((place for place, mode in modes if mode & stat.S_IWOTH and not mode & stat.S_ISVTX), None)


def _sources(source: str) -> set[Path]:
    """A file and all of hapscene's modules that it imports, directly or through others."""
    found: set[Path] = set()
    waiting = [Path(source)]
    while waiting:
        file = waiting.pop()
        if file not in found and file.is_file():
            found.add(file)
            waiting += _imported(file)
    return found


@cache
def _imported(file: Path) -> list[Path]:
    """Where the modules of hapscene's are that a file imports."""
    modules = [_HERE.joinpath(*name.decode().split(".")) for name in _IMPORT.findall(_text(file))]
    return [place for module in modules for place in (module.with_suffix(".py"), module / "__init__.py")]


@cache
def _text(file: Path) -> bytes:
    return file.read_bytes()


def _remove_old(root: Path) -> None:
    """Remove folders of other versions that were not used for long."""
    if not root.is_dir():
        return
    for folder in root.iterdir():
        if folder.is_dir() and time.time() - folder.stat().st_mtime > _KEPT_S:
            shutil.rmtree(folder, ignore_errors=True)
