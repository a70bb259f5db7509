"""What a glTF file says it holds, held against its data: trimesh believes it, so a small file could take all memory."""

import json
import struct
from collections import Counter
from collections.abc import Iterator
from itertools import chain
from typing import Any, Final

from hapscene.errors import FormatError, MeshError
from hapscene.io.files import memory_most_B, refusing

__all__ = ["check_gltf", "items_of", "parse_gltf"]

WIDTH_B: Final = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Bytes of each type of number: glTF 2.0, 3.6.2.2."""

COLUMN_COUNT: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

PACKED_MAX: Final = 8
"""Most elements of an accessor without data of its own, for each byte of data in the file [count]. They are all zero,
but for the sparse ones, or come from a compressed mesh, of which the smallest have a few bits each."""

JSON_MAX_B: Final = 256 * 1024 * 1024
"""Longest JSON of a GLB file that is read [bytes]: 10,000 bodies of 8 swatches have 40 MB."""

CONTAINER_MAX: Final = 2_000_000
"""Most lists and objects of a file's JSON [count], at some 60 bytes each: 10,000 bodies of 8 swatches have 700,000."""

CONTAINER_B: Final = 100
"""Memory that a list or object takes [bytes]."""


def check_gltf(content: bytes, binary: bool, where: str, most_B: int) -> None:
    """Refuse a .gltf, or a (`binary`) .glb, whose accessors name more than the file can hold, or unpack to too much.

    Raises:
        MeshError: with the first of them; or it is no such file.
    """
    with refusing(MeshError):
        tree, _ = parse_gltf(content, binary, where, strict=False)
    _check_tree(items_of(tree, "nodes", where), where)
    views = [_view(view, i, where) for i, view in enumerate(items_of(tree, "bufferViews", where))]
    ends: dict[int, int] = {}  # of each buffer as far as views reach; that they lie within it, trimesh checks first
    for view in views:
        ends[view["buffer"]] = max(ends.get(view["buffer"], 0), view["byteOffset"] + view["byteLength"])
    accessors = items_of(tree, "accessors", where)
    sizes_B = [_size_B(accessor, i, views, sum(ends.values()), where) for i, accessor in enumerate(accessors)]
    used_B = sum(sizes_B[i] for i in _used(tree, where) if type(i) is int and 0 <= i < len(sizes_B))
    # trimesh makes what is named over and over anew each time
    most_B = min(most_B, memory_most_B(sum(ends.values())))
    for total_B in (sum(view["byteLength"] for view in views), sum(sizes_B), used_B):
        if total_B > most_B:
            raise MeshError(f"{where}: unpacks to {total_B:,} bytes; at most {most_B:,} are read")


def _check_tree(nodes: list[dict[str, Any]], where: str) -> None:
    """Refuse nodes that hang in two places, of which trimesh would take one, or within themselves."""
    named = [node.get("children", []) for node in nodes]
    children = [[child for child in own if type(child) is int] if isinstance(own, list) else [] for own in named]
    held = {child for own in children for child in own}
    if len(held) < sum(map(len, children)):
        twice = next(child for child, count in Counter(chain.from_iterable(children)).items() if count > 1)
        raise MeshError(f"{where}: nodes[{twice}] hangs in two places; expected a tree of nodes")
    reached = [i for i in range(len(nodes)) if i not in held]
    for i in reached:  # which grows meanwhile
        reached += [child for child in children[i] if 0 <= child < len(nodes)]
    if len(reached) < len(nodes):
        within = min(set(range(len(nodes))) - set(reached))
        raise MeshError(f"{where}: nodes[{within}] hangs within itself; expected a tree of nodes")


