"""A 2DIY's board on a pseudo-terminal: it answers each message at once, and keeps the last torques. It has no frames:
what is garbled is what comes. Run: haply2diy.py LOG."""

import os
import struct
import tty

from emulator import Emulator


class Board(Emulator):
    def __init__(self):
        super().__init__()
        self.first, self.second = 120.0, 60.0  # its arms [°]
        self.setup = b""

    def run(self):
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        self.obey(os.ttyname(theirs))
        data = b""
        while not self.gone:
            data += os.read(ours, 4096)
            while len(data) >= 10:
                if data[0] == 1 and len(data) >= 26:
                    self.setup, data = data[:26], data[26:]
                    self.log(-1, *self.setup)
                elif data[0] == 2:
                    self.log(*struct.unpack_from("<2f", data, 2))
                    os.write(ours, self.mangle(struct.pack("<B2f", data[1], self.second, self.first)))
                    data = data[10:]
                elif data[0] == 1:
                    break
                else:
                    raise SystemExit(f"no message: {data!r}")
        os.close(theirs)
        os.close(ours)
        self.obeyed.wait()


if __name__ == "__main__":
    Board().run()
