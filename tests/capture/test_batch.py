"""Batches: every recording is through once, whatever dies on the way."""

import errno
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
import pytest

from hapscene import __version__
from hapscene.capture.batch import Item, Manifest, ManifestEntry, Result, fit_batch, gather, outputs, read_list
from hapscene.capture.batch_job import Job, fit_job
from hapscene.capture.swatch_fit import fit_parts
from hapscene.cli import main
from hapscene.errors import CaptureError
from hapscene.surface.swatch import Swatch
from hapscene.swatches.library import load_swatch
from hapscene.worker_pool import ClusterPool

pytestmark = pytest.mark.nightly

T = TypeVar("T")

LIMIT_S = 120.0
"""Longest that a test waits for another process [s]."""

READING = {"rate_Hz": 1000.0, "units": {"acceleration": "m/s2"}}
FITTING = {"order": 3}
CHOSEN = {"domain": "auto", "interpolation": "lsf"}  # by the command, where nothing is said
WORDS = ["--rate", "1000", "--units", "acceleration=m/s2", "--order", "3"]


def write_recording(path: Path, seed: int) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    path.write_text("acceleration\n" + "\n".join(f"{a:.6f}" for a in rng.standard_normal(1500)))
    return path


def write_recordings(folder: Path, count: int) -> list[Item]:
    return gather([write_recording(folder / f"r{i:02}.csv", i) for i in range(count)])


def statuses(out: Path) -> dict[str, str]:
    rows = json.loads((out / "manifest.json").read_text(encoding="utf-8"))["recordings"]
    return {Path(row["recording"]).name: row["status"] for row in rows}


def check_whole(items: list[Item], out: Path) -> None:
    """A swatch for each, all as a fit here would make them, and nothing else."""
    assert sorted(f.name for f in out.iterdir()) == sorted([*(f"{i.name}.swatch" for i in items), "manifest.json"])
    assert set(statuses(out).values()) == {"ok"}
    for item in items:
        check_swatch(item, out)


def check_swatch(item: Item, out: Path) -> None:
    """The swatch is the one that a fit here makes."""
    made = (out / f"{item.name}.swatch").read_text(encoding="utf-8")
    assert made == fit_job(Job(str(item.path), item.name, None, READING, FITTING, __version__)).swatch


def open_when_read(pipe: Path, going_on: Callable[[], bool]) -> BinaryIO:
    """A named pipe, opened for writing as soon as somebody reads it."""
    end = time.monotonic() + LIMIT_S
    while True:
        try:
            handle = os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)
        except OSError as error:
            assert error.errno == errno.ENXIO and going_on() and time.monotonic() < end, "nobody reads it"
            time.sleep(0.005)
        else:
            os.set_blocking(handle, True)
            return os.fdopen(handle, "wb")


class Once:
    """Notes what is through, and does something once so many are."""

    def __init__(self, count: int = -1, then: Callable[[], object] = lambda: None) -> None:
        self.through: Counter[str] = Counter()
        self._count, self._then = count, then

    def __call__(self, result: Result, entry: ManifestEntry) -> None:
        self.through[Path(entry.recording).name] += 1
        if self.through.total() == self._count:
            self._then()


