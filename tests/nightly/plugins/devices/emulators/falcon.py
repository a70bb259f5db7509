"""A Falcon at the wire: FTDI requests, the boot loader's handshakes and echo, packets of 16 bytes. A stand-in for its
firmware, so that none is needed. Run: falcon.py LOG SOCKET."""

import time

from emulator import Emulator
from usb_wire import serve


class Falcon(Emulator):
    ids, kind, ends = (0x0403, 0xCB48), 2, (0x81, 0x02)

    def __init__(self):
        super().__init__()
        self.loaded = 1.0
        self.broken_echo = 0.0
        self.split = 0.0  # an answer comes in two transfers, and between them status bytes alone
        self.count0 = self.count1 = self.count2 = -516.0
        self.buttons = 0.0
        self.baud = self.modem = 0
        self.received = bytearray()
        self.out = []
        self.sent_s = time.monotonic()

    def control(self, request, value):
        self.log(-1, request, value)  # kept beside the forces: the test looks at their order
        if request == 3:
            self.baud = value
        elif request == 0:
            self.out.clear()

    def write(self, endpoint, data):
        assert endpoint == 2
        if not self.loaded:
            self._boot(data)
            return
        if len(data) == 16 and data[:1] == b"<" and data[15:] == b">" and self.baud == 0x0002:
            motors = [sum((data[1 + 4 * i + k] - 0x41) << 4 * k for k in range(4)) for i in range(3)]
            self.log(*((m ^ 0x8000) - 0x8000 for m in motors), data[13] - 0x41)
            homed = 0x70 if self.ready else 0
            counts = (int(self.count0), int(self.count1), int(self.count2))
            nibbles = bytes(0x41 + (n >> 4 * k & 15) for n in counts for k in range(4))
            answer = self.mangle(b"<" + nibbles + bytes([0x41 + homed + int(self.buttons)]) + b"A>")
            self.out += [answer[:7], b"", answer[7:]] if self.split else [answer]

    def _boot(self, data):
        self.received += data
        if self.baud == 0x4138 and data == b"\x0a\x43\x0d":
            self.out.append(b"\x0a\x44\x2c\x0d")
        elif self.baud == 0x0015:
            self.out.append(data if not self.broken_echo or len(data) == 1 else data[:-1] + bytes([data[-1] ^ 1]))
            if data != b"A" and len(data) < 62:  # the last piece
                self.loaded = 1.0
        elif self.baud == 0x4138:
            self.out.append(b"?")

    def read(self, endpoint, wait_s):
        """Return two status bytes and the data, as FTDI chips do 1 ms after their last transfer."""
        assert endpoint == 0x81
        now_s = time.monotonic()
        self.sent_s = max(self.sent_s + 0.001, now_s)
        time.sleep(self.sent_s - now_s)
        if self.split:
            data = self.out.pop(0) if self.out else b""
            return b"\x01\x60" + data if data else b"\x01"  # a short read
        data, self.out = b"".join(self.out), []
        return b"\x01\x60" + data[:62]


if __name__ == "__main__":
    falcon = Falcon()
    serve(falcon, falcon.arguments.place)
