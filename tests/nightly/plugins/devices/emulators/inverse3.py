"""Haply's service with one Inverse3: a whole state as one connects, then one for each message. Run: inverse3.py LOG."""

import json
import os
import socket
import threading
from contextlib import suppress

from emulator import Emulator
from websockets.server import ServerProtocol


class Service(Emulator):
    def __init__(self):
        super().__init__()
        self.x = 0.06
        self.force = {"x": 0.0, "y": 0.0, "z": 0.0}

    def state(self, whole):
        p = {"x": self.x, "y": -0.13, "z": 0.16}
        v = {"x": 0.0, "y": 0.0, "z": 0.0}
        entry = {"device_id": "05DA", "state": {"cursor_position": p, "current_cursor_force": self.force}}
        entry["state"]["cursor_velocity"] = v
        entry["status"] = {"calibrated": bool(self.ready), "ready": True, "power_supply": True, "in_use": True}
        if whole:
            entry["config"] = {"torque_scaling": {"enabled": True}}
        return json.dumps({"session_id": 1, "inverse3": [entry]})

    def handle(self, wire):
        """Answer the messages of a connection, one after the other; threads of websockets would delay the driver."""
        with suppress(OSError), wire:
            wire.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            handshake = ServerProtocol()
            while not (events := handshake.events_received()):
                handshake.receive_data(wire.recv(65536))
            handshake.send_response(handshake.accept(events[0]))
            wire.sendall(b"".join(handshake.data_to_send()))
            self.send(wire, self.state(True))
            data = b""
            while received := wire.recv(65536):
                data += received
                while len(data) >= 6 and len(data) >= (end := self.end_of_frame(data)):
                    frame, data = data[:end], data[end:]
                    if frame[0] == 0x88:
                        wire.sendall(b"\x88\x00")
                        return
                    self.obey_message(wire, frame)

    @staticmethod
    def end_of_frame(data):
        size = data[1] & 0x7F
        return 8 + int.from_bytes(data[2:4]) if size == 126 else 6 + size

    @staticmethod
    def send(wire, text):
        data = text.encode()
        wire.sendall(b"\x81" + (bytes([len(data)]) if len(data) < 126 else b"\x7e" + len(data).to_bytes(2)) + data)

    def obey_message(self, wire, frame):
        if self.gone:
            os._exit(0)
        at = 8 if frame[1] & 0x7F == 126 else 6
        mask = frame[at - 4 : at] * (len(frame) // 4 + 1)
        content = bytes(byte ^ key for byte, key in zip(frame[at:], mask, strict=False))
        command = json.loads(content)["inverse3"][0]
        assert command["device_id"] == "05DA"
        force = command["commands"]["set_cursor_force"]
        self.force = force["vector"]
        self.log(*self.force.values())
        if not self.silent:
            self.send(wire, self.mangle(self.state(False).encode()).decode("latin-1"))


if __name__ == "__main__":
    service = Service()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        service.obey(f"ws://127.0.0.1:{listener.getsockname()[1]}")
        while True:
            threading.Thread(target=service.handle, args=(listener.accept()[0],), daemon=True).start()
