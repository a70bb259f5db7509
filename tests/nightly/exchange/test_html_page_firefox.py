"""The page to touch in Firefox, which is controlled over WebDriver BiDi: drawn in Xvfb, played to a null sink."""

import itertools
import json
import os
import shutil
from contextlib import ExitStack
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from typing import Any

import pytest
from websockets.sync.client import connect

import hapscene
from hapscene.exchange.html_page import html_page
from tests.nightly.exchange.test_html_page import PLACE, RECORD
from tests.until import until

NEEDED = {"firefox-esr": "firefox-esr", "Xvfb": "xvfb", "pulseaudio": "pulseaudio"}
MISSING = [package for program, package in NEEDED.items() if shutil.which(program) is None]


class Firefox:
    """A tab of Firefox with a new profile in `folder`."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        def start(*words: str, **options: Any) -> "Popen[str]":
            process = stack.enter_context(Popen(words, env=env, text=True, **options))
            stack.callback(process.kill)
            return process

        env = {**os.environ, "HOME": str(folder), "PULSE_SERVER": f"unix:{folder}/sink", "LIBGL_ALWAYS_SOFTWARE": "1"}
        sink = (f"--load=module-native-protocol-unix socket={folder}/sink auth-anonymous=1", "--load=module-null-sink")
        start("pulseaudio", "-n", "--daemonize=no", "--use-pid-file=no", "--exit-idle-time=-1", *sink, stderr=DEVNULL)
        screen = start("Xvfb", "-displayfd", "1", "-screen", "0", "1400x1000x24", stdout=PIPE, stderr=DEVNULL)
        env["DISPLAY"] = f":{screen.stdout.readline().strip()}"  # type: ignore[union-attr]
        words = ("--no-remote", "--profile", str(folder), "--remote-debugging-port", "0")
        said = start("firefox-esr", *words, stderr=PIPE, stdout=DEVNULL).stderr or ()
        address = next(line.split()[-1] for line in said if "WebDriver BiDi listening on" in line)
        self._socket = stack.enter_context(connect(f"{address}/session", max_size=None))
        self._count = itertools.count()
        self.send("session.new", capabilities={})
        self.tab = self.send("browsingContext.create", type="tab")["context"]

    def send(self, method: str, **params: Any) -> Any:
        """Return the result of a command of WebDriver BiDi."""
        number = next(self._count)
        self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        answer = next(found for found in map(json.loads, self._socket) if found.get("id") == number)
        assert answer["type"] == "success", answer
        return answer["result"]

    def evaluate(self, script: str) -> Any:
        """Return the value of a JavaScript expression."""
        target, text = {"context": self.tab}, f"JSON.stringify({script}) ?? 'null'"
        done = self.send("script.evaluate", expression=text, target=target, awaitPromise=True)
        assert done["type"] == "success", done
        return json.loads(done["result"]["value"])

    def move(self, *actions: dict[str, Any]) -> None:
        """Perform actions of the mouse."""
        mouse = [{"type": "pointer", "id": "mouse", "actions": list(actions)}]
        self.send("input.performActions", context=self.tab, actions=mouse)


@pytest.mark.skipif(bool(MISSING), reason=f"{', '.join(MISSING)} missing: sh .ci/system-packages nightly")
def test_stroke(tmp_path: Path) -> None:
    """A pressed mouse starts the sound; a stroke is drawn, named and audible; the right button turns the scene."""
    file = tmp_path / "demo.html"
    file.write_text(html_page(hapscene.load_scene("assets/demo.scene.json"), "demo"), encoding="utf-8")
    with ExitStack() as stack:
        firefox = Firefox(tmp_path, stack)
        firefox.send("browsingContext.navigate", context=firefox.tab, url=file.as_uri(), wait="complete")
        until(lambda: firefox.evaluate("document.documentElement.dataset.ready"))
        assert firefox.evaluate(
            "gl.getError() === 0 && $('legend').children.length === 4 && $('task').textContent !== ''"
        )
        x, y = (round(place) for place in firefox.evaluate(f"({PLACE})('leather')"))
        firefox.evaluate(f"({RECORD})()")
        firefox.move({"type": "pointerMove", "x": x, "y": y}, {"type": "pointerDown", "button": 0})
        until(lambda: firefox.evaluate("audio.state") == "running")
        for _ in range(3):
            firefox.move(*({"type": "pointerMove", "x": x + i, "y": y, "duration": 50} for i in (5, 10, 5, 0)))
        assert firefox.evaluate("$('name').textContent") == "leather"
        until(lambda: firefox.evaluate("loudest") > 0.005)
        yaw = firefox.evaluate("camera.yaw")
        firefox.move({"type": "pointerUp", "button": 0}, {"type": "pointerDown", "button": 2})
        firefox.move({"type": "pointerMove", "x": x + 50, "y": y}, {"type": "pointerUp", "button": 2})
        assert firefox.evaluate("camera.yaw") < yaw
