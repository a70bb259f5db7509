"""A compiled function with its argument bound: a C function `void call(void *context)` that any thread can call.

A vendor's library thus calls the tick of a servo from its own thread, and Python calls it at the price of one pointer;
to unpack a hundred arrays takes longer than a tick. The argument is stored in memory as numba holds it in registers.
The call uses nothing of Python.
"""

# mypy: allow-untyped-calls

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core.base import BaseContext
from numba.core.registry import cpu_target
from numba.core.typing.context import Context
from numba.core.typing.templates import Signature
from numba.extending import intrinsic
from numpy.typing import NDArray

from hapscene.compiled.entry import Generate, Values
from hapscene.compiled.native import INTERPRETED, CFunction, native

__all__ = ["BoundCall"]

_intrinsic: Any = intrinsic  # of functions that Python calls

ALIGNED: Final = 64
"""Alignment of the argument [bytes]."""


class BoundCall:
    """A compiled function and its argument, which stays alive with this object.

    Attributes:
        address: address of the C function.
        context: argument of the C function.
    """

    def __init__(self, function: Callable[[Any], object], argument: tuple[object, ...]) -> None:
        """Bind an argument to a compiled function of one argument."""
        self._argument = argument
        if INTERPRETED:
            self._function: Any = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(lambda context: function(argument))
            self.address, self.context = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0), 0
        else:
            kind = typeof(argument)
            self._function = _compiled(function, kind)
            self.address = self._function.address
            self._memory: NDArray[np.uint8] = np.zeros(_size(kind) + ALIGNED, np.uint8)
            self.context = (self._memory.ctypes.data + ALIGNED - 1) // ALIGNED * ALIGNED
            _store(self.context, argument)
        self._call = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(self.address)

    def __call__(self) -> None:
        """Call the function without the GIL."""
        self._call(self.context)


@_intrinsic
def _loaded(typing: Context, address: types.Type, kind: types.TypeRef) -> tuple[Signature, Generate]:
    """Return the argument of a type that `_store` has stored."""
    value = kind.instance_type

    def generate(context: BaseContext, builder: ir.IRBuilder, signature: Signature, values: Values) -> ir.Value:
        return builder.load(builder.inttoptr(values[0], context.get_value_type(value).as_pointer()))

    return value(types.uintp, kind), generate


@_intrinsic
def _stored(typing: Context, address: types.Type, value: types.Type) -> tuple[Signature, Generate]:
    def generate(context: BaseContext, builder: ir.IRBuilder, signature: Signature, values: Values) -> ir.Value:
        builder.store(values[1], builder.inttoptr(values[0], context.get_value_type(value).as_pointer()))
        return context.get_dummy_value()

    return types.void(types.uintp, value), generate


@native
def _store(address: int, value: object) -> None:
    """Store an argument for `_loaded`."""
    _stored(np.uintp(address), value)


@cache
def _compiled(function: Callable[[Any], object], kind: types.Type) -> CFunction:
    """Compile the function for an argument type."""

    def call(address: Any, kind: Any) -> None:
        function(_loaded(address, kind))

    # a type has no size, so the caller of the C function omits it
    return CFunction(types.void(types.uintp, types.TypeRef(kind)), call)


def _size(kind: types.Type) -> int:
    """Return the memory that an argument of a type needs [bytes]."""
    context = cpu_target.target_context
    return int(context.get_abi_sizeof(context.get_value_type(kind)))
