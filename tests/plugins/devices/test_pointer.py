"""The device `pointer`, moved over its link, without a page."""

import socket
import urllib.parse
from collections.abc import Iterator

import numpy as np
import pytest

import hapscene.device
from hapscene.errors import DeviceError
from hapscene.play.pointer_link import HELLO, PLACE, PointerLink
from hapscene_plugins.devices.pointer import DRIVER, HOVER_M, PointerConnection

CLEAR_M, UP = 0.05, (0.0, 0.0, 1.0)


@pytest.fixture
def link() -> Iterator[PointerLink]:
    link = PointerLink(2, CLEAR_M)
    yield link
    link.close()


def connected(link: PointerLink, monkeypatch: pytest.MonkeyPatch, tool: int = 0) -> PointerConnection:
    def hello(pointer: PointerConnection) -> None:
        say(pointer)
        link.beat()

    say = PointerConnection._say_hello
    with monkeypatch.context() as patch:
        patch.setattr(PointerConnection, "_say_hello", hello)
        pointer = hapscene.device.open("pointer", door=link.port, key=link.key, tool=tool)
    assert isinstance(pointer, PointerConnection)
    return pointer


def test_closed_link_frees_its_port() -> None:
    link = PointerLink(1, CLEAR_M)
    link.close()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", link.port))


def walk(pointer: PointerConnection, ticks: int) -> np.ndarray:
    """Return the position in each tick (ticks, 3) [m]."""
    places = np.zeros((ticks, 3))
    for place in places:
        pointer.read()
        place[:] = pointer.state.p_DT_m[0]
    return places


def test_touch_starts_above_and_reaches_the_given_depth(link: PointerLink, monkeypatch: pytest.MonkeyPatch) -> None:
    with connected(link, monkeypatch) as pointer:
        assert walk(pointer, 5)[-1, 2] == CLEAR_M
        link.press(0, (0.02, -0.01, 0.004), UP, UP, 0.001)
        way = walk(pointer, 100)
        sideways = np.abs(np.diff(way[:, :2], axis=0, prepend=0.0)).max(axis=1) > 0.0
        assert (way[sideways, 2] == CLEAR_M).all()  # it meets nothing on its way there
        assert way[1, 2] == pytest.approx(0.004 + HOVER_M)
        assert (np.diff(way[2:, 2]) <= 0.0).all()
        assert way[-1] == pytest.approx([0.02, -0.01, 0.003], abs=1e-6)
        landed = int(np.argmax(way[:, 2] < 0.004))
        assert landed <= 12
        assert 0.02 < (way[landed - 1, 2] - way[landed, 2]) / 1e-3 < 0.1  # as fast as a light tap [m/s]
        assert pointer.state.buttons[0] == 1 and pointer.state.count[0] == 105
        link.lift(0)
        walk(pointer, 1)
        assert pointer.state.buttons[0] == 0
    assert pointer._socket.fileno() == -1


