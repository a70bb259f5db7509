"""Calls C functions by address from compiled code, such as those of a vendor's library that ctypes has loaded."""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["c_caller"]

_tuple: Any = types.Tuple  # numba's stubs type neither
_unpack: Any = cgutils.unpack_tuple


def c_caller(result: Any, *arguments: Any) -> Callable[..., Any]:
    """Return a function that calls C functions of a signature (numba types) as `call(address, (a, b, …))`.

    Pointers have the type `types.uintp`: pass `array.ctypes.data`. Structures by value are not supported, because
    their calling conventions differ between systems.
    """
    declared = tuple(arguments)
    given_type = _tuple(declared)

    def call(typing: Any, address: Any, given: Any) -> Any:
        signature = result(types.uintp, given_type)

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            parts = _unpack(builder, values[1]) if declared else []
            function_type = ir.FunctionType(
                ir.VoidType() if result == types.void else context.get_value_type(result),
                [context.get_value_type(kind) for kind in declared],
            )
            function = builder.inttoptr(values[0], function_type.as_pointer())
            returned = builder.call(function, parts)
            return context.get_dummy_value() if result == types.void else returned

        return signature, generate

    caller: Callable[..., Any] = intrinsic(call)
    return caller
