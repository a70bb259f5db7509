"""Compiles effects: each once for its record types, then called by address.

The compiled form of every effect takes the same five arguments: addresses of touch, parameters, state and output, and
the table. One compiled tick thus calls any effects, and a scene never recompiles the tick. With NUMBA_DISABLE_JIT=1 the
"address" is an index into a list of Python functions.
"""

# mypy: allow-untyped-calls

from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core.base import BaseContext
from numba.core.errors import NumbaError
from numba.core.types import Type
from numba.core.typing.context import Context
from numba.core.typing.templates import Signature
from numba.extending import intrinsic
from numpy.typing import NDArray

from hapscene.compiled.entry import Generate, Values
from hapscene.compiled.native import INTERPRETED, CFunction, native
from hapscene.errors import EffectError
from hapscene.records import OUTPUT, TOUCH, Record
from hapscene.surface.effect import Effect

__all__ = ["call_effect", "compile_effect"]

_interpreted: Final[list[Effect]] = []
_native: Final[dict[int, tuple[Effect, CFunction]]] = {}


def compile_effect(effect: Effect) -> int:
    """Return the address for `call_effect`; the effect is compiled once per process and cached on disk.

    Raises:
        EffectError: `render` does not compile; the message has file, line and numba's reason.
    """
    if INTERPRETED:
        _interpreted.append(effect)
        return len(_interpreted) - 1
    known = _native.get(id(effect))
    if known is None:
        known = effect, _compile(effect)
        _native[id(effect)] = known
    return known[1].address


def _compile(effect: Effect) -> CFunction:
    table = types.Array(types.float64, 1, "C")
    arguments = (
        from_dtype(TOUCH),
        from_dtype(effect.param_dtype),
        table,
        from_dtype(effect.state_dtype),
        from_dtype(OUTPUT),
    )
    code = getattr(effect.render, "__code__", None)
    where = f"{code.co_filename}:{code.co_firstlineno}" if code else repr(effect.render)
    if code is None or code.co_argcount != 5:
        raise EffectError(f"effect {effect.name!r} ({where}): render must be a function of (touch, p, table, s, out)")
    try:
        return CFunction(types.void(*arguments), effect.render)
    except Exception as error:  # numba raises KeyError or AttributeError for an unknown field or function
        raise EffectError(f"effect {effect.name!r} ({where}) does not compile: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    """Return numba's message without banner, advice and blank lines."""
    skipped = ("Failed in nopython mode", "During:", "Pass nopython", "For more information", "http", "This error may")
    lines = [line.strip() for line in (str if isinstance(error, NumbaError) else repr)(error).splitlines()]
    return "; ".join(line for line in lines if line and not line.startswith(skipped))[:600]


Array = NDArray[np.float64]
Raw = NDArray[np.uint8]

if INTERPRETED:

    def call_effect(
        address: int, touch: Record, params: Raw, param_at: int, table: Array, states: Raw, state_at: int, out: Record
    ) -> None:
        """Call an effect whose records start at the given bytes of `params` and `states`."""
        effect = _interpreted[address]
        p = _record(params, param_at, effect.param_dtype)
        s = _record(states, state_at, effect.state_dtype)
        effect.render(touch, p, table, s, out)

    def _record(raw: Raw, start: int, dtype: np.dtype[np.void]) -> Any:
        return raw[start : start + dtype.itemsize].view(dtype).view(np.recarray)[0]

else:

    @intrinsic
    def _intrinsic_call(
        typing: Context, address: Type, touch: Type, p: Type, table: Type, s: Type, out: Type
    ) -> tuple[Signature, Generate]:
        signature = types.void(types.int64, touch, types.int64, table, types.int64, out)

        def generate(context: BaseContext, builder: ir.IRBuilder, signature: Signature, values: Values) -> ir.Value:
            pointer = ir.IntType(8).as_pointer()
            table_type = context.get_value_type(signature.args[3])
            function_type = ir.FunctionType(ir.VoidType(), [pointer, pointer, table_type, pointer, pointer])
            function = builder.inttoptr(values[0], function_type.as_pointer())
            builder.call(
                function,
                [
                    builder.bitcast(values[1], pointer),
                    builder.inttoptr(values[2], pointer),
                    values[3],
                    builder.inttoptr(values[4], pointer),
                    builder.bitcast(values[5], pointer),
                ],
            )
            return context.get_dummy_value()

        return signature, generate

    _call: Any = _intrinsic_call

    @native
    def call_effect(
        address: int, touch: Record, params: Raw, param_at: int, table: Array, states: Raw, state_at: int, out: Record
    ) -> None:
        """Call an effect whose records start at the given bytes of `params` and `states`."""
        _call(address, touch, params.ctypes.data + param_at, table, states.ctypes.data + state_at, out)
