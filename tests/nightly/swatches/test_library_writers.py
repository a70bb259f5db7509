"""The swatch library under several processes that write at the same time."""

import subprocess
import sys
from pathlib import Path

from hapscene.swatches.library import load_swatch, own_entries

WRITER = """
import sys
from pathlib import Path
from hapscene.surface.swatch import Swatch
from hapscene.swatches.library import add, edit
print("ready", flush=True)
sys.stdin.readline()  # all begin together
for i in range(20):
    name = f"oak {sys.argv[2]} {i}"
    add(Swatch(name), Path(sys.argv[1]))
    edit(name, Path(sys.argv[1]), new_name=name + " tagged", tags=["tagged"])
"""


def test_no_entry_of_several_processes_is_lost(tmp_path: Path) -> None:
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    writers = [subprocess.Popen([*command, str(i)], **streams) for i in range(3)]
    try:
        for writer in writers:
            assert writer.stdout.readline() == "ready\n"
        for writer in writers:
            writer.stdin.write("\n")
            writer.stdin.flush()
        assert [writer.wait(120.0) for writer in writers] == [0, 0, 0]
    finally:
        for writer in writers:
            writer.kill()
            writer.communicate()
    entries = own_entries(tmp_path)
    assert {entry.name for entry in entries} == {f"oak {j} {i} tagged" for j in range(3) for i in range(20)}
    assert all(entry.tags == ("tagged",) for entry in entries)
    assert {file.name for file in tmp_path.glob("*.swatch")} == {entry.file for entry in entries}
    assert load_swatch(tmp_path / entries[0].file).name == entries[0].name
