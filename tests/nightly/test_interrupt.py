"""Signals that ask a process to end."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from hapscene.cli import main

pty = pytest.importorskip("pty", reason="this platform has no pseudo-terminals")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")


def test_command_runs_in_another_thread() -> None:
    codes: list[int] = []
    thread = threading.Thread(target=lambda: codes.append(main(["lab", "effects"])))
    thread.start()
    thread.join()
    assert codes == [0]


def test_closed_terminal_does_not_prevent_cleanup(tmp_path: Path) -> None:
    """The terminal of the process is closed; the process still prints and cleans up before it ends."""
    script = tmp_path / "speaker.py"
    script.write_text(
        "import sys, time\n"
        "from pathlib import Path\n"
        "from hapscene.interrupt import interrupted_by_ends\n"
        "with interrupted_by_ends():\n"
        "    try:\n"
        "        print('ready', flush=True)\n"
        "        time.sleep(60.0)\n"
        "    except KeyboardInterrupt:\n"
        "        print('cleaned up', flush=True)\n"
        f"        Path({str(tmp_path / 'order')!r}).touch()\n"
    )
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(sys.executable, [sys.executable, str(script)])
    said = b""
    while b"ready" not in said:
        said += os.read(terminal, 1000)
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    assert (tmp_path / "order").exists()


def test_terminated_command_leaves_no_unfinished_folder(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "hapscene", "demo", "--out", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        end_s = time.monotonic() + 60.0
        while not list(tmp_path.iterdir()):  # a temporary folder, renamed to the output folder at the end
            assert process.poll() is None and time.monotonic() < end_s
            time.sleep(0.002)
        process.send_signal(signal.SIGTERM)
        assert process.wait(120.0) == 128 + signal.SIGTERM
        assert process.stderr.read() == "hapscene: interrupted; nothing was written\n"
    assert list(tmp_path.iterdir()) == []


SWALLOWER = """
import os, signal, sys
try:
    os.kill(os.getpid(), signal.SIGINT)
    while True:
        pass
except BaseException as error:
    trouble = error  # as trimesh keeps it
TEXT
"""


@pytest.mark.timeout(300, method="thread")  # the test uses SIGALRM
@pytest.mark.parametrize(
    "text", ["while True: pass", "raise ImportError('half of it is missing')", "exec('raise error')"]
)
def test_interrupt_that_an_import_catches_is_raised_again(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "swallower.py").write_text(SWALLOWER.replace("TEXT", text))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "swallower", raising=False)
    before = signal.getsignal(signal.SIGALRM)
    monkeypatch.setattr("hapscene.scene.mesh_file.load_mesh", lambda *a, **k: __import__("swallower"))
    (tmp_path / "any.glb").touch()
    assert main(["check", str(tmp_path / "any.glb")]) == 130
    assert capsys.readouterr().err == "hapscene: interrupted; nothing was written\n"
    assert signal.getsignal(signal.SIGALRM) == before and signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_ctrl_c_during_start_prints_one_line(tmp_path: Path) -> None:
    """Interrupts at the n-th import, which does not depend on the speed of the machine."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "class Finder:\n"
        "    left, seen = int(os.environ['MOMENT']), False\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        Finder.seen |= name == 'hapscene.cli'\n"
        "        Finder.left -= Finder.seen\n"
        "        if Finder.left == -1: os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
    )
    place = os.pathsep.join((str(tmp_path), *filter(None, (os.environ.get("PYTHONPATH"), str(Path.cwd())))))
    command = [sys.executable, "-m", "hapscene", "check", "none.glb"]
    ends = []
    for moment in (0, 3, 10, 20, 30):
        environment = {**os.environ, "PYTHONPATH": place, "MOMENT": str(moment)}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120.0, cwd=tmp_path)
        ends.append((done.returncode, done.stderr))
    assert ends == [(130, "hapscene: interrupted; nothing was written\n")] * 5


def test_ctrl_c_while_python_ends_has_no_effect(tmp_path: Path) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n"
        "class Last:\n"
        "    def __del__(self, kill=os.kill, own=os.getpid(), kind=signal.SIGINT): kill(own, kind)\n"
        "sys.last_of_all = Last()\n"
    )
    place = os.pathsep.join((str(tmp_path), *filter(None, (os.environ.get("PYTHONPATH"), str(Path.cwd())))))
    command = [sys.executable, "-m", "hapscene", "lab", "effects"]
    done = subprocess.run(
        command, env={**os.environ, "PYTHONPATH": place}, capture_output=True, text=True, timeout=120.0
    )
    assert (done.returncode, done.stderr) == (0, "")
