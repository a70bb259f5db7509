"""The handle that is played as sound: on simulated sound cards."""

import sys
import threading
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.errors import HandleError
from hapscene_plugins.devices.audio import BUFFERS_S, DRIVER, AudioHandle
from tests.virtual_clock import PATIENCE_S


def opened(**options: Any) -> AudioHandle:
    return AudioHandle(**DRIVER.read_options(options))


class FakeSound:
    """As much of sounddevice as the handle uses."""

    class PortAudioError(Exception):
        pass

    class CallbackAbort(Exception):
        pass

    def __init__(self, *cards: tuple[str, int]) -> None:
        self._cards = cards
        self.default = SimpleNamespace(device=(-1, 0))
        self.opened: dict[str, Any] = {}
        self.refused = ""  # what the card refuses
        self.calls: list[str] = []  # of the streams, with the length of their buffer

    def query_devices(self) -> list[dict[str, Any]]:
        return [{"name": name, "max_output_channels": count} for name, count in self._cards]

    def OutputStream(self, **options: Any) -> Any:
        self.opened = options
        latency_s = options["latency"]

        def call(name: str) -> None:
            if self.refused == name:
                raise self.PortAudioError(f"cannot {name}")
            self.calls.append(f"{name} {latency_s}")
            if name == "stop":
                options["finished_callback"]()

        call("open")
        return SimpleNamespace(latency=latency_s, **{name: partial(call, name) for name in ("start", "stop", "close")})


HEADPHONES, PAD, SPLIT = ("USB Headphones", 2), ("Wireless Controller: USB Audio", 4), ("DualSense Speaker", 2)
MIC, MONO, SURROUND = ("Microphone", 0), ("Mono", 1), ("Surround", 6)


@pytest.fixture
def cards(monkeypatch: pytest.MonkeyPatch) -> Any:
    def plug(*cards: tuple[str, int]) -> FakeSound:
        sound = FakeSound(*cards)
        monkeypatch.setitem(sys.modules, "sounddevice", sound)
        return sound

    return plug


@pytest.mark.parametrize(
    ("options", "number", "columns", "count"),
    [
        ({}, 1, [2, 3], 4),  # a DualSense first, where there is one
        ({"device": "dualsense"}, 1, [2, 3], 4),
        ({"device": "headphones"}, 0, [0, 1], 2),
        ({"device": "0", "channels": "2"}, 0, [1], 2),
        ({"device": "wireless", "channels": "4"}, 1, [3], 4),
        ({"device": "wireless", "channels": "1"}, 1, [0], 4),
        ({"device": "mono"}, 3, [0], 1),
        ({"device": "r"}, 4, [0, 1], 4),  # of several, the one with the most channels
        ({"device": "4", "channels": "6,1"}, 4, [5, 0], 6),
    ],
)
def test_the_output_is_found_by_name(
    cards: Any, options: dict[str, str], number: int, columns: list[int], count: int
) -> None:
    sound = cards(HEADPHONES, PAD, MIC, MONO, SURROUND)
    handle = opened(**options)
    assert (sound.opened["device"], handle._columns, sound.opened["channels"]) == (number, columns, count)
    handle.close()
    handle.close()
    assert handle.latency_s == BUFFERS_S[0] and not handle.fault and sound.opened["blocksize"] == 0
    assert sound.calls == ["open 0.08", "stop 0.08", "close 0.08"]
    assert (handle.takes_force, handle.reads_back, handle.ceiling) == (False, False, 0.99)


def test_without_a_dualsense_it_is_the_output_of_the_system_or_that_with_most_channels(cards: Any) -> None:
    for number in (0, 1, -1):
        sound = cards(HEADPHONES, MONO, SURROUND)
        sound.default.device = (2, number)
        opened()
        assert sound.opened["device"] == number % 3


@pytest.mark.parametrize(
    ("there", "options", "words"),
    [
        ((SPLIT,), {}, "DualSense Speaker.*Pro Audio.*channels=1,2"),
        ((HEADPHONES,), {"device": "exciter"}, r"'exciter'.*0 USB Headphones \(2 channels\)"),
        ((), {}, "no audio output"),
        ((HEADPHONES,), {"channels": "3,4"}, "channels=3,4.*USB Headphones"),
        ((HEADPHONES,), {"channels": "0"}, "channels=0"),
        ((HEADPHONES,), {"channels": "left"}, "channels=left"),
        ((MIC,), {}, "not found"),
    ],
)
def test_an_output_that_cannot_be_opened_is_an_error(
    cards: Any, there: Any, options: dict[str, Any], words: str
) -> None:
    cards(*there)
    with pytest.raises(HandleError, match=words):
        opened(**options)


