"""A 2DIY's board on a pseudo-terminal: it answers each message at once, and holds the last torques.

Run: haply2diy.py LOG. `fault` has it answer wrongly from then on: 1 with truncated answers, 2 with NaN, 3 with a
position that jumps by centimetres.
"""

import math
import os
import struct
import tty

from emulator import Emulator


class Board(Emulator):
    def __init__(self):
        super().__init__()
        self.first, self.second = 120.0, 60.0  # angles of the two arms [°]
        self.setup = b""
        self.fault = 0.0

    def answer(self, name):
        """Return the answer to a message, damaged if a fault is set."""
        good = struct.pack("<B2f", name, self.second, self.first)
        match int(self.fault):
            case 1:
                return good[:4]
            case 2:
                return struct.pack("<B2f", name, math.nan, math.nan)
            case 3:
                return struct.pack("<B2f", name, self.second - 30.0, self.first + 30.0)
        return b"" if self.silent else self.mangle(good)

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
                    os.write(ours, self.answer(data[1]))
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
