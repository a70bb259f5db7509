"""The handle that is played as sound: on a sound card that is none, and on cards that are none at all."""

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hapscene.errors import HandleError
from hapscene_plugins.devices.audio import DRIVER, AudioHandle


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

    def OutputStream(self, **told: Any) -> Any:
        self.opened = told
        if told["samplerate"] != 48_000.0:
            raise self.PortAudioError("Invalid sample rate")
        return SimpleNamespace(latency=0.01, start=lambda: None, stop=lambda: None, close=lambda: None)


HEADPHONES, PAD, SPLIT = ("USB Headphones", 2), ("Wireless Controller: USB Audio", 4), ("DualSense Speaker", 2)


@pytest.fixture
def cards(monkeypatch: pytest.MonkeyPatch) -> Any:
    def plug(*cards: tuple[str, int]) -> FakeSound:
        sound = FakeSound(*cards)
        monkeypatch.setitem(sys.modules, "sounddevice", sound)
        return sound

    return plug


@pytest.mark.parametrize(
    ("told", "number", "columns", "count"),
    [
        ({}, 1, [2, 3], 4),  # a DualSense first, where there is one
        ({"device": "dualsense"}, 1, [2, 3], 4),
        ({"device": "headphones"}, 0, [0, 1], 2),
        ({"device": "0", "channels": "2"}, 0, [1], 2),
        ({"device": "wireless", "channels": "4"}, 1, [3], 4),
    ],
)
def test_the_output_is_found_by_name(
    cards: Any, told: dict[str, str], number: int, columns: list[int], count: int
) -> None:
    sound = cards(HEADPHONES, PAD)
    handle = AudioHandle(**told)
    assert (sound.opened["device"], handle._columns, sound.opened["channels"]) == (number, columns, count)
    handle.close()
    handle.close()
    assert handle.latency_s == 0.01  # what is said at the end


@pytest.mark.parametrize(
    ("there", "told", "words"),
    [
        ((SPLIT,), {}, "shows only 2 of its four channels.*Pro Audio or Direct.*option channels=1,2"),
        (
            (HEADPHONES,),
            {"device": "exciter"},
            r"no sound output 'exciter'; there are: 0 USB Headphones \(2 channels\)",
        ),
        ((), {}, "there are: none"),
        ((HEADPHONES,), {"channels": "3,4"}, "has the channels 1 to 2"),
        ((HEADPHONES,), {"channels": "left"}, "numbers from 1 with commas between"),
        ((HEADPHONES,), {"rate_Hz": 1.0}, "cannot be opened: Invalid sample rate"),
    ],
)
def test_what_cannot_be_played_on_is_said_in_words(cards: Any, there: Any, told: dict[str, Any], words: str) -> None:
    cards(*there)
    with pytest.raises(HandleError, match=words):
        AudioHandle(**told)


def test_a_fault_in_the_callback_is_silence_and_told(cards: Any) -> None:
    sound = cards(HEADPHONES)
    handle = AudioHandle()

    def pull(out: np.ndarray) -> None:
        out[:] = 1.0
        raise RuntimeError("no more")

    handle.start(SimpleNamespace(pull=pull, fade_in=lambda: None))
    out = np.ones((64, 2), np.int16)
    with pytest.raises(FakeSound.CallbackAbort):
        sound.opened["callback"](out, 64, None, SimpleNamespace(output_underflow=True))
    assert not out.any() and "no more" in handle.fault and handle.counts == {"underruns": 1}


def test_a_card_that_is_torn_out_is_told(cards: Any) -> None:
    sound = cards(HEADPHONES)
    handle = AudioHandle()
    sound.opened["finished_callback"]()
    assert handle.fault == "USB Headphones: plays no more: was it unplugged?"


def test_without_portaudio_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    class Finder:
        def find_spec(self, name: str, path: Any, target: Any = None) -> None:
            if name == "sounddevice":
                raise OSError("PortAudio library not found")

    monkeypatch.delitem(sys.modules, "sounddevice", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Finder(), *sys.meta_path])
    with pytest.raises(HandleError, match="apt-get install libportaudio2"):
        AudioHandle()
    (found,) = DRIVER.find()
    assert found.trouble and "libportaudio2" in found.remedy


def test_outputs_are_found_and_the_trap_is_told(cards: Any) -> None:
    cards(HEADPHONES, SPLIT)
    headphones, split = DRIVER.find()
    assert headphones.where == "USB Headphones (2 channels)" and headphones.trouble == ""
    assert "shows only 2 of its four" in split.trouble and "Pro Audio or Direct" in split.remedy
