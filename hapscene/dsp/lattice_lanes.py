"""Vectorised lattice filter: processes several samples at once in the lanes of SIMD registers. Compiled.

Step m of a sample needs only b_{m−1} of the previous sample, so a sample can start before the previous one has
finished. The samples pass through the lattice together, each `LAG` steps behind the previous one: the last lane holds
the first sample at step m, the lane before it the second sample at step m + `LAG`. Data move from lane to lane: k_m and
c_m arrive `LAG` steps after the previous sample used them, b one step earlier. Only the first sample reads the memory
b, and only the last one writes it. The operations are those of sequential processing, so the results are equal to the
bit."""

# mypy: allow-untyped-calls

from collections.abc import Callable
from typing import Final

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.typing.context import Context
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

from hapscene.compiled.entry import Generate, Values

__all__ = ["lanes_of"]

LAG: Final = 3
"""Steps between two samples. Two are enough for the data dependency, but each step would then wait for the previous
one, which takes 1.5 times as long at order 40."""


def _step(builder: ir.IRBuilder, n: int, past: list[ir.Value], first: list[ir.Value]) -> list[ir.Value]:
    """Emit one step of all n lanes.

    `past` holds f, b of the last LAG − 1 steps, and k and c of LAG steps; `first` is k, c, b of the first sample.
    """
    place = ir.IntType(32)
    silent = ir.Constant(ir.VectorType(ir.DoubleType(), n), [0.0] * n)
    along = ir.Constant(ir.VectorType(place, n), [*range(1, n), n])
    f, bs, rows = past[0], past[1:LAG], past[LAG:]
    ones = (builder.insert_element(silent, one, place(0)) for one in first)
    k, c, before = map(builder.shuffle_vector, (rows[0], rows[1], bs[0]), ones, [along] * 3)
    left = builder.fsub(builder.fmul(c, f), builder.fmul(k, before))
    return [left, *bs[1:], builder.fadd(builder.fmul(k, f), builder.fmul(c, before)), *rows[2:], k, c]


def lanes_of(n: int) -> tuple[Callable[..., None], int]:
    """Generates a function that processes n samples, and returns it with the lowest order that it supports.

    The function does what `hapscene.dsp.lattice.advance` does for each of n samples f, in place. Its arguments are
    (k, c, b, order, f): the order, and the addresses of arrays k, c, b (order+1,) and f (n,).
    """
    apart = LAG * (n - 1)  # steps from the first sample to the last

    def generate(context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Values) -> ir.Value:
        number, index, place, order = ir.DoubleType(), ir.IntType(64), ir.IntType(32), arguments[3]
        k, c, b, samples = (builder.inttoptr(arguments[i], number.as_pointer()) for i in (0, 1, 2, 4))
        silent = ir.Constant(ir.VectorType(number, n), [0.0] * n)

        def at(array: ir.Value, i: ir.Value, less: int = 0) -> ir.Value:
            return builder.gep(array, [builder.sub(i, index(less))])

        def read(m: ir.Value, less: int) -> list[ir.Value]:
            return [builder.load(at(*one)) for one in ((k, m, less), (c, m, less), (b, m, less + 1))]

        def write(past: list[ir.Value], m: ir.Value, less: int = 0) -> None:
            builder.store(builder.extract_element(past[LAG - 1], place(0)), at(b, m, less))

        past = [silent] * (3 * LAG)
        for i in range(apart + 1):  # prologue: the samples start one after the other
            if i % LAG == 0:
                sample = builder.load(at(samples, index(i // LAG)))
                past[0] = builder.insert_element(past[0], sample, place(n - 1 - i // LAG))
            past = _step(builder, n, past, read(order, i)) if i < apart else past
        kept = [cgutils.alloca_once_value(builder, value) for value in past]
        with cgutils.for_range(builder, builder.sub(order, index(apart))) as loop:
            m = builder.sub(order, loop.index)
            past = _step(builder, n, [builder.load(where) for where in kept], read(m, apart))
            write(past, m)
            for value, where in zip(past, kept, strict=True):
                builder.store(value, where)
        past = [builder.load(where) for where in kept]
        for i in range(apart + 1):  # epilogue: the samples end one after the other; b_0 is f_0
            lane = place(n - 1 - i // LAG)
            output = builder.extract_element(past[0], lane)
            past = _step(builder, n, past, [number(0.0)] * 3)
            if i % LAG == 0:
                builder.store(output, at(samples, index(i // LAG)))
                past[LAG - 1] = builder.insert_element(past[LAG - 1], output, lane)
            write(past, index(apart), i)
        return context.get_dummy_value()

    def advance_lanes(
        typing: Context, k: types.Type, c: types.Type, b: types.Type, order: types.Type, f: types.Type
    ) -> tuple[Signature, Generate]:
        return types.void(*5 * [types.int64]), generate

    return intrinsic(advance_lanes), apart
