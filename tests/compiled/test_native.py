"""Compiled functions: disk cache, its safety and keys, and progress."""

import functools
import importlib
import io
import os
import re
import shutil
import sys
import time
from collections.abc import Callable
from copy import copy
from ctypes import CDLL, CFUNCTYPE, c_double
from ctypes.util import find_library
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest
from numba import config, from_dtype, njit, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.itanium_mangler import mangle_type

from hapscene.compiled import cache, digest, pipeline, progress
from hapscene.compiled.native import INTERPRETED, CFunction, compiling, inlined, native

pytestmark = pytest.mark.skipif(INTERPRETED, reason="nothing is compiled: NUMBA_DISABLE_JIT")

SOURCE = '''
"""A module."""
FACTOR = {factor}

def inner(x):
    """{doc}"""
    return FACTOR * x{comment}

def unused(x):
    return x + {other}
'''
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="no such permissions there")


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Use a separate cache: that of the user may contain these functions."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    cache._folder.cache_clear()


def source(**changed: Any) -> str:
    return SOURCE.format(**{"factor": 2.0, "doc": "Double it.", "comment": "", "other": 1} | changed)


@pytest.fixture
def compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Compile `twice` of a module as a new process would, with the cache in the folder `cache`."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def make(**changed: Any) -> Any:
        cache._folder.cache_clear()
        (tmp_path / "compiled_source.py").write_text(source(**changed))
        monkeypatch.delitem(sys.modules, "compiled_source", raising=False)
        importlib.invalidate_caches()
        module = importlib.import_module("compiled_source")
        module.inner = native(module.inner)  # type: ignore[attr-defined]
        exec("def twice(x):\n    return inner(x)", vars(module))
        function: Any = native(vars(module)["twice"])
        assert function(21.0) == 21.0 * changed.get("factor", 2.0)
        return function

    return make


def files(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / "cache").rglob("*.nbc"))


def hits(function: Any) -> int:
    return sum(function.whole.stats.cache_hits.values())


def test_a_function_is_compiled_once(compiled: Callable[..., Any], tmp_path: Path) -> None:
    whole, known = compiled(), compiled()
    assert hits(whole) == 0 and hits(known) == 1
    assert len(files(tmp_path)) == 1  # of the whole only
    assert [cache.is_known(digest.digest_of(one.py_func)[0]) for one in (known, native(lambda x: x))] == [True, False]


@pytest.mark.parametrize("change", [{"doc": "Other words."}, {"comment": "  # why"}, {"other": 2}])
def test_changes_outside_compiled_code_keep_the_cache(compiled: Callable[..., Any], change: dict[str, Any]) -> None:
    compiled()
    assert hits(compiled(**change)) == 1


def test_changed_constant_of_a_callee_recompiles(compiled: Callable[..., Any]) -> None:
    compiled()
    assert hits(compiled(factor=3.0)) == 0


def test_inlined_function_alone_and_in_a_caller() -> None:
    part = inlined(lambda x: 2.0 * x)
    caller = native(lambda x: part(x) + part(x))
    assert part(21.0) == caller(10.5) == 42.0
    (code,) = caller.whole.inspect_llvm().values()
    if pipeline.SUPPORTED:
        assert len(re.findall("^define ", code, re.MULTILINE)) == 3  # the function, and its wrappers for Python and C
    assert native(source).__name__ == "source" and native(source).__module__ == __name__


def test_numba_code_calls_a_native_function() -> None:
    inner = native(lambda x: x + 1.0)
    outer = native(lambda x: 2.0 * inner(x))
    assert njit(lambda x: outer(x) + inner(x))(1.0) == 6.0


def test_constant_arguments_share_one_function() -> None:
    part = native(lambda x, k: x + k)
    whole = native(lambda x: part(x, 1) + part(x, 2) + part(x, int(x)))
    assert whole(3.0) == 15.0 and len(part.part.signatures) == 1


