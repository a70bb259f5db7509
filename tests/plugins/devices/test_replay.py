"""A recording as a device: its places, tick by tick."""

from pathlib import Path

import numpy as np
import pytest

from hapscene.errors import DeviceError
from hapscene.render.recording import Recording
from hapscene_plugins.devices.replay import DRIVER


def recording(t_s: np.ndarray, p_WT_m: np.ndarray) -> Recording:
    n = len(t_s)
    numbers = {name: np.zeros(n) for name in ("depth_m", "slip_m_s", "normal_force_N")}
    vectors = {name: np.zeros((n, 3)) for name in ("p_WP_m", "nhat_W", "f_W_N")}
    indices = {name: np.full(n, -1, np.int32) for name in ("body", "face", "swatch")}
    times = {name: np.zeros(n, np.int64) for name in ("tick_ns", "contact_ns")}
    return Recording(
        t_s=t_s, p_WT_m=p_WT_m, touching=np.zeros(n, bool), flags=np.zeros(n, np.uint32), a_m_s2=np.zeros((n, 10)),
        a_rate_Hz=1e4, body_names=(), swatch_names=(), seed=0, effects=(), **numbers, **vectors, **indices, **times,
    )  # fmt: skip


def played(count: int, **options: str) -> np.ndarray:
    with DRIVER.open(**DRIVER.read_options(options)) as device:
        rows = []
        for _ in range(count):
            device.read()
            device.state.f_D_N = 1.0
            device.write()
            rows.append(device.state.p_DT_m[0].copy())
        assert device.state.count[0] == count and device.state.ready[0] == 1
    return np.array(rows)


P = np.array([(0.1, 0.2, 0.3), (0.1, 0.2, 0.29), (0.11, 0.2, 0.28), (0.12, 0.2, 0.28)])


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_positions_are_replayed_tick_by_tick_and_stay_at_the_end(suffix: str, tmp_path: Path) -> None:
    file = tmp_path / f"touch.{suffix}"
    if suffix == "npz":
        recording(np.arange(4) * 1e-3, P).save(file)
    else:
        file.write_text("t,x,y,z\n" + "".join(f"{i / 1000},{x},{y},{z}\n" for i, (x, y, z) in enumerate(P)))
    np.testing.assert_array_equal(played(6, file=str(file), origin="world"), P[[0, 1, 2, 3, 3, 3]])
    np.testing.assert_array_equal(played(4, file=str(file)), P - P[0])
    np.testing.assert_array_equal(played(8, file=str(file), origin="world", again="yes"), P[[0, 1, 2, 3, 2, 1, 0, 1]])


def test_a_recording_of_another_rate_is_resampled(tmp_path: Path) -> None:
    recording(np.arange(3) * 2e-3, P[:3]).save(tmp_path / "slow.npz")
    p = played(5, file=str(tmp_path / "slow.npz"), origin="world")
    np.testing.assert_allclose(p, (P[0], (P[0] + P[1]) / 2, P[1], (P[1] + P[2]) / 2, P[2]), atol=1e-15)


def test_a_recording_with_distant_times_does_not_exhaust_the_memory(tmp_path: Path) -> None:
    recording(np.array((0.0, 1e9)), P[:2]).save(tmp_path / "far.npz")
    with pytest.raises(DeviceError, match=r"far\.npz: .* 1,000,000,000 s"):
        played(1, file=str(tmp_path / "far.npz"))


def test_invalid_files_are_errors(tmp_path: Path) -> None:
    (tmp_path / "bad.npz").write_bytes(b"PK")
    recording(np.zeros(1), P[:1]).save(tmp_path / "one.npz")
    for file, said in (
        ("", "option file"),
        ("none.csv", "none.csv"),
        ("bad.npz", r"bad\.npz"),
        ("one.npz", "1 tick"),
    ):
        with pytest.raises(DeviceError, match=f"^replay: .*{said}"):
            DRIVER.open(file=file and str(tmp_path / file))
