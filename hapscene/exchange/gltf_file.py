"""The two parts of a glTF file: its JSON tree and its buffer, bounded before anything is made of them."""

import base64
import binascii
import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from hapscene.errors import SceneError
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


def parts_of(path: Path, content: bytes) -> tuple[dict[str, Any], bytes]:
    """JSON tree and first buffer; no other file is opened.

    Raises:
        SceneError: damaged, truncated, or more than is read.
    """
    blob = b""
    if path.suffix.lower() == ".glb":
        if content[:4] != b"glTF" or len(content) < 20 or content[16:20] != b"JSON":
            raise SceneError(f"{path}: not a GLB file: it must begin with glTF, version 2, and a chunk of JSON")
        version, size, length = (int(n) for n in np.frombuffer(content, "<u4", 3, 4))
        if version != 2 or size > len(content) or 20 + length > len(content):
            raise SceneError(f"{path}: the file is truncated, or not of version 2: it says {size:,} bytes")
        text, rest = content[20 : 20 + length], content[20 + length :]
        if len(rest) >= 8 and rest[4:8] == b"BIN\0":
            blob = rest[8 : 8 + int.from_bytes(rest[:4], "little")]
    else:
        text = content
    tree = _parse(path, text)
    buffers = tree.get("buffers")
    if path.suffix.lower() != ".glb" and isinstance(buffers, list) and buffers and isinstance(buffers[0], dict):
        head, _, data = str(buffers[0].get("uri", "")).partition(";base64,")
        if head.startswith("data:"):
            try:
                blob = base64.b64decode(data, validate=True)
            except (binascii.Error, ValueError):
                raise SceneError(f"{path}: the buffer in the file is damaged: not base64") from None
    return tree, blob


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