def test_an_error_in_the_callback_plays_silence_and_is_reported(cards: Any) -> None:
    sound = cards(HEADPHONES)
    handle = opened(buffer_s=0.05)

    def pull(out: np.ndarray) -> None:
        out[:] = 1.0
        raise RuntimeError("no more")

    handle.start(SimpleNamespace(pull=pull))
    out = np.ones((64, 2), np.int16)
    with pytest.raises(FakeSound.CallbackAbort):
        sound.opened["callback"](out, 64, None, SimpleNamespace(output_underflow=True))
    assert not out.any() and "no more" in handle.fault and handle.counts == {"underruns": 1}
    sound.opened["finished_callback"]()
    assert "no more" in handle.fault


@pytest.mark.parametrize("buffer_s", [0.0, 0.05])
def test_the_default_buffer_grows_after_underruns_and_reports_its_latency(cards: Any, buffer_s: float) -> None:
    sound, latencies_s = cards(PAD), []
    handle = opened(buffer_s=buffer_s)
    handle._feed = SimpleNamespace(pull=lambda out: out.fill(0.5), fade_in=lambda: sound.calls.append("fade"))
    for underflow in (False, True, False, True, True, True):
        out = np.ones((64, 4), np.int16)
        sound.opened["callback"](out, 64, None, SimpleNamespace(output_underflow=underflow))
        assert (out == np.rint([0.0, 0.0, 0.5 * 32_767, 0.5 * 32_767])).all()
        if handle._grow.is_set():
            handle.grow()  # as its thread does
        latencies_s.append(handle.latency_s)
    wanted_s = np.array(BUFFERS_S)[[0, 1, 1, 2, 3, 3]].tolist() if buffer_s == 0.0 else [buffer_s] * 6
    assert latencies_s == wanted_s and handle.counts == {"underruns": 4} and not handle.fault
    again = [["stop 0.08", "close 0.08", "fade", "open 0.12", "start 0.12"], ["stop 0.12", "close 0.12", "fade"]]
    assert sound.calls[:9] == (["open 0.08", *again[0], *again[1]] if buffer_s == 0.0 else ["open 0.05"])


def test_a_thread_enlarges_the_buffer_until_the_output_is_closed(cards: Any) -> None:
    sound, faded, before = cards(HEADPHONES), threading.Event(), set(threading.enumerate())
    handle = opened()
    handle.start(SimpleNamespace(pull=lambda out: out.fill(0.5), fade_in=faded.set))
    (thread,) = (new for new in set(threading.enumerate()) - before if new.name == "hapscene audio")
    assert sound.calls == ["open 0.08", "start 0.08"]
    sound.opened["callback"](np.ones((64, 2), np.int16), 64, None, SimpleNamespace(output_underflow=True))
    assert faded.wait(PATIENCE_S)
    handle.close()
    thread.join(PATIENCE_S)
    assert not thread.is_alive() and sound.calls[-4:] == ["open 0.12", "start 0.12", "stop 0.12", "close 0.12"]


def test_an_output_that_does_not_start_or_reopen_is_an_error(cards: Any) -> None:
    sound = cards(HEADPHONES)
    handle, feed = opened(), SimpleNamespace(fade_in=lambda: None)
    sound.refused = "start"
    with pytest.raises(HandleError, match=r"USB Headphones: .*cannot start"):
        handle.start(feed)
    handle.grow()
    assert "cannot start" in handle.fault and handle.latency_s == BUFFERS_S[0]
    handle.grow()  # does nothing
    handle.close()
    assert sound.calls == ["open 0.08", "stop 0.08", "close 0.08", "open 0.12", "close 0.12"]
    sound.refused = "open"
    with pytest.raises(HandleError, match="cannot open"):
        opened()


def test_a_disconnected_card_is_reported(cards: Any) -> None:
    sound = cards(HEADPHONES)
    handle = opened()
    sound.opened["finished_callback"]()
    assert handle.fault.startswith("USB Headphones: ")
    handle.close()
    assert sound.calls == ["open 0.08", "close 0.08"]  # nothing left to play


def test_without_portaudio_the_error_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    class Finder:
        def find_spec(self, name: str, path: Any, target: Any = None) -> None:
            if name == "sounddevice":
                raise OSError("PortAudio library not found")

    monkeypatch.delitem(sys.modules, "sounddevice", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Finder(), *sys.meta_path])
    with pytest.raises(HandleError, match="apt-get install libportaudio2"):
        opened()
    (found,) = DRIVER.find()
    assert found.trouble and "libportaudio2" in found.remedy


def test_outputs_are_listed_with_a_remedy_for_missing_channels(cards: Any) -> None:
    cards(HEADPHONES, SPLIT, MIC, PAD)
    headphones, split, pad = DRIVER.find()
    assert pad.trouble == pad.remedy == "" and pad.options == {"device": "3"}
    assert headphones.where == "USB Headphones (2 channels)" and headphones.trouble == ""
    assert "2 of its four channels" in split.trouble and "Pro Audio or Direct" in split.remedy