def test_loading_holds_the_lock_of_numba(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its registries are generators, which two threads may not run at the same time."""
    locked: list[bool] = []
    load = cache.DiskCache.load_overload

    def watched(self: cache.DiskCache, *arguments: Any) -> Any:
        locked.append(global_compiler_lock.is_locked())
        return load(self, *arguments)

    monkeypatch.setattr(cache.DiskCache, "load_overload", watched)
    CFunction(types.int64(types.int64), lambda x: x + 41)
    assert locked and all(locked)


def test_a_c_function_is_called_by_its_address() -> None:
    function = CFunction(types.float64(types.float64), lambda x: 3.0 * x)
    assert CFUNCTYPE(c_double, c_double)(function.address)(2.0) == 6.0 == function(2.0)


def folder_instead(file: Path) -> None:
    file.unlink()
    file.mkdir()


def one_bit(file: Path) -> None:
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)


DAMAGE: dict[str, Callable[[Path], object]] = {
    "truncated": lambda file: file.write_bytes(file.read_bytes()[:-100]),
    "one bit": one_bit,
    "a folder": folder_instead,
    "gone": Path.unlink,
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_file_is_recompiled(compiled: Callable[..., Any], tmp_path: Path, damage: str) -> None:
    compiled()
    (file,) = files(tmp_path)
    DAMAGE[damage](file)
    assert hits(compiled()) == 0
    assert hits(compiled()) == (0 if damage == "a folder" else 1)


@POSIX
def test_code_with_an_address_of_this_process_is_not_kept(tmp_path: Path) -> None:
    power = CDLL(find_library("m")).pow
    power.argtypes, power.restype = [c_double, c_double], c_double
    assert native(lambda x: power(x, 2.0))(3.0) == 9.0 and not files(tmp_path)
    disk = cache.DiskCache("power", "0")
    assert disk.cache_path == str(tmp_path / "cache" / "hapscene")
    assert disk.lock_path() == tmp_path / "cache" / "hapscene" / "power-0.lock"


@POSIX
@pytest.mark.parametrize("place", ["", "hapscene"])
def test_folder_writable_by_others_is_not_used(compiled: Callable[..., Any], tmp_path: Path, place: str) -> None:
    compiled()
    open_to_all = tmp_path / "cache" / place
    open_to_all.chmod(0o777)
    cache.warn_not_kept.cache_clear()
    with pytest.warns(RuntimeWarning, match=open_to_all.name):
        assert hits(compiled()) == 0
    open_to_all.chmod(0o1777 if not place else 0o755)  # as /tmp
    assert hits(compiled()) == 1


@POSIX
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives files away")
def test_folder_of_another_user_is_not_used(compiled: Callable[..., Any], tmp_path: Path) -> None:
    compiled()
    shutil.chown(tmp_path / "cache" / "hapscene", 65534)
    cache.warn_not_kept.cache_clear()
    with pytest.warns(RuntimeWarning):
        assert hits(compiled()) == 0


def test_without_a_folder_code_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "plain").touch()
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "plain"))
    cache.warn_not_kept.cache_clear()
    with pytest.warns(RuntimeWarning, match="NUMBA_CACHE_DIR"):
        assert native(lambda x: x * 13.0)(1.0) == 13.0
    disk = cache.DiskCache("power", "0")
    assert (cache.cache_folder(), disk.lock_path(), disk.cache_path) == (None, None, "")


def test_code_of_a_wheel_is_used(compiled: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Code for a processor with a subset of our features is used if the cache of the user is empty."""
    codegen = native(lambda x: x).whole.targetctx.codegen()
    triple = codegen.magic_tuple()[0]
    with monkeypatch.context() as built:  # as with NUMBA_CPU_NAME and an empty NUMBA_CPU_FEATURES
        built.setattr(type(codegen), "magic_tuple", lambda self: (triple, "any", ""))
        compiled()
    monkeypatch.setattr(cache, "PORTABLE_CPU", "any")
    shutil.move(tmp_path / "cache" / "hapscene", tmp_path / "shipped")
    monkeypatch.setattr(cache, "SHIPPED", tmp_path / "shipped")
    monkeypatch.setattr(cache, "_runs_portable_code", lambda: True)
    assert hits(compiled()) == 1 and not files(tmp_path)
    monkeypatch.setattr(cache, "_runs_portable_code", lambda: False)
    assert hits(compiled()) == 0 and len(files(tmp_path)) == 1


def test_code_of_another_build_is_not_used(compiled: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    """Code of a wheel that was built with another numba, llvmlite or Python is not used."""
    compiled()
    monkeypatch.setattr(cache, "_BUILD", "another")
    assert hits(compiled()) == 0 and hits(compiled()) == 1


def test_selected_processor_excludes_code_of_the_wheel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(config, "CPU_NAME", "nehalem")
    assert not cache._runs_portable_code.__wrapped__()


@pytest.mark.parametrize("terminal", [False, True])
def test_long_compilation_is_reported_in_one_line(terminal: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    screen = io.StringIO()
    screen.isatty = lambda: terminal  # type: ignore[method-assign]
    flushed: list[int] = []
    screen.flush = lambda: flushed.append(screen.tell())  # type: ignore[method-assign]
    monkeypatch.setattr(sys, "stderr", screen)
    monkeypatch.setattr(progress, "FUNCTION_S", 10.0)
    monkeypatch.setattr(progress, "time", SimpleNamespace(perf_counter=iter([100.0, 103.0] * 3).__next__))
    inner = native(lambda x: x * 5.0)
    one, other = native(lambda x: inner(x) + 1.0), native(lambda x: inner(x) - 1.0)
    with compiling(one, other):
        assert (one(1.0), other(1.0)) == (6.0, 4.0)
    line, *later = screen.getvalue().split("\r")
    shown = "compiling 3 functions (first run, about 30 s) … "
    lines = [*(f"{shown}{k}" for k in (1, 2, 3)), f"{shown}3 done in 3 s\n"] if terminal else []
    assert (line, later) == (shown if terminal else f"{shown} done in 3 s\n", lines)
    begun = len(screen.getvalue())
    assert flushed[-1] == begun and len(flushed) == len(lines) + 2 - terminal
    with compiling(one, other):  # they are in the cache
        native(lambda x: inner(x) + 2.0)(1.0)
    assert screen.getvalue()[begun:].startswith("compiling 1 function (first run, about 10 s) … ")
    monkeypatch.setattr(sys, "stderr", None)  # as in a program without a console
    with compiling():
        assert native(lambda x: x * 9.0)(1.0) == 9.0


def test_record_code_is_named_by_its_layout() -> None:
    long, short = (from_dtype(np.dtype([("k", np.float64, (n,)), ("gain", np.float64)])) for n in (45, 29))
    elsewhere = copy(short)
    elsewhere._code = long._code  # as in a process that met the short one first
    assert mangle_type(elsewhere) == mangle_type(short) != mangle_type(long)


def test_digest_includes_nested_constants() -> None:
    def doubled(x: list[float]) -> list[float]:
        return [2.0 * y for y in x]

    def tripled(x: list[float]) -> list[float]:
        return [3.0 * y for y in x]

    tripled.__qualname__ = doubled.__qualname__
    assert digest.digest_of(doubled)[0] != digest.digest_of(tripled)[0]


def test_digest_distinguishes_operators_names_and_defaults() -> None:
    for one, other in (
        (lambda x: x + x, lambda x: x - x),
        (lambda x: np.sin(x), lambda x: np.cos(x)),
        (lambda x, k=1: x + k, lambda x, k=2: x + k),
    ):
        assert digest.digest_of(one)[0] == digest.digest_of(copy_of(one))[0] != digest.digest_of(other)[0]
    assert digest._text(functools.partial(max)) == "functools.partial"  # without the address


def copy_of(function: Any) -> Any:
    return FunctionType(function.__code__, globals(), function.__name__, function.__defaults__, function.__closure__)


def test_unused_files_are_removed_after_30_days(compiled: Callable[..., Any], tmp_path: Path) -> None:
    compiled()
    (used,) = files(tmp_path)
    now_s = time.time()
    for name, days in (("old.nbc", 31), ("recent.nbc", 29)):
        (used.parent / name).touch()
        os.utime(used.parent / name, (now_s, now_s - days * 86_400.0))
    os.utime(used, (0.0, 0.0))
    assert hits(compiled()) == 1 and used.stat().st_mtime > now_s - 3600.0  # it was used
    cache._remove_old.cache_clear()
    compiled(factor=3.0)
    assert {"old.nbc", "recent.nbc", used.name} - {file.name for file in files(tmp_path)} == {"old.nbc"}


def test_digest_distinguishes_inlining() -> None:
    def calling(inner: Any) -> Any:
        return lambda x: inner(x)

    def plain(x: float) -> float:
        return x

    assert digest.digest_of(calling(native(plain)))[0] != digest.digest_of(calling(inlined(plain)))[0]


def test_functions_in_the_cache_are_known(compiled: Callable[..., Any]) -> None:
    compiled()
    folder = cache.cache_folder()
    assert folder is not None
    for file in folder.glob("*.nbc"):
        known = file.stem.split("-")[-2]
        assert cache.is_known(known) and not cache.is_known(known[::-1])


def test_shipped_code_runs_where_the_processor_has_all_features(monkeypatch: pytest.MonkeyPatch) -> None:
    has = dict.fromkeys(cache.V3_FEATURES.split(), True)
    for cpu, portable, features, runs in (
        (None, "x86-64-v3", has, True),
        (None, "x86-64-v3", has | {next(iter(has)): False}, False),
        (None, "generic", {}, True),
        ("generic", "x86-64-v3", has, False),
    ):
        monkeypatch.setattr(config, "CPU_NAME", cpu)
        monkeypatch.setattr(cache, "PORTABLE_CPU", portable)
        monkeypatch.setattr(cache.llvm, "get_host_cpu_features", lambda features=features: features)
        assert cache._runs_portable_code.__wrapped__() == runs


def test_other_versions_of_numba_are_not_supported(monkeypatch: pytest.MonkeyPatch) -> None:
    assert pipeline._is_supported() == any(numba.__version__.startswith(f"{a}.{b}.") for a, b in pipeline.TESTED)
    monkeypatch.setattr(pipeline, "TESTED", ())
    assert not pipeline._is_supported()
