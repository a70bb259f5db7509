"""The page's server as a client meets it that may be anybody."""

import json
import math
import socket
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect as connect_socket

import hapscene
from hapscene.errors import HapsceneError
from hapscene.play import page_server
from hapscene.play.line_of_sight import LineOfSight
from hapscene.play.page_server import PageServer
from hapscene.scene.mesh import Mesh
from hapscene.scene.scene import Scene
from tests.virtual_clock import VirtualClock

PATIENCE_S = 180.0
KIOSK_S = 60.0


def make_scene() -> Scene:
    """A plate whose top is z = 0, 120 mm wide."""
    scene, X_WB = Scene(), np.eye(4)
    X_WB[2, 3] = -0.01
    box = Mesh.from_trimesh(trimesh.creation.box((0.12, 0.12, 0.02)), "m")
    scene.add(box, name="plate", pose=X_WB, swatch=hapscene.load_swatch("wood"))
    return scene


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def page(clock: VirtualClock, monkeypatch: pytest.MonkeyPatch) -> Iterator[PageServer]:
    monkeypatch.setattr(page_server, "scene_json", lambda scene, title: "{}")
    with PageServer(make_scene(), title="a plate", kiosk_s=KIOSK_S, clock=clock) as page:
        yield page


def connect(page: PageServer) -> ClientConnection:
    origin: Any = "/".join(page.url.split("/")[:3])
    return connect_socket(f"ws{page.url[4:]}socket", origin=origin)


def settle(tab: ClientConnection) -> None:
    """Wait until the server has taken all that a page sent: it answers what is said last."""
    tab.send('{"switch": ["wall", true]}')
    while "title" not in json.loads(tab.recv(PATIENCE_S)):
        pass


def above(pointer: int, x_m: float, y_m: float = 0.0, depth: float = 0.5) -> list[Any]:
    """A pointer on the line of sight straight down to a place."""
    return [pointer, [x_m, y_m, 0.5], [0.0, 0.0, -1.0], depth]


def downs(page: PageServer) -> list[bool]:
    """Which tools are down."""
    return [place.down for place in page.link._places]


def test_points_become_places_on_the_surface(page: PageServer) -> None:
    with connect(page) as tab:
        assert json.loads(tab.recv(PATIENCE_S))["title"] == "a plate"
        tab.send(json.dumps({"points": [above(7, 0.03, -0.02)]}))
        settle(tab)
        assert any(downs(page))
        place = page.link._places[0]
        assert place[2:6] == pytest.approx((0.03, -0.02, 0.0, 0.5 * page_server.DEPTH_MAX_M), abs=1e-6)
        tab.send(json.dumps({"points": [above(7, 0.07, 0.0)]}))  # beside the plate
        settle(tab)
        assert not any(downs(page))


def test_each_finger_has_a_tool_and_one_too_many_has_none(page: PageServer) -> None:
    page.take(1, {"points": [above(1, -0.01), above(2, 0.01), above(3, 0.0)]})
    assert downs(page) == [True, True]
    assert page.link._places[0].x_m < -0.005 < 0.005 < page.link._places[1].x_m
    page.take(1, {"up": [1]})
    page.take(2, {"points": [above(1, 0.0)]})  # another page's
    assert downs(page) == [True, True]
    assert page.link._places[0].x_m == pytest.approx(0.0, abs=1e-9)
    page.take(1, {"lift": True})
    assert downs(page) == [False, False]


def test_closed_page_lifts_its_tools(page: PageServer) -> None:
    tab = connect(page)
    assert json.loads(tab.recv(PATIENCE_S))["title"] == "a plate"
    tab.send(json.dumps({"points": [above(1, 0.0)]}))
    settle(tab)
    assert downs(page)[0]
    tab.socket.shutdown(socket.SHUT_RDWR)  # without a word
    tab = connect(page)
    settle(tab)
    tab.close()
    assert not downs(page)[0]


def test_a_closed_server_has_no_thread_and_lifts_its_tools(
    clock: VirtualClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page_server, "scene_json", lambda scene, title: f"[{title}]")
    page = PageServer(make_scene(), title="a plate", clock=clock)
    assert page._content("scene.json") is None
    with page:
        page.take(1, {"points": [above(1, 0.0)]})
        assert page._content("scene.json") == (b"[a plate]", "application/json") and page._content("x") is None
        script = page._content("view.js")
        assert script is not None and script[0] and script[1].startswith("text/javascript")
    assert not any(downs(page)) and not page._beats.is_alive() and page.link._socket.fileno() == -1
    with pytest.raises(RuntimeError):
        page._drawer.submit(print)
    with pytest.raises(OSError):
        connect(page)
    page.close()


