"""Sweeps: done side by side or on a cluster, alike; gone on with, and nothing done twice."""

import os
from pathlib import Path

import pytest

from hapscene.errors import HapsceneError
from hapscene.parameter_sweep import Piece, sweep


def means(count: int) -> list[Piece]:
    return [Piece(f"mean {k}", "statistics:fmean", {"data": [k, k + 2]}) for k in range(count)]


WANTED = {f"mean {k}": k + 1.0 for k in range(5)}


def test_what_is_done_is_not_done_again(tmp_path: Path) -> None:
    journal, done = tmp_path / "sweep.jsonl", list[str]()
    assert sweep(means(3), journal=journal, jobs=1) == {k: WANTED[k] for k in list(WANTED)[:3]}
    whole = journal.read_text()
    journal.write_text(whole[:-5])  # killed while it wrote the last line
    pieces = means(5)
    pieces[0] = Piece("mean 0", "statistics:fmean", {"data": [7.0]})  # another question by the same name
    found = sweep(pieces, journal=journal, jobs=1, after=lambda n, of, key: done.append(key))
    assert found == WANTED | {"mean 0": 7.0}
    assert done == ["mean 0", "mean 2", "mean 3", "mean 4"]
    done.clear()
    assert sweep(pieces, journal=journal, jobs=1, after=lambda n, of, key: done.append(key)) == found
    assert done == []


def test_processes_give_the_same_and_what_is_timed_is_done_here(tmp_path: Path) -> None:
    pids = [Piece(f"pid {k}", "os:getpid", {}, alone=k == 0) for k in range(3)]
    found = sweep([*means(5), *pids], journal=tmp_path / "sweep.jsonl", jobs=2)
    assert {key: found[key] for key in WANTED} == WANTED
    assert found["pid 0"] == os.getpid() != found["pid 1"]


def test_a_piece_that_ends_its_process_is_named_and_the_others_are_kept(tmp_path: Path) -> None:
    journal = tmp_path / "sweep.jsonl"
    with pytest.raises(HapsceneError, match="bad"):
        sweep([*means(5), Piece("bad", "os:_exit", {"status": 1})], journal=journal, jobs=2)
    done = list[str]()
    sweep(means(5), journal=journal, jobs=1, after=lambda n, of, key: done.append(key))
    assert len(done) < 5


def test_a_cluster_gives_the_same() -> None:
    distributed = pytest.importorskip("distributed", reason="the extra `cluster` is not installed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None, silence_logs=50
    ) as cluster:
        assert sweep(means(5), scheduler=cluster.scheduler_address) == WANTED


def test_two_pieces_of_one_name_are_refused() -> None:
    with pytest.raises(HapsceneError, match="mean 1"):
        sweep([*means(2), *means(2)[1:]], jobs=1)