def test_a_batch_from_the_command_line_is_gone_on_with(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Broken ones fail by name; a second run does only what is new, changed, or failed before."""
    folder, out = tmp_path / "in", tmp_path / "out"
    write_recordings(folder, 4)
    (folder / "r01.csv").write_text("acceleration\n1\nx\n")
    words = ["capture", "batch", str(folder), "--out", str(out), "--jobs", "2", *WORDS]
    assert main(words) == 1
    said = capsys.readouterr().out
    assert "3 fitted, 0 done before, 1 failed" in said and f"{folder / 'r01.csv'}: not a table of numbers" in said
    assert statuses(out) == {"r00.csv": "ok", "r01.csv": "failed", "r02.csv": "ok", "r03.csv": "ok"}
    before = {f.name: f.stat().st_mtime_ns for f in out.glob("*.swatch")}
    write_recording(folder / "r01.csv", 11)
    write_recording(folder / "r02.csv", 12)
    (out / "r03.swatch").unlink()
    assert main(words) == 0
    assert "3 fitted, 1 done before, 0 failed" in capsys.readouterr().out
    after = {f.name: f.stat().st_mtime_ns for f in out.glob("*.swatch")}
    assert after["r00.swatch"] == before["r00.swatch"] and after["r02.swatch"] > before["r02.swatch"]
    check_whole(gather([folder]), out)
    assert load_swatch(out / "r03.swatch").name == "r03"


class Here(ClusterPool):
    """A pool that is this process."""

    shares_files = True

    def __init__(self, jobs: int) -> None:
        """Nothing is connected."""

    def room(self) -> int:
        return 1

    def submit(self, function: Callable[..., T], *arguments: Any) -> "Future[T]":
        future: Future[T] = Future()
        future.set_result(function(*arguments))
        return future

    def close(self, at_once: bool) -> None:
        """Nothing is held."""


def test_a_fit_that_fails_by_a_fault_of_ours_is_a_line_and_the_others_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fit(parts: object, name: str, **given: object) -> Swatch:
        if name == "r00":
            raise UnboundLocalError("cannot access\nlocal variable")
        return fit_parts(parts, name, **given)  # type: ignore[arg-type]

    write_recordings(tmp_path / "in", 2)
    monkeypatch.setattr("hapscene.capture.batch.ProcessPool", Here)
    monkeypatch.setattr("hapscene.capture.swatch_fit.fit_parts", fit)
    assert main(["capture", "batch", str(tmp_path / "in"), "--out", str(tmp_path / "out"), *WORDS]) == 1
    said = "".join(capsys.readouterr())
    (line,) = (line for line in said.splitlines() if "UnboundLocalError" in line)
    assert f"{tmp_path / 'in' / 'r00.csv'}: cannot be fitted, by a fault of ours or a damaged file (Unb" in line
    assert "cannot access local variable" in line and "Traceback" not in said and "1 fitted" in said


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
def test_a_recording_that_kills_every_process_is_given_up_and_the_others_go_on(tmp_path: Path) -> None:
    """The process that reads it is known to be in it: the recording is a pipe, and opening it is noticed."""
    items = write_recordings(tmp_path / "in", 3)
    os.mkfifo(tmp_path / "in" / "deadly.csv")
    items.insert(1, Item(tmp_path / "in" / "deadly.csv", "deadly"))
    deaths = []
    through = threading.Event()

    def strike() -> None:
        for _ in range(3):  # once among others, twice alone
            with open_when_read(tmp_path / "in" / "deadly.csv", lambda: not through.is_set()):
                children = [c for c in multiprocessing.active_children() if c.is_alive()]
                for child in children:
                    child.kill()
                for child in children:
                    child.join(LIMIT_S)
                deaths.append(len(children))

    striker = threading.Thread(target=strike, daemon=True)
    striker.start()
    once = Once()
    result = fit_batch(items, tmp_path / "out", READING, FITTING, jobs=2, after=once)
    through.set()
    striker.join(120.0)
    assert [e.recording for e in result.failed] == [str(tmp_path / "in" / "deadly.csv")] and len(deaths) == 3
    assert "died, again" in result.failed[0].reason and len(result.fitted) == 3
    assert set(once.through.values()) == {1}
    for item in items[0], items[2], items[3]:
        check_swatch(item, tmp_path / "out")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
def test_killed_and_interrupted_batches_are_gone_on_with(tmp_path: Path) -> None:
    """SIGKILL to the process that runs the batch, then Ctrl-C to the next one, then to the end; its children end too.

    A recording that is a pipe holds the batch at a known place.
    """
    items = write_recordings(tmp_path / "in", 12)
    out = tmp_path / "out"
    (tmp_path / "list.csv").write_text("\n".join(["recording", *(str(i.path) for i in items)]))  # a pipe may be in it
    words = [sys.executable, "-m", "hapscene.cli", "capture", "batch", "--list", str(tmp_path / "list.csv")]
    words += ["--out", str(out), "--jobs", "1", *WORDS]

    def run_until(place: int, kind: int) -> tuple[int, str]:
        """Runs until that recording is held, sends the signal, lets it go; gives the exit code and stderr."""
        content = items[place].path.read_bytes()
        items[place].path.unlink()
        os.mkfifo(items[place].path)
        child = subprocess.Popen(words, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        with open_when_read(items[place].path, lambda: child.poll() is None) as pipe:
            end = time.monotonic() + LIMIT_S
            while len(list(out.glob("*.swatch"))) < place:
                assert child.poll() is None and time.monotonic() < end
                time.sleep(0.005)
            child.send_signal(kind)
            if kind == signal.SIGKILL:
                child.wait(LIMIT_S)
            else:
                pipe.write(content)
        _, told = child.communicate(timeout=LIMIT_S)  # ends when the children, too, have closed their end
        items[place].path.unlink()
        items[place].path.write_bytes(content)
        return child.returncode, told

    assert run_until(3, signal.SIGKILL)[0] == -signal.SIGKILL
    assert len(list(out.glob("*.swatch"))) == 3 and set(statuses(out)) == {i.path.name for i in items}
    code, told = run_until(6, signal.SIGINT)
    assert code == 130 and told.endswith("recordings left; run the same again to go on\n") and told.count("\n") == 1
    done = Counter(statuses(out).values())
    assert done["failed"] == 0 and 7 <= done["ok"] == len(list(out.glob("*.swatch"))) < 12
    last = fit_batch(items, out, READING | {"columns": {}}, FITTING | CHOSEN, jobs=2)
    assert len(last.skipped) == done["ok"] and len(last.fitted) == 12 - done["ok"]
    check_whole(items, out)


def test_a_cluster_that_loses_a_worker_loses_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Workers of a real local cluster, in processes of their own; one is killed with SIGKILL while it fits. Then
    `capture fit` goes on with it on the same cluster: only a new recording is fitted."""
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    items = write_recordings(tmp_path / "in", 10)
    (tmp_path / "in" / "bad.csv").write_text("acceleration\n")
    items.append(Item(tmp_path / "in" / "bad.csv", "bad"))
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        with distributed.Client(cluster, set_as_default=False) as client:
            pid = next(iter(client.run(os.getpid).values()))
        once = Once(5, lambda: os.kill(pid, signal.SIGKILL))
        reading, fitting, address = READING | {"columns": {}}, FITTING | CHOSEN, cluster.scheduler_address
        result = fit_batch(items, tmp_path / "out", reading, fitting, scheduler=address, after=once)
        assert len(result.fitted) == 10 and set(once.through.values()) == {1}
        assert [Path(e.recording).name for e in result.failed] == ["bad.csv"]
        new = write_recording(tmp_path / "in" / "new.csv", 99)
        words = ["capture", "fit", str(tmp_path / "in"), "-o", str(tmp_path / "out"), "--scheduler", address]
        assert main([*words, *WORDS]) == 1
        assert "1 fitted, 10 done before, 1 failed" in capsys.readouterr().out
    for item in [*items[:10], Item(new, "new")]:
        check_swatch(item, tmp_path / "out")


def test_a_cluster_is_given_two_jobs_for_each_of_its_threads() -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    given = {"n_workers": 1, "threads_per_worker": 5, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(silence_logs=50, **given) as cluster:
        pool = ClusterPool(cluster.scheduler_address, CaptureError)
        assert pool.room() == 10
        pool.close(at_once=True)


def test_no_scheduler_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    items = write_recordings(tmp_path / "in", 1)
    monkeypatch.setattr("hapscene.worker_pool.CONNECT_S", 0.3)
    if pytest.importorskip("distributed"):
        with pytest.raises(CaptureError, match=r"tcp://127\.0\.0\.1:9: no Dask scheduler reached"):
            fit_batch(items, tmp_path / "out", scheduler="tcp://127.0.0.1:9")
        monkeypatch.setattr("distributed.Client", lambda *_, **__: pytest.fail("a client that is never made hangs"))
        for address in ("garbage", "foo://127.0.0.1:9"):
            with pytest.raises(CaptureError, match=f"{address}: no Dask scheduler reached"):
                fit_batch(items, tmp_path / "out", scheduler=address)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(CaptureError, match=r"pip install 'hapscene\[cluster\]'"):
        fit_batch(items, tmp_path / "out", scheduler="tcp://127.0.0.1:9")


@pytest.mark.skipif(sys.platform == "win32", reason="a pipe has no path there")
def test_a_pipe_that_gives_more_than_is_read_is_refused_and_not_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene.capture.io.formats.BYTES_MAX", 8)
    there, here = os.pipe()
    os.write(here, b"1,2\n3,4\n5,6\n")
    os.close(here)
    try:
        outcome = fit_job(Job(f"/dev/fd/{there}", "pipe", None, {}, {}, __version__))
    finally:
        os.close(there)
    assert outcome.swatch is None
    assert outcome.reason.startswith("/dev/fd/") and "larger than" in outcome.reason


def test_gather(tmp_path: Path) -> None:
    for name in ("b.csv", "a.wav", "sub/c.hsrec", "notes.md", ".hidden/d.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    items = gather([tmp_path, tmp_path / "b.csv"])
    assert [i.path.relative_to(tmp_path).as_posix() for i in items] == ["a.wav", "b.csv", "sub/c.hsrec"]
    assert outputs(items) == ["a.swatch", "b.swatch", "sub/c.swatch"]
    (tmp_path / "empty").mkdir()
    with pytest.raises(CaptureError, match="without recordings"):
        gather([tmp_path / "empty"])
    with pytest.raises(CaptureError, match=r"none\.csv: no such file"):
        gather([tmp_path / "none.csv"])


def test_outputs_never_collide(tmp_path: Path) -> None:
    items = [Item(tmp_path / p, "x") for p in ("a/x.csv", "a/X.wav", "a/y.csv", "b/x.csv")]
    assert outputs(items) == ["a/x.csv.swatch", "a/X.wav.swatch", "a/y.swatch", "b/x.swatch"]
    manifest = Manifest(tmp_path)
    manifest.add(tmp_path / "one" / "x.csv", "x.swatch")
    manifest.add(tmp_path / "two" / "x.csv", "x.swatch")
    with pytest.raises(CaptureError, match="take another folder"):
        manifest.check_outputs()


def test_read_list(tmp_path: Path) -> None:
    file = tmp_path / "list.csv"
    file.write_text('recording,name,rate,units,columns\nin/a.csv,oak,5000,"acceleration=g,force=N",\nb.wav,,,,\n')
    first, second = read_list(file)
    assert first == Item(
        tmp_path / "in" / "a.csv", "oak", {"rate_Hz": 5000.0, "units": {"acceleration": "g", "force": "N"}}
    )
    assert second == Item(tmp_path / "b.wav", "b")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", '"recording" among them'),
        ("file\na.csv\n", '"recording" among them'),
        ("recording,rat\na.csv,1\n", "no column 'rat'; there are"),
        ("recording\n", "without recordings"),
        ("recording,rate\na.csv,fast\n", "line 2: rate is a number of Hz, not 'fast'"),
        ("recording,units\na.csv,g\n", "line 2: units holds pairs"),
        ("recording\na.csv,b\n", "line 2: a recording and one cell a column"),
    ],
)
def test_a_list_that_cannot_be_read_is_told(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "list.csv").write_text(text)
    with pytest.raises(CaptureError, match=f"list.csv: .*{message}"):
        read_list(tmp_path / "list.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not the manifest of a batch"),
        ("[]", "not the manifest of a batch"),
        ('{"format": "hapscene batch", "version": 2}', "version 2"),
        ('{"format": "hapscene batch", "version": 1}', "damaged"),
        ('{"format": "hapscene batch", "version": 1, "recordings": [{"recording": 1}]}', "damaged"),
    ],
)
def test_a_manifest_that_cannot_be_read_is_told(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "manifest.json").write_text(text)
    with pytest.raises(CaptureError, match=f"manifest.json: .*{message}"):
        Manifest(tmp_path)


def test_no_recordings_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["capture", "batch", "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == "hapscene: no recordings: name files or folders, or --list files.csv\n"


def test_bridged_samples_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stream = np.random.default_rng(0).standard_normal(1500)
    stream[7] = np.nan
    np.savez(tmp_path / "oak.npz", acceleration=stream)
    words = ["capture", "batch", str(tmp_path / "oak.npz"), "--out", str(tmp_path / "out"), "--jobs", "1", *WORDS]
    assert main([*words, "--interpolation", "direct"]) == 0
    assert "oak.npz: missing samples bridged by straight lines: 1 of acceleration" in capsys.readouterr().out
    texture = load_swatch(tmp_path / "out" / "oak.swatch").texture
    assert texture is not None and texture.interpolation == "direct"
    assert main(words) == 0
    assert "1 fitted, 0 done before" in capsys.readouterr().out


def test_a_manifest_holds_any_name_of_a_file(tmp_path: Path) -> None:
    manifest = Manifest(tmp_path)
    manifest.add(tmp_path / "oak\udcff.csv", "oak.swatch")
    manifest.save()
    assert list(Manifest(tmp_path).entries) == list(manifest.entries)
