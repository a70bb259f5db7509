"""WoodenHaptics' microcontroller: a report a millisecond, currents that end after half a second without one. Run:
woodenhaptics.py LOG SOCKET."""

import struct
import time

from emulator import Emulator
from usb_wire import serve


class Woody(Emulator):
    ids, kind, ends = (0x1234, 0x0006), 3, (0x81, 0x01)

    def __init__(self):
        super().__init__()
        self.a, self.b, self.c = 500.0, -4000.0, 1000.0
        self.sent = 0
        self.received_s = self.sent_s = time.monotonic()
        self.on = False

    def read(self, endpoint, wait_s):
        self.watch()
        wait_s = min(wait_s, self.sent_s + 0.001 - time.monotonic())
        time.sleep(max(0.0, wait_s))
        self.sent_s, self.sent = time.monotonic(), self.sent + 1
        return self.mangle(struct.pack("<3hH", int(self.a), int(self.b), int(self.c), self.sent & 0xFFFF))

    def write(self, endpoint, data):
        if endpoint == 1 and len(data) == 8:
            self.received_s, self.on = time.monotonic(), True
            self.log(*struct.unpack("<3hH", data))

    def watch(self):
        if self.on and time.monotonic() > self.received_s + 0.5:
            self.on = False
            self.log(0, 0, 0, 0)


if __name__ == "__main__":
    woody = Woody()
    import threading

    def look():
        while True:
            woody.watch()
            time.sleep(0.01)

    threading.Thread(target=look, daemon=True).start()
    serve(woody, woody.arguments.place)
