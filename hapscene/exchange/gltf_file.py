"""The parts of a glTF file: its JSON tree and its buffers, bounded before anything is made of them."""

import base64
import binascii
import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.errors import SceneError
from hapscene.scene.companion import Companions
from hapscene.scene.mesh_check import FILE_MAX_B

JSON_MAX_B: Final = 256 * 1024 * 1024
"""Longest JSON of a GLB file that is read [bytes]: 10,000 bodies of 8 swatches have 40 MB."""

CONTAINER_MAX: Final = 2_000_000
"""Most lists and objects of a GLB's JSON [count], at some 60 bytes each: 10,000 bodies of 8 swatches have 700,000."""


def read_bounded(path: Path) -> bytes:
    """The content of a file that is no larger than `FILE_MAX_B`.

    Raises:
        SceneError: there is no such file, it is empty, too large, or cannot be read.
    """
    try:
        if path.is_file() and path.stat().st_size > FILE_MAX_B:
            raise SceneError(f"{path}: {path.stat().st_size:,} bytes; at most {FILE_MAX_B:,} are read")
        content = path.read_bytes()
    except FileNotFoundError:
        raise SceneError(f"{path}: no such file") from None
    except (OSError, ValueError) as error:
        raise SceneError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not content:
        raise SceneError(f"{path}: the file is empty")
    return content


def parts_of(path: Path, content: bytes) -> tuple[dict[str, Any], list[bytes]]:
    """JSON tree and buffers, those in files beside it among them.

    Raises:
        SceneError: damaged, truncated, more than is read, or without a file that it needs.
    """
    chunk = b""
    text = content
    if path.suffix.lower() == ".glb":
        if content[:4] != b"glTF" or len(content) < 20 or content[16:20] != b"JSON":
            raise SceneError(f"{path}: not a GLB file: it must begin with glTF, version 2, and a chunk of JSON")
        version, size, length = (int(n) for n in np.frombuffer(content, "<u4", 3, 4))
        if version != 2 or size > len(content) or 20 + length > len(content):
            raise SceneError(f"{path}: the file is truncated, or not of version 2: it says {size:,} bytes")
        text, rest = content[20 : 20 + length], content[20 + length :]
        if len(rest) >= 8 and rest[4:8] == b"BIN\0":
            chunk = rest[8 : 8 + int.from_bytes(rest[:4], "little")]
    tree = _parse(path, text)
    return tree, _buffers(path, tree, chunk)


def _buffers(path: Path, tree: dict[str, Any], chunk: bytes) -> list[bytes]:
    """The content of each buffer; empty for one without a URI that is not the chunk of a GLB."""
    found = tree.get("buffers", [])
    if not isinstance(found, list) or not all(isinstance(buffer, dict) for buffer in found):
        raise SceneError(f"{path}: buffers must be a list of objects")
    files = Companions(path, FILE_MAX_B, SceneError)
    read: dict[Any, bytes] = {}  # by its name: a small file can name a large one over and over
    blobs = []
    for index, buffer in enumerate(found):
        uri = buffer.get("uri")
        if uri is None:
            blobs.append(chunk if index == 0 else b"")
            continue
        if not isinstance(uri, str):
            raise SceneError(f"{path}: buffers[{index}].uri must be a text")
        if uri not in read:
            read[uri] = _embedded(path, uri) if uri.startswith("data:") else files.get(uri)
        blobs.append(read[uri])
    return blobs


def _embedded(path: Path, uri: str) -> bytes:
    _, mark, data = uri.partition(";base64,")
    try:
        if not mark:
            raise ValueError
        return base64.b64decode(data, validate=True)
    except (binascii.Error, ValueError):
        raise SceneError(f"{path}: the buffer in the file is damaged: not base64") from None


def _parse(path: Path, text: bytes) -> dict[str, Any]:
    if path.suffix.lower() == ".glb" and len(text) > JSON_MAX_B:
        raise SceneError(f"{path}: {len(text):,} bytes of JSON; at most {JSON_MAX_B:,} are read")
    found = text.count(b"[") + text.count(b"{")
    if found > CONTAINER_MAX:
        raise SceneError(f"{path}: {found:,} lists and objects; at most {CONTAINER_MAX:,} are read")
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{path}: not a glTF file, or truncated: {str(error)[:200]}") from None
    if not isinstance(tree, dict) or not isinstance(tree.get("asset"), dict):
        raise SceneError(f"{path}: not a glTF file: expected a JSON object with 'asset'")
    return tree
