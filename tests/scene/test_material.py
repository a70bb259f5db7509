"""Images of strangers for the look of a swatch."""

from pathlib import Path

import pytest
from PIL import Image

from hapscene.errors import SceneError
from hapscene.scene.material import read_picture


def test_an_invalid_or_too_large_image_is_refused(tmp_path: Path) -> None:
    Image.new("L", (3, 2), 7).save(tmp_path / "small.png")
    assert read_picture(tmp_path / "small.png").tolist() == [[[7, 7, 7, 255]] * 3] * 2
    (tmp_path / "damaged.png").write_bytes(b"\x89PNG\r\n\x1a\n but no more")
    Image.new("L", (5000, 5000)).save(tmp_path / "large.png")
    for name in ("damaged.png", "large.png"):
        with pytest.raises(SceneError, match=name):
            read_picture(tmp_path / name)
