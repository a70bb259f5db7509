"""The command line interface as a process."""

import subprocess
import sys
from pathlib import Path

import pytest

from hapscene import __version__
from tests.cli.test_main import folder

__all__ = ["folder"]  # fixtures


@pytest.mark.parametrize("command", ["touch", "view", "paint", "check", "convert"])
def test_a_missing_unit_is_an_error_before_slow_imports(folder: Path, command: str) -> None:
    code = (
        f"import sys\nfrom hapscene.cli import main\nassert main(['{command}', 'cube.stl']) == 2\n"
        "assert not {'numpy', 'numba', 'scipy', 'trimesh', 'matplotlib'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith("hapscene: cube.stl: ") and "--unit mm" in done.stderr


def test_help_and_version_are_fast() -> None:
    code = (
        "import sys\nfrom hapscene.cli import main\n"
        "assert main(['touch', '--help']) == 0\n"
        "assert not {'numpy', 'numba', 'scipy', 'trimesh', 'matplotlib'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "examples:\n  hapscene touch" in done.stdout


CODE = "import sys; from hapscene.cli import main; sys.exit(main(sys.argv[1:]))"


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")
@pytest.mark.parametrize(
    ("arguments", "shell", "code", "output"),
    [
        ("swatch list", ">&-", 0, ""),
        ("--version", "<&- 2>&-", 0, f"hapscene {__version__}\n"),
        ("check none.stl", "2>/dev/full", 2, ""),
        ("tuch", ">&- 2>&- <&-", 2, ""),
        ("--version", ">/dev/full", 2, "hapscene: standard output: No space left on device\n"),
        ("check cube.stl --unit mm --fix mended.ply", ">&-", 0, ""),
    ],
)
def test_streams_that_are_closed_or_full(folder: Path, arguments: str, shell: str, code: int, output: str) -> None:
    if "/dev/full" in shell and not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    command = f'exec "{sys.executable}" -c "{CODE}" {arguments} {shell}'
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, encoding="utf-8", check=False)
    assert done.returncode == code, done.stderr
    assert done.stdout + done.stderr == output
    if "--fix" in arguments:  # the file must not get the descriptor of the closed standard output
        assert (folder / "mended.ply").read_bytes()[:4] == b"ply\n"


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of POSIX")
@pytest.mark.parametrize("words", ["swatch list", "--help"])
def test_a_closed_pipe_prints_nothing(words: str) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", CODE, *words.split()], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b"" and process.wait() == 1
