"""Files from strangers: whatever is in them, a swatch or a `SwatchError` comes out, within the stated memory."""

import base64
import json
import random
import subprocess
import sys
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hapscene.errors import SwatchError
from hapscene.files import CONTAINER_MAX, VALUE_MAX
from hapscene.surface.look import Look
from hapscene.surface.swatch import Swatch
from hapscene.surface.swatch_file import BYTES_MAX, save_swatch, swatch_from_json
from hapscene.surface.swatch_file import swatch_to_json as to_json
from hapscene.surface.taps import Taps
from hapscene.surface.texture import MODEL_MAX, Texture
from hapscene.swatches.library import load_swatch, shipped_swatches

OPENING_BYTES = 400e6
"""The stated limit of memory for opening any file [bytes]; see `swatch_file.BYTES_MAX`."""

PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNkYPhfDwAChwGA60e6kgAAAABJRU5ErkJggg=="
)

NASTY: list[Any] = [
    None, True, False, 0, 1, -1, 2, 0.5, -0.0, 1e-320, 1e-300, 1e300, -1e300, 1e308, 3.141592653589793, 10**40,
    -(10**400), 2**31, 2**63, "", "lsf", "hatt", "\x00", "\ud800", "😀" * 50, "a" * 200_000, [], {}, [[]], [{}], [[[]]],
    [None], ["a"], [True], [1], [0, 0, 0], [[0, 1, 2]], {"a": 1}, {"": {"": 0}}, [1e300] * 10,
]  # fmt: skip


def small() -> Swatch:
    """A swatch with everything in it, small enough to be mutated often."""
    rng = np.random.default_rng(0)
    lsf = np.sort(rng.uniform(0.1, 3.0, (4, 6)), axis=1) + np.linspace(0, 0.1, 6)
    texture = Texture(1e4, [0, 0, 2, 2], [0, 0.2, 0, 0.2], [[0, 1, 2], [1, 3, 2]], lsf, [0, 0, 0, 1.0])
    row = np.array([0.1, 0.2])
    taps = Taps(row, 40 * row, 900 * row, 500 * row, rng.uniform(-1, 1, (2, 5)), 1000.0)
    told: dict[str, Any] = {"provenance": "p", "licence": "l", "effects": {"x": {"y": 1.0}}}
    told |= {"intervals": {"friction_static": (0.1, 0.2)}, "absent": {"stiffness_N_m": "not measured"}}
    return Swatch("small", texture=texture, taps=taps, look=Look(0.5, 0.01, PIXEL), **told)


def whole(swatch: Swatch) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(to_json(swatch))
    return content