def parse_gltf(content: bytes, binary: bool, where: str, strict: bool = True) -> tuple[dict[str, Any], bytes]:
    """The JSON tree of a .gltf or a (`binary`) .glb, bounded before it is made, and the latter's chunk of data.

    What is not to be `strict` may have texts that are not UTF-8, and more lists: trimesh reads it itself.

    Raises:
        FormatError: no such file, truncated, or with more JSON than is read.
    """
    kind, text, chunk = "GLTF", content, b""
    if binary:
        kind = "GLB"
        if content[:4] != b"glTF" or content[16:20] != b"JSON":
            raise FormatError(f"{where}: not a readable GLB file: it must begin with glTF, version 2, and JSON")
        version, size_B, length_B = struct.unpack_from("<3I", content, 4)
        if version != 2 or size_B > len(content) or 20 + length_B > len(content):
            raise FormatError(f"{where}: the file is truncated, or not of version 2: it says {size_B:,} bytes")
        text, rest = content[20 : 20 + length_B], content[20 + length_B :]
        if rest[4:8] == b"BIN\0":
            chunk = rest[8 : 8 + int.from_bytes(rest[:4], "little")]
        if len(text) > JSON_MAX_B:
            raise FormatError(f"{where}: {len(text):,} bytes of JSON; at most {JSON_MAX_B:,} are read")
    found = text.count(b"[") + text.count(b"{")
    most = CONTAINER_MAX if strict else max(CONTAINER_MAX, memory_most_B(len(content)) // CONTAINER_B)
    if found > most:
        raise FormatError(f"{where}: {found:,} lists and objects; at most {most:,} are read")
    try:
        tree = json.loads(text if strict or not binary else text.decode("utf-8-sig", errors="replace"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{where}: not a readable {kind} file, or truncated: {str(error)[:200]}") from None
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise FormatError(f"{where}: not a readable {kind} file: expected a JSON object with 'asset'")
    return tree, chunk


def _size_B(accessor: dict[str, Any], index: int, views: list[dict[str, int]], held_B: int, where: str) -> int:
    """Bytes of an accessor's elements."""
    name = f"accessors[{index}]"
    count = _whole(accessor, "count", name, where)
    kind, number = accessor.get("type"), accessor.get("componentType")
    if not isinstance(kind, str) or kind not in COLUMN_COUNT or type(number) is not int or number not in WIDTH_B:
        raise MeshError(f"{where}: {name} is of a type that glTF does not know")
    width_B = COLUMN_COUNT[kind] * WIDTH_B[number]
    if "bufferView" in accessor:
        at = _whole(accessor, "bufferView", name, where)
        if at >= len(views):
            raise MeshError(f"{where}: {name} names bufferViews[{at}]; there are {len(views)}")
        stride_B = views[at]["byteStride"] or width_B
        end = _whole(accessor, "byteOffset", name, where, 0) + (count - 1) * stride_B + width_B
        if count and end > views[at]["byteLength"]:
            length_B = views[at]["byteLength"]
            raise MeshError(f"{where}: {name} has {count:,} elements, more than its {length_B:,} bytes can hold")
    elif count > PACKED_MAX * held_B:
        raise MeshError(
            f"{where}: {name} has {count:,} elements without data of their own; with {held_B:,} bytes of data in the "
            f"file, at most {PACKED_MAX * held_B:,} are taken"
        )
    return count * width_B


def _view(view: dict[str, Any], index: int, where: str) -> dict[str, int]:
    absent = {"buffer": None, "byteLength": None, "byteOffset": 0, "byteStride": 0}
    return {key: _whole(view, key, f"bufferViews[{index}]", where, default) for key, default in absent.items()}


def _used(tree: dict[str, Any], where: str) -> Iterator[Any]:
    """The accessors that the meshes name, as often as they do: trimesh makes each anew."""
    for mesh in items_of(tree, "meshes", where):
        for primitive in items_of(mesh, "primitives", where):
            attributes = primitive.get("attributes", {})
            if not isinstance(attributes, dict):
                raise MeshError(f"{where}: the attributes of a mesh must be an object")
            yield from attributes.values()
            yield primitive.get("indices")


def items_of(parent: dict[str, Any], key: str, where: str) -> list[dict[str, Any]]:
    """The objects in a list of a glTF file; none where it is not there.

    Raises:
        MeshError: it is no list of objects.
    """
    items = parent.get(key, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise MeshError(f"{where}: {key} must be a list of objects")
    return items


def _whole(item: dict[str, Any], key: str, name: str, where: str, default: int | None = None) -> int:
    value = item.get(key, default)
    if type(value) is not int or value < 0:
        raise MeshError(f"{where}: {name}.{key} must be a whole number, 0 or more, is {str(value)[:40]}")
    return value
