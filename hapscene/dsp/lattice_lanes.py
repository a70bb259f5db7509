"""Several samples of the plain lattice at once, in the lanes of the processor's vectors. Compiled.

A sample may begin before the one before it has ended: its step m needs b_{m−1} of that one, and no more. So the samples
go down the lattice together, each `LAG` steps behind the one before it: the last lane holds the first sample, at step
m, the lane before it the second, at step m + `LAG`. What they need goes from lane to lane: k_m and c_m by `LAG` steps
after the sample before, what that one left in b by one less. Only the first sample reads the memory, and only the last
writes it. Each does what one sample after the other would do, operation for operation, so that the bits are the same.
"""

from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["lanes_of"]

_cgutils: Any = cgutils

LAG: Final = 3
"""Steps between two samples [count]. Two would do, but then each step waits for the one before it: at order 40 it
takes half as long again."""


def lanes_of(n: int) -> tuple[Any, int]:
    """`hapscene.dsp.lattice.advance` of n samples f, in place, and the lowest order for which it can be called.

    Its arguments are addresses of numbers, and the order: (k, c, b, order, f); k, c, b (order+1,), f (n,).
    """
    apart = LAG * (n - 1)  # steps from the first sample to the last

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        number, index, place, order = ir.DoubleType(), ir.IntType(64), ir.IntType(32), arguments[3]
        k, c, b, samples = (builder.inttoptr(arguments[i], number.as_pointer()) for i in (0, 1, 2, 4))
        silent = ir.Constant(ir.VectorType(number, n), [0.0] * n)
        along = ir.Constant(ir.VectorType(place, n), [*range(1, n), n])

        def at(array: Any, i: Any, less: int = 0) -> Any:
            return builder.gep(array, [builder.sub(i, index(less))])

        def read(m: Any, less: int) -> list[Any]:
            return [builder.load(at(*one)) for one in ((k, m, less), (c, m, less), (b, m, less + 1))]

        def step(past: list[Any], first: list[Any]) -> list[Any]:
            """On from f, b of the last LAG − 1 steps, and k and c of LAG; `first` are the first sample's k, c and b."""
            f, bs, rows = past[0], past[1:LAG], past[LAG:]
            ones = (builder.insert_element(silent, one, place(0)) for one in first)
            k, c, before = map(builder.shuffle_vector, (rows[0], rows[1], bs[0]), ones, [along] * 3)
            left = builder.fsub(builder.fmul(c, f), builder.fmul(k, before))
            return [left, *bs[1:], builder.fadd(builder.fmul(k, f), builder.fmul(c, before)), *rows[2:], k, c]

        def write(past: list[Any], m: Any, less: int = 0) -> None:
            builder.store(builder.extract_element(past[LAG - 1], place(0)), at(b, m, less))

        past = [silent] * (3 * LAG)
        for i in range(apart + 1):  # the samples begin one by one
            if i % LAG == 0:
                sample = builder.load(at(samples, index(i // LAG)))
                past[0] = builder.insert_element(past[0], sample, place(n - 1 - i // LAG))
            past = step(past, read(order, i)) if i < apart else past
        kept = [_cgutils.alloca_once_value(builder, value) for value in past]
        with _cgutils.for_range(builder, builder.sub(order, index(apart))) as loop:
            m = builder.sub(order, loop.index)
            past = step([builder.load(where) for where in kept], read(m, apart))
            write(past, m)
            for value, where in zip(past, kept, strict=True):
                builder.store(value, where)
        past = [builder.load(where) for where in kept]
        for i in range(apart + 1):  # and end: b_0 is f_0
            lane = place(n - 1 - i // LAG)
            heard = builder.extract_element(past[0], lane)
            past = step(past, [number(0.0)] * 3)
            if i % LAG == 0:
                builder.store(heard, at(samples, index(i // LAG)))
                past[LAG - 1] = builder.insert_element(past[LAG - 1], heard, lane)
            write(past, index(apart), i)
        return context.get_dummy_value()

    def advance_lanes(typing: Any, k: Any, c: Any, b: Any, order: Any, f: Any) -> Any:
        return types.void(*5 * [types.int64]), generate

    return intrinsic(advance_lanes), apart
