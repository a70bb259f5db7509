"""A faster start of a command: less is imported, and garbage is collected less often.

For a process of the command line only, since it changes what other code of the process finds in imported packages.
"""

import gc
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from types import SimpleNamespace
from typing import Any, Final

__all__ = ["import_matplotlib", "import_trimesh", "rare_collection"]

OBJECTS: Final = 100_000
"""New objects after which garbage is collected [count]. By default (700), a quarter of the time of imports is spent on
looking for garbage, which imports do not leave."""

DEFERRED: Final = (
    *("cascadio", "networkx"),
    *("scipy.ndimage", "scipy.optimize", "scipy.sparse", "scipy.sparse.linalg", "scipy.spatial"),
)
"""Imports of trimesh that few of its functions use; they take five times as long as trimesh itself."""


class _Deferred:
    """Stands for a module, or for something in it, and imports the module when it is first used."""

    def __init__(self, module: str, name: str = "") -> None:
        self._place = module, name

    def __getattr__(self, name: str) -> Any:
        module, own_name = self._place
        if own_name:
            return getattr(self._loaded(), name)
        # those of the import system; and classes of errors, for which trimesh then catches `BaseException`
        if name.startswith("__") or name.endswith("Error"):
            raise AttributeError(name)
        return _Deferred(module, name)

    def __call__(self, *arguments: object, **named: object) -> Any:
        return self._loaded()(*arguments, **named)

    def __instancecheck__(self, value: object) -> bool:
        return isinstance(value, self._loaded())

    def _loaded(self) -> Any:
        module, name = self._place
        return getattr(import_module(module), name) if name else import_module(module)


@contextmanager
def rare_collection() -> Iterator[None]:
    """Context in which garbage is collected rarely, and after which it is not collected: the process ends."""
    gc.set_threshold(OBJECTS)
    try:
        yield
    finally:
        gc.freeze()  # at exit, Python would look through all objects several times


def import_trimesh() -> None:
    """Import trimesh without `DEFERRED`."""
    import scipy  # noqa: F401  # its modules find it

    _import_without("trimesh", {name: _Deferred(name) for name in DEFERRED})


def import_matplotlib() -> None:
    """Import matplotlib without axes in three dimensions, and without lists of properties in its docstrings."""
    artist: Any = import_module("matplotlib.artist")
    artist.kwdoc = lambda of: ""
    artist.Artist._update_set_signature_and_docstring = classmethod(lambda cls: None)
    _import_without("matplotlib.figure", {"mpl_toolkits.mplot3d": SimpleNamespace(Axes3D=SimpleNamespace(name="3d"))})


def _import_without(package: str, replaced: Mapping[str, object]) -> None:
    """Import a package with these modules replaced, except those that are imported already."""
    absent: dict[str, Any] = {name: module for name, module in replaced.items() if name not in sys.modules}
    if package in sys.modules:
        return
    sys.modules.update(absent)
    try:
        import_module(package)
    except Exception:  # a version that uses them at once
        top = package.partition(".")[0]
        for name in [name for name in sys.modules if name.partition(".")[0] == top]:
            del sys.modules[name]
    finally:
        for name in absent:
            del sys.modules[name]
