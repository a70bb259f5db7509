"""Numba pipelines that compile a call tree once: callees are typed and lowered, only their root is optimised.

Numba optimises and emits every function separately, wraps it for Python and C, links it into each caller, and optimises
the result again, so that a function three calls deep is optimised four times. Here a *part*, a function that only
compiled code calls, stops after lowering. A *whole*, a function that Python or C calls, links all parts below it into
one module, which is optimised and emitted once. The machine code is the same, in a third of the time.

This is the only module that uses private interfaces of numba, and only of the versions in `TESTED`. With other versions
`part_options` and `whole_options` are empty, and functions are compiled by the standard pipeline of numba.
"""

# mypy: allow-untyped-calls

from collections.abc import Mapping
from typing import Any, Final

import numba
from llvmlite.binding import ModuleRef
from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core import compiler, typed_passes
from numba.core.codegen import CPUCodeLibrary
from numba.core.codegen import JITCodeLibrary as Library
from numba.core.compiler_machinery import LoweringPass, PassManager, register_pass
from numba.core.targetconfig import ConfigStack, TargetConfig

__all__ = ["part_options", "whole_options"]

TESTED: Final = ((0, 67), (0, 68))
"""Minor versions of numba with which the test suite passes."""

_NEEDED: Final = (
    (Library, ("_linking_libraries", "_get_module_for_linking", "_optimize_final_module", "_finalize_final_module")),
    (Library, ("add_llvm_module", "add_ir_module", "get_pointer_to_function", "serialize_using_object_code")),
    (compiler, ("CompilerBase", "DefaultPassBuilder", "CompileResult")),
    (typed_passes, ("NativeLowering",)),
    (_dynfunc, ("make_function",)),
    (TargetConfig, ("values", "__hash__", "__eq__")),
)


def _is_supported() -> bool:
    """Return whether the installed numba is a tested version and has every private interface that is used here."""
    version = tuple(int(number) for number in numba.__version__.split(".")[:2])
    library = vars(Library) | {name: None for base in Library.__mro__ for name in vars(base)}
    library["_linking_libraries"] = None  # set in its constructor
    names: dict[object, Mapping[str, object]] = {Library: library}
    has = all(name in names.get(place, vars(place)) for place, wanted in _NEEDED for name in wanted)
    return version in TESTED and has


SUPPORTED: Final = _is_supported()


class _PartLibrary(Library):
    """The unoptimised LLVM module of a part."""

    def finalize(self) -> None:
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        return 0

    def add_llvm_module(self, ll_module: ModuleRef) -> None:
        self._final_module.link_in(ll_module)  # optimised once, when the whole is compiled

    def own_module(self) -> ModuleRef:
        """Return the module of this part without its callees, for linking into the calling function."""
        return super()._get_module_for_linking()

    def _get_module_for_linking(self) -> ModuleRef:
        """Return the module with all callees, which numba needs if a function of another package calls a part."""
        module = self.own_module().clone()
        for library in _below(self):
            module.link_in(_module_of(library), preserve=True)
        return module


class _WholeLibrary(Library):
    """A function with all parts below it, optimised and emitted as one module."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        for library in _below(self):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(_module_of(library), preserve=True)
        self._optimize_final_module()
        self._final_module.verify()
        self._finalize_final_module()

    def _optimize_final_module(self) -> None:
        """Run the full optimisation only: the cheap passes before it handle reference counts, which are not used."""
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


def _below(library: CPUCodeLibrary) -> list[CPUCodeLibrary]:
    """Return the libraries that a library links through parts of any depth, each once and in a fixed order."""
    found: dict[CPUCodeLibrary, None] = {}
    waiting = list(library._linking_libraries)
    while waiting:
        one = waiting.pop(0)
        if one not in found:
            found[one] = None
            if isinstance(one, _PartLibrary):
                waiting += one._linking_libraries
    return list(found)


def _module_of(library: CPUCodeLibrary) -> ModuleRef:
    return library.own_module() if isinstance(library, _PartLibrary) else library._get_module_for_linking()


@register_pass(mutates_CFG=True, analysis_only=False)
class _RegisterPart(LoweringPass):
    """Make a lowered part known to its callers. Its entry point for Python must not be called."""

    _name = "hapscene_register_part"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: compiler.StateDict) -> bool:
        lowered = state["cr"]
        name = lowered.fndesc.qualname.split(".")[-1]
        entry = _dynfunc.make_function(lowered.fndesc.lookup_module(), name, "part", 0, lowered.env, (state.library,))
        state.targetctx.insert_user_function(entry, lowered.fndesc, [state.library])
        state.reload_init.extend(state.library._reload_init)
        state["cr"] = lowered._replace(cfunc=entry)
        return True


def _share_overloads(state: compiler.StateDict) -> None:
    """Compile numba's own functions, such as `max`, once for parts and wholes, which differ by these flags."""
    flags = ConfigStack().top()
    for name in ("forceinline", "no_compile", "no_cpython_wrapper", "no_cfunc_wrapper"):
        flags.discard(name)


class _Part(compiler.CompilerBase):
    def define_pipelines(self) -> list[PassManager]:
        state = self.state
        state.flags.no_compile = True
        _share_overloads(state)
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        passes = compiler.DefaultPassBuilder.define_nopython_pipeline(state)
        passes.add_pass_after(_RegisterPart, typed_passes.NativeLowering)
        passes.finalize()
        return [passes]


class _Whole(compiler.CompilerBase):
    def define_pipelines(self) -> list[PassManager]:
        state = self.state
        state.library = _WholeLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        _share_overloads(state)
        return [compiler.DefaultPassBuilder.define_nopython_pipeline(state)]


part_options: dict[str, object] = {}
"""Options of `numba.njit` for a function that other compiled code links."""

whole_options: dict[str, object] = {}
"""Options of `numba.njit` for a function that Python calls, with all functions it links."""

if SUPPORTED:
    part_options |= {"pipeline_class": _Part, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    whole_options |= {"pipeline_class": _Whole}

    # numba hashes the names of the options of a configuration but not their values, so all configurations collide, and
    # each look-up compares dictionaries of forty entries: a tenth of the compile time
    def _hash(config: Any) -> int:
        options = config.options
        return hash(frozenset(k for k, value in config._values.items() if value is True and not options[k].default))

    def _equal(config: Any, other: object) -> Any:
        if not isinstance(other, TargetConfig):
            return NotImplemented
        return config._values == other._values or config.values() == other.values()

    _config: Any = TargetConfig
    _config.__hash__, _config.__eq__ = _hash, _equal
