"""The disk cache of compiled code without a writable folder."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hapscene.compiled.native import INTERPRETED

pytestmark = pytest.mark.skipif(INTERPRETED, reason="nothing is compiled: NUMBA_DISABLE_JIT")


SOURCE = "def twice(x):\n    return 2.0 * x\n"


POSIX = pytest.mark.skipif(sys.platform == "win32", reason="no such permissions there")


@POSIX
def test_without_a_cache_folder_every_start_compiles(tmp_path: Path) -> None:
    """Neither the folder of the package nor that of the user is writable."""
    (tmp_path / "source.py").write_text(
        f"from hapscene.compiled.native import native\n@native\n{SOURCE}print(twice(21.0))"
    )
    tmp_path.chmod(0o555)
    words = [sys.executable, "-B", str(tmp_path / "source.py")]
    if os.geteuid() == 0:  # root can write anywhere
        if shutil.which("setpriv") is None:
            pytest.skip("root can write anywhere, and setpriv is not installed")
        words = ["setpriv", "--bounding-set=-dac_override,-dac_read_search", *words]
    clean = {name: value for name, value in os.environ.items() if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    try:
        done = subprocess.run(words, env=clean | {"HOME": str(tmp_path)}, capture_output=True, text=True, check=False)
    finally:
        tmp_path.chmod(0o755)
    assert (done.returncode, done.stdout) == (0, "42.0\n"), done.stderr
    assert "RuntimeWarning" in done.stderr and "NUMBA_CACHE_DIR" in done.stderr
