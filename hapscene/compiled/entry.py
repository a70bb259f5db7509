"""Compiled functions that other compiled code calls by address instead of linking them.

One compiled tick thus serves all loops, and phases that few scenes use (moving bodies, stabilisers, fields) are
compiled when a scene first uses them. With NUMBA_DISABLE_JIT=1 an "address" is an index into a list of functions."""

# mypy: allow-untyped-calls

from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias

from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.typing.context import Context
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from hapscene.compiled.native import INTERPRETED, CFunction

__all__ = ["Generate", "Values", "address_of", "c_caller", "call_entry", "call_flags", "entry_of", "prefetch"]

Values: TypeAlias = Sequence[ir.Value]
Generate: TypeAlias = Callable[[BaseContext, ir.IRBuilder, Signature, Values], ir.Value]
"""The part of an intrinsic that emits its code, from the values of its arguments."""

_compiled: Final[dict[tuple[object, ...], CFunction]] = {}
_interpreted: Final[list[Callable[..., int]]] = []


def address_of(function: Callable[..., int], *arguments: object) -> int:
    """Return the address with which `call_flags` calls a function that returns an int, compiled for these types."""
    if INTERPRETED:
        if function not in _interpreted:
            _interpreted.append(function)
        return 1 + _interpreted.index(function)
    return _entry(function, arguments).address


def call_entry(function: Callable[..., int], *arguments: object) -> int:
    """Call a function from Python, with the same machine code that `call_flags` uses."""
    if INTERPRETED:
        return int(function(*arguments))
    return int(_entry(function, arguments)(*arguments))


def entry_of(function: Callable[..., object], *arguments: object) -> Callable[..., Any]:
    """Return a function compiled for the types of the arguments. It accepts exactly these types and checks nothing."""
    return function if INTERPRETED else _entry(function, arguments)


def _entry(function: Callable[..., object], arguments: tuple[object, ...]) -> CFunction:
    """Return the function compiled for the types of the arguments, once per process."""
    kinds = tuple(map(typeof, arguments))
    key = (function, *kinds)
    if key not in _compiled:
        _compiled[key] = CFunction(types.int64(*kinds), function)
    return _compiled[key]


if INTERPRETED:

    def call_flags(address: int, arguments: tuple[object, ...]) -> int:
        """Call the function at an address from compiled code, as `call_flags(address, (a, b, …))`; return its flags."""
        return int(_interpreted[address - 1](*arguments))

    def prefetch(address: int) -> None:
        """Begin to load the cache line at an address, which need not be valid."""

else:

    @intrinsic
    def call_flags(typing: Context, address: types.Type, arguments: types.Tuple) -> tuple[Signature, Generate]:
        """Call the function at an address from compiled code, as `call_flags(address, (a, b, …))`; return its flags."""
        kinds: tuple[types.Type, ...] = tuple(arguments)

        def generate(context: BaseContext, builder: ir.IRBuilder, signature: Signature, values: Values) -> ir.Value:
            parts = [builder.extract_value(values[1], k) for k in range(len(kinds))]
            word = ir.IntType(64)
            function_type = ir.FunctionType(word, [context.get_value_type(kind) for kind in kinds])
            return builder.call(builder.inttoptr(values[0], function_type.as_pointer()), parts)

        return types.int64(types.int64, arguments), generate

    @intrinsic
    def prefetch(typing: Context, address: types.Type) -> tuple[Signature, Generate]:
        """Begin to load the cache line at an address, which need not be valid."""

        def generate(context: BaseContext, builder: ir.IRBuilder, signature: Signature, values: Values) -> ir.Value:
            byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
            kind = ir.FunctionType(ir.VoidType(), [byte, word, word, word])
            function = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
            return builder.call(function, [builder.inttoptr(values[0], byte), word(0), word(3), word(1)])

        return types.void(types.intp), generate


def c_caller(result: types.Type, *arguments: types.Type) -> Callable[..., Any]:
    """Return a function that calls C functions of a signature (numba types) as `call(address, (a, b, …))`.

    Pointers have the type `types.uintp`: pass `array.ctypes.data`. Structures by value are not supported, because
    their calling conventions differ between systems.
    """
    declared = tuple(arguments)
    given_type = types.Tuple(declared)

    def call(typing: Context, address: types.Type, given: types.Type) -> tuple[Signature, Generate]:
        signature = result(types.uintp, given_type)

        def generate(context: BaseContext, builder: ir.IRBuilder, signature: Signature, values: Values) -> ir.Value:
            parts = cgutils.unpack_tuple(builder, values[1]) if declared else []
            function_type = ir.FunctionType(
                ir.VoidType() if result == types.void else context.get_value_type(result),
                [context.get_value_type(kind) for kind in declared],
            )
            function = builder.inttoptr(values[0], function_type.as_pointer())
            returned = builder.call(function, parts)
            return context.get_dummy_value() if result == types.void else returned

        return signature, generate

    return intrinsic(call)
