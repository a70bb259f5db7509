"""A Falcon at the wire, with its firmware: packets of 16 bytes. Run: falcon.py LOG SOCKET."""

import time

from emulator import Emulator
from usb_wire import serve


class Falcon(Emulator):
    ids, kind, ends = (0x0403, 0xCB48), 2, (0x81, 0x02)

    def __init__(self):
        super().__init__()
        self.count0 = self.count1 = self.count2 = -516.0
        self.baud = 0
        self.out = []
        self.sent_s = time.monotonic()

    def control(self, request, value):
        if request == 3:
            self.baud = value
        elif request == 0:
            self.out.clear()

    def write(self, endpoint, data):
        assert endpoint == 2
        if len(data) == 16 and data[:1] == b"<" and data[15:] == b">" and self.baud == 0x0002:
            motors = [sum((data[1 + 4 * i + k] - 0x41) << 4 * k for k in range(4)) for i in range(3)]
            self.log(*((m ^ 0x8000) - 0x8000 for m in motors), data[13] - 0x41)
            homed = 0x70 if self.ready else 0
            counts = (int(self.count0), int(self.count1), int(self.count2))
            nibbles = bytes(0x41 + (n >> 4 * k & 15) for n in counts for k in range(4))
            answer = self.mangle(b"<" + nibbles + bytes([0x41 + homed]) + b"A>")
            self.out.append(answer)

    def read(self, endpoint, wait_s):
        """Return two status bytes and the data, as FTDI chips do 1 ms after their last transfer."""
        assert endpoint == 0x81
        now_s = time.monotonic()
        self.sent_s = max(self.sent_s + 0.001, now_s)
        time.sleep(self.sent_s - now_s)
        data, self.out = b"".join(self.out), []
        return b"\x01\x60" + data[:62]


if __name__ == "__main__":
    falcon = Falcon()
    serve(falcon, falcon.arguments.place)