def paths(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a JSON value."""
    yield path
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        yield from paths(value, (*path, key))


def changed(content: dict[str, Any], dice: random.Random) -> str:
    """The text with one to three values replaced, removed, doubled or moved."""
    content = json.loads(json.dumps(content))
    for _ in range(dice.choice([1, 1, 1, 2, 3])):
        *way, last = dice.choice([path for path in paths(content) if path])
        place: Any = content
        for key in way:
            place = place[key]
        action = dice.randrange(7)
        if action == 0:
            del place[last]
        elif action == 1 and isinstance(place, list):
            place.insert(last, deepcopy(place[last]))
        elif action == 2 and isinstance(place, dict):
            place[dice.choice(["force_N", "taps", "a" * 300, "x\n", ""])] = deepcopy(place[last])
        elif action >= 3 and isinstance(place[last], float) and dice.random() < 0.7:
            place[last] = place[last] * dice.choice([-1, 0, 2, 1e3, 1e-3, 1e150, 1 + 1e-15])
        else:
            place[last] = deepcopy(dice.choice(NASTY))
    return json.dumps(content)


def damaged(data: bytes, dice: random.Random) -> bytes:
    """The bytes with a few flipped, cut out, doubled or replaced."""
    wrong = bytearray(data)
    for _ in range(dice.choice([1, 1, 2, 6])):
        at = dice.randrange(len(wrong))
        end = min(len(wrong), at + dice.choice([1, 1, 1, 2, 10, 500]))
        wrong[at:end] = dice.choice(
            [b"", bytes(wrong[at:end] * 2), dice.randbytes(end - at), b"9" * 30, b"e308", b"-", b'"', b"[", b"}", b","]
        )
        if not wrong:
            return b""
    return bytes(wrong)


def use(data: bytes | str) -> bool:
    """Opens it and, where it opens, asks it what a renderer asks; whether it opened."""
    try:
        swatch = swatch_from_json(data)
    except SwatchError as error:
        assert 0 < len(str(error)) < 700 and "\n" not in str(error)
        return False
    assert swatch_from_json(to_json(swatch)) == swatch
    if swatch.texture is not None:
        a, variance = swatch.texture.model(1.0, 0.1)
        assert np.all(np.isfinite(a)) and np.isfinite(variance) and variance >= 0.0
    if swatch.taps is not None:
        assert np.all(np.isfinite(swatch.taps.at(0.1)))
    return True


def fuzz(count: int, seed: int) -> int:
    dice = random.Random(seed)
    texts = [small(), *(load_swatch(name) for name in shipped_swatches()[: 2 if count < 1000 else None])]
    contents, datas = [whole(s) for s in texts], [to_json(s).encode() for s in texts]
    opened = 0
    for i in range(count):
        which = 0 if i % 4 else dice.randrange(len(texts))
        opened += use(changed(contents[which], dice) if i % 2 else damaged(datas[which], dice))
    return opened


def test_mutated_files_open_or_are_refused() -> None:
    opened = fuzz(600, 0)
    assert 40 < opened < 560  # the mutations are neither all caught at the door nor all harmless


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(1, 9))
def test_many_mutated_files(seed: int) -> None:
    fuzz(20_000, seed)


@pytest.mark.parametrize("data", ["{}", "null", "1", '"x"', "[]", b"\xff\xfe{\x00}\x00", b"\xef\xbb\xbf{}"])
def test_other_json(data: bytes | str) -> None:
    assert not use(data)


def test_a_name_that_no_file_can_have() -> None:
    for name in ("a\0b.swatch", "x" * 10_000 + ".swatch"):
        with pytest.raises(SwatchError, match="cannot be read"):
            load_swatch(name)


HEAD = '{"format": "hapscene swatch", "version": 1, "name": "x", '

BULKY = {
    # one sign beyond the Basic Multilingual Plane makes Python take four bytes for each of the text's
    "strings": HEAD + '"provenance": ["😀",' + ",".join(['"ab"'] * (VALUE_MAX - 100)) + "]",
    "floats": HEAD + '"albedo_rgb": ["😀",' + ",".join(["1e1"] * (VALUE_MAX - 100)) + "]",
    "keys": HEAD + '"effects": {"a":{"😀":1,' + ",".join(f'"k{i}":1.5' for i in range(49_000)) + "}}",
    "lists": HEAD + '"texture": ["😀",' + ",".join(["[1.5]"] * (CONTAINER_MAX - 100)) + "]",
    "text": HEAD + '"provenance": "😀' + "a" * (BYTES_MAX - 200) + '"',
    "brackets": "[" * (BYTES_MAX - 1),
}

MEASURE = """
import resource, sys
from hapscene.errors import SwatchError
from hapscene.swatches.library import load_swatch
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    load_swatch(sys.argv[1])
except SwatchError:
    pass
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
print(peak * (1 if sys.platform == "darwin" else 1024))
"""


def opening_bytes(path: Path) -> float:
    """Memory that a process needs more, at its peak, for opening a file."""
    pytest.importorskip("resource", reason="memory is measured on Unix only")
    done = subprocess.run([sys.executable, "-c", MEASURE, str(path)], capture_output=True, text=True, check=True)
    return float(done.stdout)


@pytest.mark.parametrize("case", ["strings", pytest.param("floats", marks=pytest.mark.soak), "brackets"])
def test_bulky_files_stay_within_the_stated_memory(tmp_path: Path, case: str) -> None:
    path = tmp_path / "x.swatch"
    text = BULKY[case]
    path.write_text(text + " " * (BYTES_MAX - len(text.encode()) - 1) + "}", encoding="utf-8")
    assert path.stat().st_size == BYTES_MAX
    assert opening_bytes(path) < OPENING_BYTES


@pytest.mark.soak
@pytest.mark.parametrize("case", ["keys", "lists", "text"])
def test_more_bulky_files(tmp_path: Path, case: str) -> None:
    test_bulky_files_stay_within_the_stated_memory(tmp_path, case)


@pytest.mark.soak
def test_the_largest_swatch_that_is_allowed(tmp_path: Path) -> None:
    from hapscene.surface.texture import triangulate

    force_N, speed_m_s = map(np.ravel, np.meshgrid(np.linspace(0, 3, 64), np.linspace(0, 0.3, 64)))
    lsf = np.linspace(0, np.pi, 258)[1:-1] + np.random.default_rng(0).uniform(-0.004, 0.004, (MODEL_MAX, 256))
    triangles = triangulate(force_N, speed_m_s)
    texture = Texture(1e4, force_N, speed_m_s, triangles, lsf, np.full(MODEL_MAX, 0.1))
    path = tmp_path / "x.swatch"
    save_swatch(Swatch("x", texture=texture), path)
    assert load_swatch(path).texture == texture
    assert opening_bytes(path) < OPENING_BYTES
