"""The handle that is played as sound: on simulated sound cards."""

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.errors import HandleError
from hapscene_plugins.devices.audio import BUFFERS_S, DRIVER, AudioHandle


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

    def query_devices(self) -> list[dict[str, Any]]:
        return [{"name": name, "max_output_channels": count} for name, count in self._cards]

    def OutputStream(self, **options: Any) -> Any:
        self.opened = options
        if options["samplerate"] != 48_000.0:
            raise self.PortAudioError("Invalid sample rate")
        latency_s = options["latency"]
        finished = options["finished_callback"]
        return SimpleNamespace(latency=latency_s, start=lambda: None, stop=finished, close=lambda: None)


HEADPHONES, PAD, SPLIT = ("USB Headphones", 2), ("Wireless Controller: USB Audio", 4), ("DualSense Speaker", 2)


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
    ],
)
def test_the_output_is_found_by_name(
    cards: Any, options: dict[str, str], number: int, columns: list[int], count: int
) -> None:
    sound = cards(HEADPHONES, PAD)
    handle = opened(**options)
    assert (sound.opened["device"], handle._columns, sound.opened["channels"]) == (number, columns, count)
    handle.close()
    handle.close()
    assert handle.latency_s == BUFFERS_S[0] and not handle.fault and sound.opened["blocksize"] == 0


@pytest.mark.parametrize(
    ("there", "options", "words"),
    [
        ((SPLIT,), {}, "DualSense Speaker.*Pro Audio.*channels=1,2"),
        ((HEADPHONES,), {"device": "exciter"}, r"'exciter'.*0 USB Headphones \(2 channels\)"),
        ((), {}, "no audio output"),
        ((HEADPHONES,), {"channels": "3,4"}, "channels=3,4.*USB Headphones"),
        ((HEADPHONES,), {"channels": "left"}, "channels=left"),
        ((HEADPHONES,), {"rate_Hz": 1.0}, "Invalid sample rate"),
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


@pytest.mark.parametrize("buffer_s", [0.0, 0.05])
def test_the_default_buffer_grows_after_underruns_and_reports_its_latency(cards: Any, buffer_s: float) -> None:
    sound, latencies_s, faded = cards(HEADPHONES), [], []
    handle = opened(buffer_s=buffer_s)
    handle._feed = SimpleNamespace(pull=lambda out: out.fill(0.5), fade_in=lambda: faded.append(True))
    for underflow in (False, True, True, True, True):
        out = np.zeros((64, 2), np.int16)
        sound.opened["callback"](out, 64, None, SimpleNamespace(output_underflow=underflow))
        assert (out == np.rint(0.5 * 32_767)).all()
        if handle._grow.is_set():
            handle.grow()  # as its thread does
        latencies_s.append(handle.latency_s)
    assert latencies_s == ([BUFFERS_S[0], *BUFFERS_S[1:], BUFFERS_S[-1]] if buffer_s == 0.0 else [buffer_s] * 5)
    assert len(faded) == (len(BUFFERS_S) - 1 if buffer_s == 0.0 else 0)
    assert handle.counts == {"underruns": 4} and not handle.fault


def test_a_disconnected_card_is_reported(cards: Any) -> None:
    sound = cards(HEADPHONES)
    handle = opened()
    sound.opened["finished_callback"]()
    assert handle.fault.startswith("USB Headphones: ")


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
    cards(HEADPHONES, SPLIT)
    headphones, split = DRIVER.find()
    assert headphones.where == "USB Headphones (2 channels)" and headphones.trouble == ""
    assert "2 of its four channels" in split.trouble and "Pro Audio or Direct" in split.remedy
