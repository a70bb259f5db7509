"""Tasks in this process, in others and on a cluster: the same results, and nothing done twice."""

import os
import signal
import statistics
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from hapscene.errors import HapsceneError
from hapscene.parallel import Json, Task, TaskError, begin_process, iterate_results, run_tasks


def means(count: int) -> list[Task]:
    return [Task(f"mean {k}", statistics.fmean, {"data": [k, k + 2]}) for k in range(count)]


WANTED = {f"mean {k}": k + 1.0 for k in range(5)}


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    journal, done = tmp_path / "tasks.jsonl", list[tuple[int, int, str]]()
    assert run_tasks(means(3), journal=journal, jobs=1) == {k: WANTED[k] for k in list(WANTED)[:3]}
    whole = journal.read_text()
    journal.write_text(whole[:-5])  # killed while it wrote the last line
    tasks = means(5)
    tasks[0] = Task("mean 0", statistics.fmean, {"data": [7.0]})  # another question with the same key
    found = run_tasks(tasks, journal=journal, jobs=1, after=lambda *given: done.append(given))
    assert found == WANTED | {"mean 0": 7.0}
    assert done == [(2, 5, "mean 0"), (3, 5, "mean 2"), (4, 5, "mean 3"), (5, 5, "mean 4")]
    done.clear()
    assert run_tasks(tasks, journal=journal, jobs=1, after=lambda *given: done.append(given)) == found
    assert all(journal.read_text().splitlines())
    assert done == []


def test_a_task_that_fails_is_named() -> None:
    tasks = [*means(2), Task("bad", statistics.fmean, {"data": []})]
    with pytest.raises(HapsceneError, match="bad: StatisticsError"):
        run_tasks(tasks, jobs=1)
    results = {task.key: result for task, result in iterate_results(tasks, jobs=1)}
    assert isinstance(results.pop("bad"), TaskError) and results == {k: WANTED[k] for k in results}


def test_keys_are_unique() -> None:
    with pytest.raises(HapsceneError, match="mean 1"):
        run_tasks([*means(2), *means(2)[1:]], jobs=1)


def test_tasks_lost_with_a_process_are_run_again_each_in_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[tuple[int, object]] = []

    def parallel(tasks: Iterable[Task], *, n_jobs: int, **backend: object) -> Iterator[tuple[Task, Json]]:
        assert backend == {"backend": "loky", "initializer": begin_process, "inner_max_num_threads": 1}
        tasks = list(tasks)
        ran.append((len(tasks), n_jobs))
        for task in tasks:
            if task.key == "bad":
                raise BrokenProcessPool
            yield task, task.function(**task.arguments)

    monkeypatch.setattr("hapscene.parallel._parallel", parallel)
    tasks = [*means(2), Task("bad", os._exit, {"status": 1}), *means(7)[2:]]
    results = {task.key: result for task, result in iterate_results(tasks, jobs=2)}
    assert isinstance(results.pop("bad"), TaskError) and results == {f"mean {k}": k + 1.0 for k in range(7)}
    assert ran == [(8, 2), *[(1, 2)] * 4, (2, 2)]
    for count, jobs in ((3, 3), (None, 1)):
        monkeypatch.setattr(os, "cpu_count", lambda count=count: count)
        assert len(list(iterate_results(means(5)))) == 5 and ran[-1] == (5, jobs)


def test_a_worker_leaves_ctrl_c_to_its_parent_and_ends_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    did: list[object] = []
    parents = [7, 7, 1]

    class Thread:
        def __init__(self, target: Any, daemon: bool) -> None:
            did.append(daemon)
            self.start = target

    monkeypatch.setattr("hapscene.parallel.signal.signal", lambda *given: did.append(given))
    monkeypatch.setattr("hapscene.parallel.threading", SimpleNamespace(Thread=Thread))
    monkeypatch.setattr("hapscene.parallel.time", SimpleNamespace(sleep=did.append))
    monkeypatch.setattr("os._exit", lambda code: did.append(f"exit {code}"))
    monkeypatch.setattr("os.getppid", lambda: parents.pop(0))
    ignored = (signal.SIGINT, signal.SIG_IGN)
    for parent, then in ((None, []), (SimpleNamespace(pid=7), [True, 1.0, 1.0, "exit 1"])):
        monkeypatch.setattr("multiprocessing.parent_process", lambda parent=parent: parent)
        begin_process()
        assert did == [ignored, *then]
        did.clear()


@pytest.mark.nightly
def test_processes_give_the_same(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    found = run_tasks([*means(5), Task("pid", os.getpid, {})], journal=tmp_path / "tasks.jsonl", jobs=2)
    assert {key: found[key] for key in WANTED} == WANTED
    assert found["pid"] != os.getpid() and capfd.readouterr().err == ""


@pytest.mark.nightly
def test_a_task_that_ends_its_process_is_found_and_all_others_are_done() -> None:
    tasks = [*means(2), Task("bad", os._exit, {"status": 1}), *means(5)[2:]]
    results = {task.key: result for task, result in iterate_results(tasks, jobs=2)}
    assert isinstance(results.pop("bad"), TaskError) and results == WANTED


@pytest.mark.nightly
def test_a_cluster_gives_the_same() -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    given = {"n_workers": 1, "threads_per_worker": 2, "processes": False, "dashboard_address": None}
    with distributed.LocalCluster(silence_logs=50, **given) as cluster:
        assert run_tasks(means(5), scheduler=cluster.scheduler_address) == WANTED


@pytest.mark.nightly
def test_a_cluster_that_loses_its_workers_loses_nothing() -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    given = {"n_workers": 2, "threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with distributed.LocalCluster(silence_logs=50, **given) as cluster:
        with distributed.Client(cluster, set_as_default=False) as client:
            pid = next(iter(client.run(os.getpid).values()))
        kill = Task("kill", os.kill, {"pid": pid, "sig": 9})  # of a worker that may be another one's
        results = {
            task.key: result for task, result in iterate_results([*means(5), kill], None, cluster.scheduler_address)
        }
    assert {key: results[key] for key in WANTED} == WANTED


def test_a_cluster_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    monkeypatch.setattr("hapscene.parallel.CONNECT_S", 0.3)
    for address in ("tcp://127.0.0.1:9", "garbage", "foo://127.0.0.1:9"):
        with pytest.raises(HapsceneError, match=address):
            run_tasks(means(2), scheduler=address)
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(HapsceneError, match="distributed"):
        run_tasks(means(2), scheduler="tcp://127.0.0.1:9")
