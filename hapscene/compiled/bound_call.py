"""A compiled function with its argument bound: one C function `void call(void *context)`, as any thread can call it.

So a vendor's library calls the servo's tick from its own thread, and Python calls it for the price of one pointer: to
take a hundred arrays apart costs more than a tick. The argument lies in memory as numba has it in registers; the call
touches nothing of Python.
"""

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any, Final

import numpy as np
from numba import typeof, types
from numba.core.registry import cpu_target
from numba.extending import intrinsic
from numpy.typing import NDArray

from hapscene.compiled.native import INTERPRETED, CFunction, native

__all__ = ["BoundCall", "loaded"]

_intrinsic: Any = intrinsic  # numba types neither as they are used
_typeof: Any = typeof

ALIGNED: Final = 64
"""Where the argument begins: a multiple of this [bytes]."""


class BoundCall:
    """A compiled function and what it is called with, which lives as long as this does.

    Attributes:
        address: of the C function.
        context: the address that it is called with.
    """

    def __init__(self, function: Callable[[Any, Any], None], argument: tuple[Any, ...]) -> None:
        """`function(address, kind)` is plain Python, to be compiled: it takes its argument by `loaded`."""
        self._argument = argument
        if INTERPRETED:
            self._function: Any = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(lambda context: function(argument, None))
            self.address, self.context = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0), 0
        else:
            kind = _typeof(argument)
            self._function = _compiled(function, kind)
            self.address = self._function.address
            self._memory: NDArray[np.uint8] = np.zeros(_size(kind) + ALIGNED, np.uint8)
            self.context = (self._memory.ctypes.data + ALIGNED - 1) // ALIGNED * ALIGNED
            _store(self.context, argument)
        self._call = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(self.address)

    def __call__(self) -> None:
        """Call it, without the GIL."""
        self._call(self.context)


if INTERPRETED:

    def loaded(address: Any, kind: Any) -> Any:
        """The argument that a `BoundCall` is bound to."""
        return address

else:

    @_intrinsic
    def loaded(typing: Any, address: Any, kind: Any) -> Any:
        """The argument that a `BoundCall` is bound to."""
        value = kind.instance_type

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.load(builder.inttoptr(values[0], context.get_value_type(value).as_pointer()))

        return value(types.uintp, kind), generate


@_intrinsic
def _stored(typing: Any, address: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        builder.store(values[1], builder.inttoptr(values[0], context.get_value_type(value).as_pointer()))
        return context.get_dummy_value()

    return types.void(types.uintp, value), generate


@native
def _store(address: int, value: Any) -> None:
    """Put an argument where `loaded` finds it."""
    _stored(np.uintp(address), value)


@cache
def _compiled(function: Callable[[Any, Any], None], kind: Any) -> CFunction:
    """The function for an argument of that type."""
    # its second argument has no size: the caller leaves it out
    return CFunction(types.void(types.uintp, types.TypeRef(kind)), function)


def _size(kind: Any) -> int:
    """How much memory an argument of that type takes [bytes]."""
    context: Any = cpu_target.target_context
    return int(context.get_abi_sizeof(context.get_value_type(kind)))
