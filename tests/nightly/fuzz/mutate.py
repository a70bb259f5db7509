"""Damages valid files at random: bytes, words, lines and JSON values.

Containers (zip, GLB, npy, ...) are unpacked, one part is changed, and the container is written again with correct
checksums and lengths, so that the change reaches the code behind these checks.
"""

import contextlib
import io
import json
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from random import Random
from typing import Any

Join = Callable[[list[bytes]], bytes]

NUMBERS = (
    "nan",
    "inf",
    "-inf",
    "1e308",
    "-1",
    "0",
    "1e-320",
    str(2**31),
    str(2**63),
    "9" * 40,
    "",
    "x",
    "1e5000",
    "0x1",
)
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, 2**31, 2**63, 10**400, float("nan"), "", "é\x1b[2J\n", [], {}, [[]], [1, 2], {"a": 1},
)  # fmt: skip
MAGIC = (0, 1, 2, 3, 0x7F, 0x80, 0xFF, 0x7FFF, 0xFFFF, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)


def mutant(content: bytes, rng: Random) -> tuple[bytes, bool]:
    """Return damaged content, and whether the only damage is a missing range of bytes."""
    if rng.random() < 0.15:
        a, b = sorted((rng.randrange(len(content) + 1), rng.randrange(len(content) + 1)))
        a, b = (a, len(content)) if rng.random() < 0.5 else (a, min(b, a + rng.choice((1, 7, 300))))
        return content[:a] + content[b:], True
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        with contextlib.suppress(RecursionError):  # an earlier change has nested JSON too deeply
            content = changed(content, rng)
    return content, False


def changed(content: bytes, rng: Random) -> bytes:
    """Make one change, mostly inside a container: changes outside are caught by its checksum."""
    if (shell := unpacked(content, rng)) and rng.random() < 0.85:
        parts, join = shell
        i = rng.randrange(len(parts))
        parts[i] = changed(parts[i], rng)
        return join(parts)
    kinds: list[Callable[[bytes, Random], bytes]] = [in_bytes]
    if content and b"\0" not in content[:200] and sum(c < 9 for c in content) == 0:
        kinds += [in_words, in_words, in_lines]
        if content.lstrip()[:1] in (b"{", b"["):
            kinds += [in_json] * 6
    return rng.choice(kinds)(content, rng)


def in_bytes(content: bytes, rng: Random) -> bytes:
    """Change a bit, a byte or an integer; remove, insert, repeat or copy a range of bytes."""
    data, a = bytearray(content or b"\0"), rng.randrange(max(1, len(content)))
    b = a + rng.choice((1, 2, 4, 8, 80, 300))
    what = rng.randrange(7)
    if what == 0:
        data[a] ^= 1 << rng.randrange(8)
    elif what == 1:
        data[a] = rng.choice((0, 1, 9, 10, 11, 0x7F, 0x80, 0xFF, rng.randrange(256)))
    elif what == 2:
        size = rng.choice((2, 4, 8))
        a = a // 4 * 4 if rng.random() < 0.7 else a
        data[a : a + size] = (rng.choice(MAGIC) % (1 << 8 * size)).to_bytes(size, rng.choice(("little", "big")))
    elif what == 3:
        del data[a:b]
    elif what == 4:
        data[a:a] = rng.randbytes(b - a)
    elif what == 5:
        data[a:a] = data[a:b] * rng.choice((1, 1, 50))
    else:
        c = rng.randrange(len(data))
        data[a:b] = data[c : c + b - a]
    return bytes(data)


def in_words(content: bytes, rng: Random) -> bytes:
    """Replace a number or a word."""
    pattern = rb"-?\d+(\.\d+)?([eE][-+]?\d+)?" if rng.random() < 0.7 else rb"[^\s,;<>=\"'/()]+"
    found = list(re.finditer(pattern, content))
    if not found:
        return in_bytes(content, rng)
    place = rng.choice(found)
    other = rng.choice(found)[0]
    odd = (b"../../etc/passwd", b"\x1b[2J", b"\xff\xfe", b"A" * 5000, b"%s%n", b"1 2 3", "é\u202e".encode())
    new = other if rng.random() < 0.4 else rng.choice(NUMBERS).encode() if rng.random() < 0.7 else rng.choice(odd)
    return content[: place.start()] + new + content[place.end() :]


