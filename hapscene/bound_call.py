"""A compiled function with its arguments bound: one C function `void call(void *context)`, as any thread can call it.

So a vendor's library calls the servo's tick from its own thread, and Python calls it for the price of one pointer: to
take a hundred arrays apart costs more than a tick. The arguments lie in memory as numba has them in registers; the call
touches nothing of Python.
"""

import ctypes
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import cfunc, njit, typeof, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from hapscene.native import INTERPRETED

_cfunc: Any = cfunc  # numba types neither options nor intrinsics as they are used
_njit: Any = njit
_intrinsic: Any = intrinsic
_typeof: Any = typeof


class BoundCall:
    """A compiled function and what it is called with, which lives as long as this does.

    Attributes:
        address: of the C function.
        context: the address that it is called with.
    """

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        """`function` is compiled (`native`), and returns nothing."""
        self._arguments = arguments
        if INTERPRETED:
            self._function: Any = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(lambda context: function(*arguments))
            self.address, self.context = int(ctypes.cast(self._function, ctypes.c_void_p).value or 0), 0
        else:
            kind = _typeof(arguments)
            room, load = _memory_of(kind)
            self._memory: NDArray[np.uint8] = np.zeros(room(arguments) + 64, np.uint8)
            self.context = (self._memory.ctypes.data + 63) // 64 * 64
            _storer(kind)(self.context, arguments)

            @_cfunc(types.void(types.uintp), nopython=True, _nrt=False)
            def called(context: int) -> None:
                function(*load(context))

            self._function = called
            self.address = int(self._function.address)
        self._call = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(self.address)

    def __call__(self) -> None:
        """Call it, without the GIL."""
        self._call(self.context)


def _memory_of(kind: Any) -> tuple[Callable[[tuple[Any, ...]], int], Any]:
    """What tells the size of a tuple of that type in memory, and the intrinsic that takes it from there."""

    @_intrinsic
    def size(typing: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind)))

        return types.intp(value), generate

    @_intrinsic
    def load(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            place = builder.inttoptr(values[0], context.get_data_type(kind).as_pointer())
            return context.unpack_value(builder, kind, place)

        return kind(types.uintp), generate

    @_njit(_nrt=False)
    def room(value: Any) -> int:
        return int(size(value))

    return room, load


def _storer(kind: Any) -> Any:
    """What puts a tuple of that type at an address."""

    @_intrinsic
    def store(typing: Any, address: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            place = builder.inttoptr(values[0], context.get_data_type(kind).as_pointer())
            context.pack_value(builder, kind, values[1], place)
            return context.get_dummy_value()

        return types.void(types.uintp, kind), generate

    @_njit(_nrt=False)
    def put(address: int, value: Any) -> None:
        store(np.uintp(address), value)

    return put
