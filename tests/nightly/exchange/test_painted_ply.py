"""Speed of the check of PLY headers."""

import time
from pathlib import Path

import pytest

from hapscene.errors import SceneError
from hapscene.exchange import export_scene, import_scene
from hapscene.scene.scene import Scene

pytestmark = pytest.mark.filterwarnings("ignore::hapscene.exchange.swatch_payload.ExchangeWarning")


def test_header_with_many_swatches(scene: Scene, tmp_path: Path) -> None:
    file = export_scene(scene, tmp_path / "desk.ply")[0]
    line = next(line for line in file.read_bytes().split(b"\n") if line.startswith(b"comment hapscene swatch 1 "))
    file.write_bytes(file.read_bytes().replace(line, b"\n".join([line] * 40_000)))
    start_s = time.process_time()
    with pytest.raises(SceneError, match="too many"):
        import_scene(file)
    assert time.process_time() - start_s < 2.0
