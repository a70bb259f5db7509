"""Check of the sizes that a glTF file declares: trimesh trusts them, so a small file could fill the memory."""

import json
import struct
from collections import Counter
from collections.abc import Iterator
from itertools import chain
from typing import Final

from hapscene.errors import FormatError, MeshError
from hapscene.io.files import Json, memory_most_B, refusing

__all__ = ["check_gltf", "items_of", "parse_gltf"]

WIDTH_B: Final = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Size of each component type [bytes]: glTF 2.0, section 3.6.2.2."""

COLUMN_COUNT: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

PACKED_MAX: Final = 8
"""Maximum number of elements of an accessor without a buffer view, for each byte of data in the file [count]. Such
elements are all zero, sparse, or decoded from a compressed mesh, which has at least a few bits for each."""

JSON_MAX_B: Final = 256 * 1024 * 1024
"""Maximum size of the JSON in a GLB file [bytes]: 10,000 bodies with 8 swatches need 40 MB."""

CONTAINER_MAX: Final = 2_000_000
"""Maximum number of lists and objects in the JSON [count], about 60 bytes each: 10,000 bodies with 8 swatches need
700,000."""

CONTAINER_B: Final = 100
"""Memory of a parsed list or object [bytes]."""


def check_gltf(content: bytes, binary: bool, where: str, most_B: int) -> None:
    """Check a .gltf or (`binary`) .glb file: its accessors must fit in its data and unpack to at most `most_B` bytes.

    Raises:
        MeshError: the check fails, or this is not a glTF file.
    """
    with refusing(MeshError):
        tree, _ = parse_gltf(content, binary, where, strict=False)
    _check_tree(items_of(tree, "nodes", where), where)
    views = [_view(view, i, where) for i, view in enumerate(items_of(tree, "bufferViews", where))]
    ends: dict[int, int] = {}  # used size of each buffer; trimesh checks that views lie within
    for view in views:
        ends[view["buffer"]] = max(ends.get(view["buffer"], 0), view["byteOffset"] + view["byteLength"])
    accessors = items_of(tree, "accessors", where)
    sizes_B = [_size_B(accessor, i, views, sum(ends.values()), where) for i, accessor in enumerate(accessors)]
    used_B = sum(sizes_B[i] for i in _used(tree, where) if type(i) is int and 0 <= i < len(sizes_B))
    # trimesh creates an accessor again for each reference to it
    most_B = min(most_B, memory_most_B(sum(ends.values())))
    for total_B in (sum(view["byteLength"] for view in views), sum(sizes_B), used_B):
        if total_B > most_B:
            raise MeshError(f"{where}: unpacks to {total_B:,} bytes, at most {most_B:,} are allowed")


def _check_tree(nodes: list[dict[str, Json]], where: str) -> None:
    """Check that the nodes form a tree: trimesh reads only one of several parents, and does not detect cycles."""
    named = [node.get("children", []) for node in nodes]
    children = [[child for child in own if type(child) is int] if isinstance(own, list) else [] for own in named]
    held = {child for own in children for child in own}
    if len(held) < sum(map(len, children)):
        twice = next(child for child, count in Counter(chain.from_iterable(children)).items() if count > 1)
        raise MeshError(f"{where}: nodes[{twice}] has two parents; expected a tree")
    reached = [i for i in range(len(nodes)) if i not in held]
    for i in reached:  # the list grows during the loop
        reached += [child for child in children[i] if 0 <= child < len(nodes)]
    if len(reached) < len(nodes):
        within = min(set(range(len(nodes))) - set(reached))
        raise MeshError(f"{where}: nodes[{within}] is its own ancestor; expected a tree")


def parse_gltf(content: bytes, binary: bool, where: str, strict: bool = True) -> tuple[dict[str, Json], bytes]:
    """Parse a .gltf or (`binary`) .glb file, with a limit on its size; return the JSON tree and the binary chunk.

    Without `strict`, invalid UTF-8 and more lists are accepted, since trimesh reads the file itself.

    Raises:
        FormatError: not a glTF file, truncated, or its JSON is too large.
    """
    kind, text, chunk = "GLTF", content, b""
    if binary:
        kind = "GLB"
        if content[:4] != b"glTF" or content[16:20] != b"JSON":
            raise FormatError(f"{where}: not a valid GLB file: expected the header glTF and a JSON chunk")
        version, size_B, length_B = struct.unpack_from("<3I", content, 4)
        if version != 2 or size_B > len(content) or 20 + length_B > len(content):
            raise FormatError(f"{where}: not of version 2, or truncated: the header declares {size_B:,} bytes")
        text, rest = content[20 : 20 + length_B], content[20 + length_B :]
        if rest[4:8] == b"BIN\0":
            chunk = rest[8 : 8 + int.from_bytes(rest[:4], "little")]
        if len(text) > JSON_MAX_B:
            raise FormatError(f"{where}: {len(text):,} bytes of JSON, at most {JSON_MAX_B:,} are allowed")
    found = text.count(b"[") + text.count(b"{")
    most = CONTAINER_MAX if strict else max(CONTAINER_MAX, memory_most_B(len(content)) // CONTAINER_B)
    if found > most:
        raise FormatError(f"{where}: {found:,} lists and objects, at most {most:,} are allowed")
    try:
        tree = json.loads(text if strict or not binary else text.decode("utf-8-sig", errors="replace"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{where}: not a valid {kind} file, or truncated: {str(error)[:200]}") from None
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise FormatError(f"{where}: not a valid {kind} file: expected a JSON object with 'asset'")
    return tree, chunk


def _size_B(accessor: dict[str, Json], index: int, views: list[dict[str, int]], held_B: int, where: str) -> int:
    """Return the size of an accessor [bytes]."""
    name = f"accessors[{index}]"
    count = _non_negative_int(accessor, "count", name, where)
    kind, number = accessor.get("type"), accessor.get("componentType")
    if not isinstance(kind, str) or kind not in COLUMN_COUNT or type(number) is not int or number not in WIDTH_B:
        raise MeshError(f"{where}: {name} has a type that glTF 2.0 does not define")
    width_B = COLUMN_COUNT[kind] * WIDTH_B[number]
    if "bufferView" in accessor:
        at = _non_negative_int(accessor, "bufferView", name, where)
        if at >= len(views):
            raise MeshError(f"{where}: {name} refers to bufferViews[{at}], but there are only {len(views)}")
        stride_B = views[at]["byteStride"] or width_B
        end = _non_negative_int(accessor, "byteOffset", name, where, 0) + (count - 1) * stride_B + width_B
        if count and end > views[at]["byteLength"]:
            length_B = views[at]["byteLength"]
            raise MeshError(f"{where}: {name} has {count:,} elements, which do not fit in its {length_B:,} bytes")
    elif count > PACKED_MAX * held_B:
        raise MeshError(
            f"{where}: {name} has {count:,} elements without data; a file with {held_B:,} bytes of data may have "
            f"at most {PACKED_MAX * held_B:,}"
        )
    return count * width_B


def _view(view: dict[str, Json], index: int, where: str) -> dict[str, int]:
    absent = {"buffer": None, "byteLength": None, "byteOffset": 0, "byteStride": 0}
    return {
        key: _non_negative_int(view, key, f"bufferViews[{index}]", where, default) for key, default in absent.items()
    }


def _used(tree: dict[str, Json], where: str) -> Iterator[Json]:
    """Yield the accessors that meshes use, once for each use."""
    for mesh in items_of(tree, "meshes", where):
        for primitive in items_of(mesh, "primitives", where):
            attributes = primitive.get("attributes", {})
            if not isinstance(attributes, dict):
                raise MeshError(f"{where}: attributes of a mesh primitive must be an object")
            yield from attributes.values()
            yield primitive.get("indices")


def items_of(parent: dict[str, Json], key: str, where: str) -> list[dict[str, Json]]:
    """Return a list of objects in a glTF file; an empty list if the key is missing.

    Raises:
        MeshError: the value is not a list of objects.
    """
    items = parent.get(key, [])
    if not isinstance(items, list) or not all(isinstance(item, dict) for item in items):
        raise MeshError(f"{where}: {key} must be a list of objects")
    return items


def _non_negative_int(item: dict[str, Json], key: str, name: str, where: str, default: int | None = None) -> int:
    value = item.get(key, default)
    if type(value) is not int or value < 0:
        raise MeshError(f"{where}: {name}.{key} must be an integer, 0 or more, not {str(value)[:40]}")
    return value