def test_finger_without_events_is_lifted(page: PageServer, clock: VirtualClock) -> None:
    page.take(1, {"points": [above(1, 0.0)]})
    clock.sleep_s(0.9 * page_server.STALE_S)
    page.beat()
    assert downs(page)[0]
    page.take(1, {"points": [above(1, 0.0)]})
    clock.sleep_s(0.9 * page_server.STALE_S)
    page.beat()
    assert downs(page)[0]
    clock.sleep_s(0.2 * page_server.STALE_S)
    page.beat()
    assert not downs(page)[0]


def test_invalid_messages_have_no_effect(page: PageServer) -> None:
    values: list[Any] = [None, True, -1, 10**400, 1e308, "x", "", [], {}, [[]], [[1, 2, 3]], [[1, "a", 0, 0]]]
    good = above(1, 0.0)
    values += [[[*good[:place], wrong, *good[place + 1 :]]] for place in range(4) for wrong in (math.nan, [], "x")]
    lines = (
        ([math.inf, 0.0, 0.5], [0, 0]),
        ([1e308] * 3, [0, 0, -1]),
        ([0, 0, 0.5], [0, 0, 0]),
        ([0, 0, 1], [1e308] * 3),
    )
    values += [[[1, *line, 0.5]] for line in lines] + [[above(1, 0.0, depth=1.5)]]
    values += [["wall", 1], [[], True], ["x", True], [True, 2.0], [True, None], {"0": 1}, [1] * 1000]
    before = page.state()
    for value in values:
        page.take(1, value)
        for order in ("points", "up", "switch", "pause", "sound", "x", ""):
            page.take(1, {order: value})
    page.take(1, {"points": [above(1, 0.0)], **{str(number): 0 for number in range(8)}})  # too many orders
    assert page.state() == before and downs(page) == [False, False]