def test_movement_between_two_places_lasts_as_long_as_between_their_times(
    link: PointerLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    """8 ms at first; then a quarter of each difference, of which none counts as less than 2 or more than 40 ms."""
    with connected(link, monkeypatch) as pointer:
        spans = [pointer._span]
        for k, ticks in enumerate((1, 200, 1, 20)):
            link.press(0, (1e-4 * k, 0.0, 0.0), UP, UP, 0.001)
            walk(pointer, ticks)
            spans.append(pointer._span)
        assert spans == pytest.approx([8.0, 8.0, 6.5, 14.875, 11.65625])


def test_a_touch_from_the_side_comes_and_goes_along_the_line_of_sight(
    link: PointerLink, monkeypatch: pytest.MonkeyPatch
) -> None:
    back, place = np.array([0.6, 0.0, 0.8]), np.array([0.02, -0.01, 0.004])
    with connected(link, monkeypatch) as pointer:
        walk(pointer, 5)
        link.press(0, tuple(place), tuple(back), tuple(back), 0.001)
        way = walk(pointer, 100)
        off = way - place
        assert way[0, 2] == CLEAR_M  # it crosses the scene above everything
        assert np.abs(off - np.outer(off @ back, back)).max() < 1e-9
        assert way[-1] == pytest.approx(place - 0.001 * back, abs=1e-6)
        link.lift(0)
        lifted = walk(pointer, 1)[0]
        assert lifted[2] == CLEAR_M
        assert lifted - place == pytest.approx((CLEAR_M - 0.004) / 0.8 * back, abs=1e-5)


def test_a_press_on_a_side_stays_where_it_is_seen(link: PointerLink, monkeypatch: pytest.MonkeyPatch) -> None:
    """Along the line of sight it would slide down by 4.9 mm, below a plate of 8 mm that it presses in the middle."""
    back, side, place = (-0.199, 0.0, 0.98), (-1.0, 0.0, 0.0), (0.02, -0.01, 0.004)
    with connected(link, monkeypatch) as pointer:
        walk(pointer, 5)
        link.press(0, place, back, side, 0.005)
        way = walk(pointer, 200)
        assert way[-1] == pytest.approx((0.025, -0.01, 0.004), abs=1e-6)
        inside = way[:, 0] > 0.02
        assert inside.any() and np.abs(way[inside, 2] - 0.004).max() < 3e-4  # on the whole way from the surface


def test_pressing_direction_follows_the_normal(link: PointerLink, monkeypatch: pytest.MonkeyPatch) -> None:
    """Smoothly over small faces that shake by 20°, and at once behind an edge."""
    with connected(link, monkeypatch) as pointer:
        walk(pointer, 5)
        shaking = [(0.342, 0.0, 0.940), (-0.342, 0.0, 0.940)]
        for k in range(60):
            link.press(0, (0.0, 0.0, 0.0), UP, shaking[k % 2], 0.002)
            way = walk(pointer, 8)
        assert np.ptp(way[:, 0]) < 0.1 * 2 * 0.342 * 0.002 and way[-1, 2] == pytest.approx(-0.002, rel=0.01)
        link.press(0, (0.0, 0.0, 0.0), UP, (1.0, 0.0, 0.0), 0.002)
        assert walk(pointer, 200)[-1] == pytest.approx((-0.002, 0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize("apart", [16, 4])
def test_steps_of_a_stroke_are_smooth(link: PointerLink, monkeypatch: pytest.MonkeyPatch, apart: int) -> None:
    """Places that come every 16 or 4 ms along a stroke at 0.1 m/s: its speed does not hum."""
    with connected(link, monkeypatch) as pointer:
        speed_m_s = []
        for k in range(1000 // apart):
            link.press(0, (1e-4 * apart * k, 0.0, 0.0), UP, UP, 0.001)
            speed_m_s.append(np.diff(walk(pointer, apart)[:, 0], prepend=np.nan) / 1e-3)
        speed = np.concatenate(speed_m_s[-20:])
        speed = speed[np.isfinite(speed)]
        assert speed == pytest.approx(0.1, rel=0.02)


def test_touch_ends_with_the_application(link: PointerLink, monkeypatch: pytest.MonkeyPatch) -> None:
    with connected(link, monkeypatch) as pointer:
        link.press(0, (0.0, 0.0, 0.0), UP, UP, 0.002)
        assert walk(pointer, 240)[-1, 2] < 0.0
        link.close()
        said: list[int] = []
        monkeypatch.setattr(pointer, "_say_hello", lambda: said.append(int(pointer.state.count[0])))
        assert walk(pointer, 20)[-1, 2] == CLEAR_M
        assert said == list(range(250, 260))  # to a server that starts again


def test_datagrams_of_others_are_ignored(link: PointerLink, monkeypatch: pytest.MonkeyPatch) -> None:
    with connected(link, monkeypatch) as pointer, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        own = pointer._socket.getsockname()
        random = np.random.default_rng(1)
        for _ in range(1000):
            stranger.sendto(random.bytes(int(random.integers(0, 80))), own)
            stranger.sendto(PLACE.pack(7, True, 0.0, 0.0, 0.0, 0.002, CLEAR_M, *UP, *UP), own)
            assert walk(pointer, 1)[0, 2] == CLEAR_M
            link.beat()


def test_a_client_with_a_wrong_key_gets_no_answer(link: PointerLink) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.bind(("127.0.0.1", 0))
        stranger.setblocking(False)
        right = link.key.encode()
        for said in (b"", b"x", HELLO.pack(b"0" * 16, 0), HELLO.pack(right, 2), HELLO.pack(right, 0) + b"x"):
            stranger.sendto(said, ("127.0.0.1", link.port))
        link.beat()
        with pytest.raises(BlockingIOError):
            stranger.recv(100)


def test_a_missing_server_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapscene_plugins.devices.pointer.HELLO_S", 0.05)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        closed: list[PointerConnection] = []
        monkeypatch.setattr(PointerConnection, "close", lambda pointer: closed.append(pointer))
        with pytest.raises(DeviceError, match="pointer"):
            hapscene.device.open("pointer", door=taken.getsockname()[1])
        assert len(closed) == 1
        closed[0]._socket.close()


def test_alone_it_opens_a_page_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("websockets", reason="websockets is not installed: pip install 'hapscene[serve]'")
    with hapscene.device.open("pointer") as pointer:
        assert "http://127.0.0.1:" in capsys.readouterr().out
        page = pointer._page  # type: ignore[attr-defined]
        place = "127.0.0.1", urllib.parse.urlsplit(page.url).port
        socket.create_connection(place).close()
        page.take(1, {"points": [[1, [0.04, 0.0, 0.5], [0.0, 0.0, -1.0], 0.5]]})
        assert walk(pointer, 100)[-1] == pytest.approx([0.04, 0.0, -0.0015], abs=1e-5)  # type: ignore[arg-type]
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(place)
    assert DRIVER.force is False
