"""The process that draws goes with the one that started it, however that ends, and leaves nothing."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from hapscene.view.apart import apart, job_folder

DRAWER = """
import sys, time
from pathlib import Path
from hapscene.view.apart import go_with_the_other
go_with_the_other(Path(sys.argv[1]))
print("drawing", flush=True)
time.sleep(600.0)
"""

APPLICATION = """
import os
from hapscene.interrupt import interrupted_by_ends
from hapscene.view.apart import apart, job_folder
with interrupted_by_ends(), job_folder() as job, apart("drawer", job, os.environ) as drawer:
    (job / "stage.npz").touch()
    drawer.process.wait()
"""

FAILING = "import sys\nprint('GL is at fault', file=sys.stderr)\nsys.exit(3)\n"


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Where the drawer is found, and temporary folders are made."""
    (tmp_path / "drawer.py").write_text(DRAWER)
    (tmp_path / "temporary").mkdir()
    return os.environ | {"PYTHONPATH": str(tmp_path), "TMPDIR": str(tmp_path / "temporary")}


@pytest.mark.skipif(sys.platform == "win32", reason="no process can send these signals there")
@pytest.mark.parametrize("kind", ["SIGINT", "SIGTERM", "SIGHUP", "SIGKILL"])
def test_it_goes_with_the_one_that_started_it(tmp_path: Path, environment: dict[str, str], kind: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", APPLICATION],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as application:
        assert application.stdout is not None
        assert application.stdout.readline() == "drawing\n"
        assert len(list((tmp_path / "temporary").glob("hapscene-*/stage.npz"))) == 1
        application.send_signal(getattr(signal, kind))
        assert application.communicate(timeout=60.0) == ("", None)  # the pipe ends with the last process that has it
    assert list((tmp_path / "temporary").iterdir()) == []


def test_why_it_failed_is_its_last_line(tmp_path: Path, environment: dict[str, str]) -> None:
    (tmp_path / "drawer.py").write_text(FAILING)
    with job_folder() as job, apart("drawer", job, environment) as drawer:
        assert drawer.reason() == "GL is at fault"
        assert drawer.process.returncode == 3
    assert not job.exists()


def test_nothing_but_a_job_of_ours_is_removed(tmp_path: Path, environment: dict[str, str]) -> None:
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / "thesis.txt").touch()
    command = [sys.executable, "-m", "drawer", str(precious)]
    assert subprocess.run(command, env=environment, stdin=subprocess.DEVNULL, check=False, timeout=60.0).returncode == 1
    assert (precious / "thesis.txt").exists()
