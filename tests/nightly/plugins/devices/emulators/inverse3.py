"""Haply's service with one Inverse3: a whole state as one connects, then one for each message. Run: inverse3.py LOG."""

import json
import os
import threading

from emulator import Emulator
from websockets.sync.server import serve


class Service(Emulator):
    def __init__(self):
        super().__init__()
        self.values = 0.0  # the old spelling is the one that is understood
        self.events = 0.0
        self.wireless = 0.0
        self.moved = 0.0  # a transform that is not the identity
        self.buttons = 0.0
        self.x, self.speed = 0.06, 0.0
        self.force = {"x": 0.0, "y": 0.0, "z": 0.0}

    def state(self, whole):
        p = {"x": self.x, "y": -0.13, "z": 0.16}
        v = {"x": self.speed, "y": 0.0, "z": 0.0}
        entry = {"device_id": "05DA", "state": {"cursor_position": p, "current_cursor_force": self.force}}
        entry["state"]["cursor_velocity"] = v
        entry["state"]["transform"] = {"scale": {"x": 2.0, "y": 2.0, "z": 2.0}} if self.moved else {}
        entry["status"] = {"calibrated": bool(self.ready), "ready": True, "power_supply": True, "in_use": True}
        if whole:
            entry["config"] = {"torque_scaling": {"enabled": True}}
        orientation = {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
        if self.wireless:
            pressed = {name: bool(int(self.buttons) >> i & 1) for i, name in enumerate("abc")}
            grips = {"wireless_verse_grip": [{"state": {"buttons": pressed, "orientation": orientation}}]}
        else:
            grips = {"verse_grip": [{"state": {"button": bool(self.buttons), "hall": 3, "orientation": orientation}}]}
        return json.dumps({"session_id": 1, "inverse3": [entry], **grips})

    def handle(self, socket):
        socket.send(self.state(True))
        for message in socket:
            if self.gone:
                os._exit(0)
            command = json.loads(message)["inverse3"][0]
            assert command["device_id"] == "05DA"
            force = command["commands"]["set_cursor_force"]
            self.force = force.get("values" if self.values else "vector", {"x": 0.0, "y": 0.0, "z": 0.0})
            self.log(*self.force.values())
            if self.events:
                socket.send(json.dumps({"name": "stall", "category": "safety", "level": "info", "data": {}}))
            if not self.silent:
                socket.send(self.mangle(self.state(False).encode()).decode("latin-1"))


if __name__ == "__main__":
    service = Service()
    with serve(service.handle, "127.0.0.1", 0, compression=None) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        service.obey(f"ws://127.0.0.1:{server.socket.getsockname()[1]}")
        threading.Event().wait()
