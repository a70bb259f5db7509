"""Ten minutes of a servo with its socket, a game engine that pushes, and busy Python code."""

import os
import shutil
import subprocess
import threading
import time
from pathlib import Path

import pytest
import trimesh

from hapscene import Scene
from hapscene.bridge.orders import Orders
from hapscene.bridge.server import BridgeServer
from hapscene.loop import Servo
from hapscene.loop.empty_loop import EmptyLoop

GODOT = Path(__file__).resolve().parents[3] / "examples" / "engines" / "godot"
MINUTES = float(os.environ.get("SOAK_MINUTES", "10"))


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("godot3-server") is None, reason="no Godot here: apt-get install godot3-server")
def test_latency_with_a_game_and_busy_python(tmp_path: Path) -> None:
    shutil.copytree(GODOT, tmp_path / "godot")
    scene = Scene()
    scene.add(trimesh.creation.box((0.05, 0.05, 0.05)), name="crate", unit="m", swatch="wood")
    over = threading.Event()

    def spin() -> None:
        while not over.is_set():
            sum(range(1000))

    with Servo(scene, "omni") as servo, Orders(servo) as orders, BridgeServer(orders, "127.0.0.1", 0) as server:
        idle = EmptyLoop()
        threads = [threading.Thread(target=server.serve, args=(over.is_set,)), threading.Thread(target=spin)]
        for thread in threads:
            thread.start()
        try:
            before, runs, end_s = (servo.timing(), idle.timing()), 0, time.monotonic() + 60.0 * MINUTES
            while time.monotonic() < end_s:  # a game after the other, of three seconds each
                words = ["godot3-server", "--path", str(tmp_path / "godot"), f"--port={server.address[1]}"]
                done = subprocess.run(words, capture_output=True, text=True, timeout=120.0, check=False)
                assert "began, crate, wood" in done.stdout, done.stdout + done.stderr
                runs += 1
            ours, empty = servo.timing().since(before[0]), idle.timing().since(before[1])
        finally:
            over.set()
            for thread in threads:
                thread.join()
            idle.stop()
        shares = (0.5, 0.99, 0.999, 0.9999)
        late = [(round(ours.delay_us(share), 1), round(empty.delay_us(share), 1)) for share in shares]
        print(f"\n{runs} games; late by, and the empty loop [µs]: {late}; missed {ours.missed}, {empty.missed}")
        print(f"busy: median {ours.busy_us():.1f} µs, p99 {ours.busy_us(0.99):.1f} µs; {dict(server.counts)}")
        assert ours.delay_us(0.99) < 1.5 * empty.delay_us(0.99) + 10.0
        assert ours.missed <= empty.missed + 20
