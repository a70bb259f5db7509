"""Several samples of the plain lattice at once, in the lanes of the processor's vectors. Compiled.

A sample may begin before the one before it has ended: its step m needs b_{m−1} of that one, so it lags by two steps.
So `LANES` samples go down the lattice together, each two steps behind the one before it: lane l holds sample LANES−1−l,
at step m + 2 (LANES−1−l) while the first is at step m. What the step of one sample leaves in b goes to the next sample
in the lane beside it, and only the first reads the memory and the last writes it. Lanes do what one sample after the
other would do, operation for operation, so that the bits are the same.
"""

from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES: Final = 8
"""Samples at once [count]: twice as many, or those of a tick at 10 kHz, were measured to be no faster."""

LANES_ORDER: Final = 2 * LANES - 1
"""Lowest order at which there are steps that all lanes take [1]."""


@intrinsic
def advance_lanes(typing: Any, k: Any, c: Any, b: Any, order: Any, f: Any) -> Any:
    """`hapscene.dsp.lattice.advance` of `LANES` samples f, in place: k, c, b (order+1,), f are addresses."""
    return types.void(*5 * [types.int64]), _generate


def _generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    number, index, n = ir.DoubleType(), ir.IntType(64), LANES
    lanes, order = ir.VectorType(number, n), arguments[3]
    k, c, b, samples = (builder.inttoptr(arguments[i], number.as_pointer()) for i in (0, 1, 2, 4))

    def at(array: Any, i: Any) -> Any:
        return builder.gep(array, [index(i) if isinstance(i, int) else i])

    def below(value: Any, less: int) -> Any:
        return builder.sub(value, index(less))

    def chosen(vector: Any, other: Any, places: list[int]) -> Any:
        return builder.shuffle_vector(vector, other, ir.Constant(ir.VectorType(ir.IntType(32), n), places))

    def window(array: Any, first: Any) -> tuple[Any, Any]:
        """The 2 n numbers from `first` on."""
        pointers = (builder.bitcast(at(array, i), lanes.as_pointer()) for i in (first, builder.add(first, index(n))))
        low, high = (builder.load(pointer, align=8) for pointer in pointers)
        return low, high

    def step(rows: Any, places: list[int], f: Any, passed: Any, into: Any) -> tuple[Any, Any]:
        """f and b after a step with the k and c that lie at `places` of a window; `into` is b for the first sample."""
        memory = builder.insert_element(ir.Constant(lanes, ir.Undefined), into, ir.IntType(32)(0))
        before = chosen(passed, memory, [*range(1, n), n])
        k, c = (chosen(*row, places) for row in rows)
        left = builder.fsub(builder.fmul(c, f), builder.fmul(k, before))
        return left, builder.fadd(builder.fmul(k, f), builder.fmul(c, before))

    def lane(sample: int) -> Any:
        return ir.IntType(32)(n - 1 - sample)

    back = range(n - 1, -1, -1)  # the sample in each lane
    f = passed = ir.Constant(lanes, [0.0] * n)
    rows = [window(array, below(order, 2 * n - 1)) for array in (k, c)]
    for i in range(2 * n - 1):  # the samples begin one by one
        if i % 2 == 0:
            f = builder.insert_element(f, builder.load(at(samples, i // 2)), lane(i // 2))
        if i < 2 * n - 2:
            places = [2 * n - 1 - i + 2 * j if 2 * j <= i else 0 for j in back]
            f, passed = step(rows, places, f, passed, builder.load(at(b, below(order, i + 1))))
    kept = [cgutils.alloca_once_value(builder, value) for value in (f, passed)]
    with cgutils.for_range(builder, below(order, 2 * n - 2)) as loop:
        m = below(builder.sub(order, loop.index), 2 * n - 2)
        rows = [window(array, below(m, 1)) for array in (k, c)]
        f, passed = (builder.load(value) for value in kept)
        f, passed = step(rows, [1 + 2 * j for j in back], f, passed, builder.load(at(b, below(m, 1))))
        builder.store(builder.extract_element(passed, ir.IntType(32)(0)), at(b, builder.add(m, index(2 * n - 2))))
        for value, place in zip((f, passed), kept, strict=True):
            builder.store(value, place)
    f, passed = (builder.load(value) for value in kept)
    rows = [window(array, index(0)) for array in (k, c)]
    for i in range(2 * n - 1):  # and end: b_0 is f_0
        heard = builder.extract_element(f, lane(i // 2))
        places = [max(0, 2 * j - i) for j in back]
        f, passed = step(rows, places, f, passed, number(0.0))
        if i % 2 == 0:
            passed = builder.insert_element(passed, heard, lane(i // 2))
            builder.store(heard, at(samples, i // 2))
        builder.store(builder.extract_element(passed, ir.IntType(32)(0)), at(b, 2 * n - 2 - i))
    return context.get_dummy_value()