class FakeServo:
    """Takes orders."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.tick_s, self.orders = scene, 1e-3, list[Any]()

    def mute(self, effect: str, muted: bool) -> None:
        self.orders.append((effect, muted))

    def pause(self) -> None:
        self.orders.append("pause")

    def resume(self) -> None:
        self.orders.append("resume")

    def state(self, tool: int) -> Any:
        return SimpleNamespace(tick=0, touching=False)


def test_traces_hold_the_extremes_of_all_tools_in_each_bin(page: PageServer) -> None:
    ticks, rng = 3 * page_server.BIN + 1, np.random.default_rng(0)
    rows = np.zeros((2, ticks), [("f_W_N", float, 3), ("slip_m_s", float)])
    rows["f_W_N"], rows["slip_m_s"], a_m_s2 = (rng.normal(size=(2, ticks, *n)) for n in ((3,), (), (10,)))
    kept = [0, 0]

    class Touched(FakeServo):
        def state(self, tool: int) -> Any:
            place = {"p_WP_m": (1e-3, 2e-3, 0.0), "f_W_N": (0.0, 0.3, 0.4), "depth_m": 2e-4, "swatch": 3}
            return SimpleNamespace(tick=ticks - 1, touching=tool == 1, **place)

        def read(self, since: int, tool: int) -> Any:
            first = max(since, kept[tool])
            return SimpleNamespace(rows=rows[tool, first:], a_m_s2=a_m_s2[tool, first:])

    servo: Any = Touched(make_scene())
    bins = [np.arange(ticks)[at : at + page_server.BIN] for at in range(0, ticks - 1, page_server.BIN)]
    for tools in ([0, 1], [1]):
        felt, since = page._felt(servo, 0)
        f_N, v_m_s = np.linalg.norm(rows["f_W_N"], axis=-1)[tools], rows["slip_m_s"][tools]
        a = [a_m_s2[tools][:, at].ravel() for at in bins]
        assert felt["f"] == pytest.approx([f_N[:, at].max() for at in bins], abs=1e-4)
        assert felt["v"] == pytest.approx([max(v_m_s[:, at].max(), 0.0) for at in bins], abs=1e-4)
        assert felt["a"] == pytest.approx([peaks[np.abs(peaks).argmax()] for peaks in a], abs=1e-4)
        assert felt["felt"] == [[[0.001, 0.002, 0.0], 0.5, 0.2, 3]] and since == ticks - 1
        kept[0] = 2  # the log of this tool is overwritten
    assert page._felt(servo, -1) == ({"f": [], "a": [], "v": [], "felt": felt["felt"]}, ticks - 1)


def test_each_beat_sends_changes_and_traces_since_the_last_one(
    clock: VirtualClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, sent, asked, pages = PageServer(make_scene(), title="a plate", clock=clock), list[Any](), list[Any](), [1]
    servo: Any = FakeServo(make_scene())
    turns = iter([lambda: None, lambda: page.attach(servo), pages.clear, lambda: pages.append(2)])

    def wait(timeout_s: float) -> bool:
        turn = next(turns, None)
        return turn is None or turn() is not None

    def felt(of: object, since: int) -> tuple[Any, int]:
        asked.append(since)
        if since == 9:
            raise HapsceneError("the servo has ended")
        return {"f": [since]}, 9

    page.attach(servo)
    with monkeypatch.context() as patch:
        patch.setattr(page, "_ended", SimpleNamespace(wait=wait))
        patch.setattr(page, "_server", SimpleNamespace(pages=pages, send=sent.append))
        patch.setattr(page, "_felt", felt)
        patch.setattr(page.link, "beat", lambda: asked.append("beat"))
        page._beat_on()
    page.close()
    assert asked == ["beat", -1, "beat", 9, "beat", "beat", -1]
    assert sent == [{"f": [-1]}, page.state(), {"said": "the servo has ended"}, {"f": [-1]}]


def test_kiosk_resets_effects_and_sound(page: PageServer, clock: VirtualClock) -> None:
    servo: Any = FakeServo(make_scene())
    switched: list[Any] = []
    assert not page.state()["ready"]
    page.attach(servo)
    assert page.state()["ready"]
    page.sound = lambda on, volume: switched.append((on, volume))
    page.take(1, {"switch": ["friction", False], "sound": [True, 0.5]})
    page.take(1, {"switch": ["friction", False]})  # it is off already
    assert servo.orders == [("friction", True)]
    page.take(1, {"points": [above(1, 0.0)]})
    page.take(1, {"pause": True})
    assert not any(downs(page))
    page.take(1, {"points": [above(1, 0.0)]})
    assert not any(downs(page))
    servo.orders.clear()
    clock.sleep_s(0.9 * KIOSK_S)
    page.beat()
    assert page.state()["resets"] == 0
    clock.sleep_s(0.2 * KIOSK_S)
    page.beat()
    assert page.state()["resets"] == 1
    assert servo.orders == [("friction", False), "resume"]
    assert switched == [(True, 0.5), (False, 0.5)]
    assert page.state()["effects"]["friction"]
    clock.sleep_s(2.0 * KIOSK_S)
    page.beat()
    assert page.state()["resets"] == 1  # no second reset without a visitor


def test_refused_order_reports_the_reason(page: PageServer) -> None:
    def refuse(on: bool, volume: float) -> None:
        raise HapsceneError("no card")

    page.sound = refuse
    page.take(1, {"sound": [True, 0.5]})
    assert page.state()["said"] == "no card"
    assert page.state()["sound"] is False


def test_a_line_of_sight_ends_on_the_first_face_that_points_to_the_eye() -> None:
    sight = LineOfSight(make_scene())
    rng = np.random.default_rng(3)
    for hit_m in rng.uniform((-0.05, -0.05, 0.0), (0.05, 0.05, 0.0), (20, 3)):
        back = rng.normal(size=3) * (1.0, 1.0, 0.0) + (0.0, 0.0, 1.5)
        found = sight.find(tuple(hit_m + 0.4 * back), tuple(-2.0 * back))
        assert found is not None
        np.testing.assert_allclose(found[0], hit_m, atol=1e-6)
        np.testing.assert_allclose(found[1], back / np.linalg.norm(back), atol=1e-12)
        np.testing.assert_allclose(found[2], (0.0, 0.0, 1.0), atol=1e-12)
    side = sight.find((-0.2, 0.0, 0.13), (1.0, 0.0, -1.0))  # the left side of the plate at z = −0.01
    assert side is not None and side[0] == pytest.approx((-0.06, 0.0, -0.01), abs=1e-6)
    assert side[2] == pytest.approx((-1.0, 0.0, 0.0), abs=1e-12)
    steep = sight.find((-0.065, 0.0, 0.03), (0.1, 0.0, -0.7))
    assert steep is not None and steep[2] == pytest.approx((-1.0, 0.0, 0.0), abs=1e-12)
    assert sight.find((-0.2, 0.0, -0.01), (1.0, 0.0, 0.0)) is None  # level
    inner = (0.0, 0.0, -0.01), (0.0, 0.0, -1.0)
    assert sight.find(*inner) is None
    scene = make_scene()
    scene.bodies[0].two_sided = True
    low = scene.add(Mesh.from_trimesh(trimesh.creation.box((0.02, 0.02, 0.02)), "m"), name="low")
    low.X_WB[:3, 3] = (0.1, 0.0, -0.1)
    both = LineOfSight(scene)
    np.testing.assert_allclose([both.low_m, both.size_m], [(-0.06, -0.06, -0.11), (0.17, 0.12, 0.11)])
    assert both.clear_m == pytest.approx(0.02) and both.find((0.1, 0.0, 1.0), (0.0, 0.0, -1.0)) is not None
    below = both.find(*inner)
    assert below is not None and below[0] == pytest.approx((0.0, 0.0, -0.02)) and below[2] == (0.0, 0.0, 1.0)


def test_without_a_scene_the_pad_is_touched() -> None:
    sight = LineOfSight(None)
    found = sight.find((0.0, -0.1, 0.1), (0.0, 1.0, -1.0))
    assert found is not None and found[0] == pytest.approx((0.0, 0.0, 0.0), abs=1e-12)
