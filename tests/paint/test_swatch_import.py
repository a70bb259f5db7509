"""Files that are no hapscene's become swatches of the library, in a process beside; or it is said why not."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import HapsceneError
from hapscene.paint.swatch_import import Unsaid, free_name, import_files
from hapscene.surface.library import add, load_swatch, own_entries
from hapscene.surface.swatch import Swatch


def brought(*files: Path, **said: str) -> list[str]:
    return asyncio.run(import_files(files, **said))


def test_models_of_the_penn_toolkit_with_their_taps(library: Path, shared: Path) -> None:
    folder = shared / "data" / "hatt_format"
    (name,) = brought(folder / "Models_example.xml", folder / "Taps_example.xml")
    swatch = load_swatch(name)
    assert swatch.texture is not None and swatch.taps is not None
    assert brought(folder / "Models_example.xml") == [f"{name} 2"]
    assert [entry.name for entry in own_entries()] == [name, f"{name} 2"]


def test_a_recording_is_asked_for_what_it_does_not_say(library: Path, tmp_path: Path) -> None:
    np.savetxt(tmp_path / "-oak.csv", np.zeros((50, 2)), delimiter=",", header="accel,speed", comments="")
    with pytest.raises(Unsaid, match=r'^-oak.csv: no column "acceleration"; there are: accel, speed$') as refused:
        brought(tmp_path / "-oak.csv")
    assert refused.value.guess == "acceleration=accel"
    assert not own_entries()


def test_what_is_no_recording_is_one_sentence(library: Path, tmp_path: Path) -> None:
    for name in ("broken.wav", "broken.xml", "broken.swatch", "broken.npz"):
        (tmp_path / name).write_bytes(b"\x00\x01 this is nothing")
        with pytest.raises(HapsceneError) as refused:
            brought(tmp_path / name)
        said = str(refused.value)
        assert name in said and "\n" not in said and "Traceback" not in said and not isinstance(refused.value, Unsaid)
    assert not own_entries()


def test_a_name_does_not_grow_numbers(library: Path) -> None:
    assert free_name("oak") == "oak"
    for name in ("oak", "oak 2"):
        add(Swatch(name))
    assert free_name("oak") == free_name("oak 2") == "oak 3"
    assert free_name("wood") == "wood 2" and free_name("glass") == "glass 2"
