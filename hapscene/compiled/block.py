"""Named tuples of arrays that are passed to compiled code as one pointer.

Numba passes each array of a tuple as seven words, some 300 for a scene, in every call, and compile time grows with
every word. Here the words are stored side by side in memory that the tuple owns, and only their address is passed.
Compiled code loads an array where it uses it. The words never change, so the compiler may keep what it has loaded."""

# mypy: allow-untyped-calls

import hashlib
from collections.abc import Iterable
from typing import Any, Final, TypeVar

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core.base import BaseContext
from numba.core.datamodel.manager import DataModelManager
from numba.core.pythonapi import _UnboxContext as UnboxContext
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)
from numpy.typing import NDArray

from hapscene.errors import HapsceneError

__all__ = ["by_pointer"]

_I64: Final = ir.IntType(64)

Tuple = TypeVar("Tuple", bound=type)


class BlockType(types.Type):
    """Type of such a tuple in compiled code; `fields` is numba's type of the plain tuple."""

    def __init__(self, fields: types.NamedTuple) -> None:
        self.fields = fields
        digest = hashlib.sha256(str(fields).encode()).hexdigest()[:16]
        super().__init__(f"Block({fields.instance_class.__name__}, {digest})")

    def place_of(self, name: str) -> tuple[types.Array, int]:
        """Return the type of an array and the index of its first word."""
        index = self.fields.fields.index(name)
        return self.fields[index], sum(5 + 2 * array.ndim for array in list(self.fields)[:index])


@register_model(BlockType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: DataModelManager, kind: BlockType) -> None:
        super().__init__(manager, kind, _I64.as_pointer())


@infer_getattr
class _Attributes(AttributeTemplate):
    key = BlockType

    def generic_resolve(self, kind: BlockType, name: str) -> types.Array | None:  # type: ignore[override]
        return kind.place_of(name)[0] if name in kind.fields.fields else None


@lower_getattr_generic(BlockType)
def _load_array(context: BaseContext, builder: ir.IRBuilder, kind: BlockType, value: ir.Value, name: str) -> ir.Value:
    """Load an array as numba holds it in registers: owner, parent, size, item size, data, shape, strides.

    Owner and parent are null, because references are not counted.
    """
    array, first = kind.place_of(name)
    never_changes = builder.module.add_metadata([])

    def word(k: int) -> ir.Value:
        loaded = builder.load(builder.gep(value, [ir.Constant(_I64, first + k)]))
        loaded.set_metadata("invariant.load", never_changes)
        return loaded

    kinds, size = context.get_value_type(array).elements, context.get_abi_sizeof(context.get_data_type(array.dtype))
    packed = array.ndim == 1 and array.layout == "C"
    known = {0: None, 1: None, 3: size, 6: [ir.Constant(_I64, size)]} if packed else {0: None, 1: None, 3: size}
    found = ir.Constant.literal_struct([ir.Constant(kind, known.get(k, ir.Undefined)) for k, kind in enumerate(kinds)])
    found = builder.insert_value(found, word(2), 2)
    found = builder.insert_value(found, builder.inttoptr(word(4), kinds[4]), 4)
    for axis in range(array.ndim):
        found = builder.insert_value(found, word(5 + axis), [5, axis])
        if not packed:
            found = builder.insert_value(found, word(5 + array.ndim + axis), [6, axis])
    return found


@unbox(BlockType)
def _unbox(kind: BlockType, instance: ir.Value, c: UnboxContext) -> NativeValue:
    number = c.pyapi.object_getattr_string(instance, "address")
    address = c.pyapi.long_as_ulonglong(number)
    c.pyapi.decref(number)
    return NativeValue(c.builder.inttoptr(address, _I64.as_pointer()))


class _Block:
    """Mixin of named tuples of arrays that are passed by one pointer."""

    _words: NDArray[np.int64]
    address: int

    def __getattr__(self, name: str) -> int:
        """Compute `address` once: where the words of the arrays are stored, as long as the tuple exists."""
        if name != "address":
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")
        arrays: Any = self
        rows = [[0, 0, a.size, a.itemsize, a.ctypes.data, *a.shape, *a.strides] for a in arrays]
        self._words = np.array([word for row in rows for word in row], np.int64)
        self.address = int(self._words.ctypes.data)
        return self.address


def by_pointer(kind: Tuple) -> Tuple:
    """Decorate a `NamedTuple` of arrays: compiled code receives it as one pointer."""
    made: Any = type(kind.__name__, (_Block, kind), {"__doc__": kind.__doc__, "__module__": kind.__module__})
    made.__qualname__ = kind.__qualname__

    @typeof_impl.register(made)
    def _(value: Iterable[object], context: object) -> BlockType:
        fields = tuple(map(typeof, value))
        if not all(isinstance(field, types.Array) for field in fields):
            raise HapsceneError(f"{kind.__name__}: every field must be an array to be passed by pointer")
        return BlockType(types.NamedTuple(fields, made))

    block: Tuple = made
    return block