def in_lines(content: bytes, rng: Random) -> bytes:
    """Remove, repeat, swap or cut lines; in a text of one line, the parts between brackets or commas."""
    cut = b"\n" if content.count(b"\n") > 2 else b">" if b">" in content else b","
    lines = content.split(cut)
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    what = rng.randrange(4)
    if what == 0:
        del lines[i : i + rng.choice((1, 1, 5))]
    elif what == 1:
        lines[i:i] = [lines[i]] * rng.choice((1, 1, 200))
    elif what == 2:
        lines[i], lines[j] = lines[j], lines[i]
    else:
        lines[i] = lines[i][: rng.randrange(len(lines[i]) + 1)]
    return cut.join(lines)


def in_json(content: bytes, rng: Random) -> bytes:
    """Replace, remove, copy or rename a JSON value, or replace it by nested lists."""
    try:
        tree = json.loads(content)
    except (ValueError, RecursionError):  # broken by an earlier change
        return in_words(content, rng)
    places: list[tuple[Any, Any]] = []
    todo = [tree]
    while todo:
        node = todo.pop()
        keys = list(node) if isinstance(node, dict) else range(len(node))
        for key in list(keys)[:40]:
            places.append((node, key))
            if isinstance(node[key], dict | list):
                todo.append(node[key])
    if not places:
        return in_bytes(content, rng)
    texts = [json.loads(json.dumps(node[key])) for node, key in rng.choices(places, k=2)]
    node, key = rng.choice(places)
    what = rng.randrange(8)
    if what < 4:
        node[key] = rng.choice(VALUES)
    elif what == 4:
        del node[key]
    elif what == 5:
        node[key] = rng.choice(texts)
    elif what == 6 and isinstance(node, dict):
        node[rng.choice((f"{key}x", "", "é\x1b[2J", "A" * 300))] = node[key]
    else:
        node[key] = "NEST"
    text = json.dumps(tree, ensure_ascii=rng.random() < 0.5)
    depth = rng.choice((3, 900, 40_000))
    return text.replace('"NEST"', "[" * depth + "]" * depth).encode(errors="surrogatepass")


# Containers: each function returns the parts, and a function that joins them again.


def unpacked(content: bytes, rng: Random) -> tuple[list[bytes], Join] | None:
    """Return the parts of a known container, or None."""
    for start, shell in SHELLS.items():
        if content.startswith(start):
            try:
                return shell(content, rng)
            except Exception:  # broken by an earlier change, in any way
                return None
    return None


def _zip(content: bytes, rng: Random) -> tuple[list[bytes], Join]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = archive.namelist()
        parts = [archive.read(name) for name in names]
    methods = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    method = rng.choices(methods, (8, 8, 2, 1))[0]  # LZMA is slow
    if rng.random() < 0.1:
        i = rng.randrange(len(names))
        names[i] = rng.choice(("../x", "", names[0], names[i].upper(), "A" * 300))

    def join(parts: list[bytes]) -> bytes:
        import warnings

        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", method) as archive, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about duplicate names
            for name, part in zip(names, parts, strict=True):
                archive.writestr(zipfile.ZipInfo(name), part, method)
        return out.getvalue()

    return parts, join


def _glb(content: bytes, rng: Random) -> tuple[list[bytes], Join]:
    size = struct.unpack_from("<I", content, 12)[0]
    tree, rest = content[20 : 20 + size], content[28 + size :]

    def join(parts: list[bytes]) -> bytes:
        body = b""
        for kind, part, pad in ((b"JSON", parts[0], b" "), (b"BIN\0", parts[1], b"\0")):
            part += pad * (-len(part) % 4)
            body += struct.pack("<I4s", len(part), kind) + part
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    return [tree, rest], join


def _record(content: bytes, rng: Random) -> tuple[list[bytes], Join]:
    first, at, parts = content.index(b"\n") + 1, content.index(b"\n") + 1, []
    while at < len(content):
        size = struct.unpack_from("<I", content, at + 4)[0]
        parts.append(content[at : at + 4] + content[at + 8 : at + 16 + size])
        at += 20 + size
    line = content[:first]

    def sealed(part: bytes) -> bytes:
        part = part.ljust(12, b"\0")
        body = part[:4] + struct.pack("<I", len(part) - 12) + part[4:]
        return body + struct.pack("<I", zlib.crc32(body))

    return parts, lambda parts: line + b"".join(map(sealed, parts))


def _probe(content: bytes, rng: Random) -> tuple[list[bytes], Join]:
    from hapscene.io.probe_protocol import sealed

    bodies = [line.rpartition(b"*")[0] for line in content.splitlines()]
    return bodies, lambda bodies: b"".join(map(sealed, bodies))


SHELLS = {
    b"PK\3\4": _zip, b"glTF": _glb, b"hapscene record": _record, b"#hapscene-probe": _probe,
}  # fmt: skip
