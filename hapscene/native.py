"""Compiled functions: numba with the project's options, and a cache on disk that knows when the code has changed.

Numba's own cache looks only at the file of the function itself: change a function that another file calls, and the
caller goes on with the old one. Here the cache lies in a folder named after a digest of the file and of all of
hapscene's sources that it imports, directly or through others.
With NUMBA_DISABLE_JIT=1 the same functions run interpreted.
"""

import hashlib
import os
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

from numba import config, njit
from platformdirs import user_cache_path

_OPTIONS: Final = {"nogil": True, "error_model": "numpy", "_nrt": False}
INTERPRETED: Final = bool(vars(config)["DISABLE_JIT"])
"""True under NUMBA_DISABLE_JIT=1."""

_HERE: Final = Path(__file__).parent
_IMPORT: Final = re.compile(rb"^\s*from hapscene\.([\w.]+) import", re.MULTILINE)

Function = TypeVar("Function", bound=Callable[..., Any])

_njit: Any = njit  # numba types its options by name, not as a dictionary
_KEPT_S: Final = 30 * 24 * 3600.0
"""Caches of other versions are removed when unused for this long [s]."""


def native(function: Function) -> Function:
    """Decorator: compile without the GIL, with NumPy's rules for division by zero, cached on disk."""
    with cache_folder(function):
        compiled: Function = _njit(cache=True, **_OPTIONS)(function)
    return compiled


def native_for(signature: Any, function: Callable[..., Any]) -> Any:
    """Compile at once for one signature; cached where the function's source is a file."""
    with cache_folder(function):
        try:
            return _njit(signature, cache=True, **_OPTIONS)(function)
        except RuntimeError:  # no file to keep a cache beside: a notebook, an exec
            return _njit(signature, **_OPTIONS)(function)


@contextmanager
def cache_folder(function: Callable[..., Any]) -> Iterator[None]:
    """Have numba keep what is compiled meanwhile in this version's folder; other packages' caches stay as they are."""
    before = vars(config)["CACHE_DIR"]
    vars(config)["CACHE_DIR"] = _folder(before, function.__code__.co_filename)
    try:
        yield
    finally:
        vars(config)["CACHE_DIR"] = before


@cache
def _folder(chosen: str, source: str) -> str:
    """The folder for what the file `source` compiles; under the one that NUMBA_CACHE_DIR names, where it does."""
    digest = hashlib.sha256()
    for file in sorted(_sources(source)):
        digest.update(file.name.encode())
        digest.update(_text(file))
    root = Path(chosen) / "hapscene" if chosen else user_cache_path("hapscene", appauthor=False)
    folder = root / digest.hexdigest()[:16]
    if not folder.is_dir():
        _remove_old(root)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    except OSError:
        return chosen  # no place to write: numba's own choice
    return str(folder)


def _sources(source: str) -> set[Path]:
    """A file and all of hapscene's modules that it imports, directly or through others."""
    found: set[Path] = set()
    waiting = [Path(source)]
    while waiting:
        file = waiting.pop()
        if file not in found and file.is_file():
            found.add(file)
            for name in _IMPORT.findall(_text(file)):
                module = _HERE.joinpath(*name.decode().split("."))
                waiting += [module.with_suffix(".py"), module / "__init__.py"]
    return found


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
