"""A USB bus of one device between two processes: pyusb's backend on one side, an emulator on the other.

Each transfer is one message over a Unix socket: (op, endpoint, request, value, wait_ms) and data, answered by a status
and data. The backend finds the socket's name in HAPSCENE_USB; each of its threads has a connection. As on a real bus,
one process at a time can claim the device, until it releases it or its files are closed.
"""

import ctypes
import errno
import functools
import os
import shutil
import socket
import struct
import subprocess
import tempfile
import threading
import time
from pathlib import Path

from usb.core import USBError, USBTimeoutError
from usb_device import UsbDevice

HEAD = struct.Struct("<BBBHI")
CONTROL, WRITE, READ, DESCRIBE, CONFIGURE, CLAIM, RELEASE = range(7)
OK, SILENT, GONE, REFUSED, BUSY = range(5)

claims = {}
"""Process id of each connection that has claimed the device."""


def serve(emulator, path):
    """Answer transfers for ever: `emulator` has `ids`, `kind` (2 bulk, 3 interrupt), `ends`, and does control(request,
    value), write(endpoint, data), read(endpoint, wait_s) → bytes or None."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(path)
    listener.listen()
    emulator.obey()
    while True:
        wire, _ = listener.accept()
        threading.Thread(target=_served, args=(emulator, wire), daemon=True).start()


def _served(emulator, wire):
    try:
        _answer(emulator, wire)
    except OSError:  # a driver that was killed
        pass
    finally:
        claims.pop(wire, None)


def _answer(emulator, wire):
    pid = struct.unpack("3i", wire.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))[0]
    while message := wire.recv(65536):
        op, endpoint, request, value, wait_ms = HEAD.unpack_from(message)
        status, data = OK, b""
        if emulator.gone:
            status = GONE
        elif op == DESCRIBE:
            data = struct.pack("<HHB", *emulator.ids, emulator.kind) + bytes(emulator.ends)
        elif op == CONFIGURE:
            status = REFUSED if getattr(emulator, "refused", 0.0) else OK
        elif op in (CLAIM, WRITE, READ) and any(other != pid for other in claims.values()):
            status = BUSY
        elif op == CLAIM:
            claims[wire] = pid
        elif op == RELEASE:
            claims.pop(wire, None)
        elif op == CONTROL:
            emulator.control(request, value)
        elif op == WRITE:
            emulator.write(endpoint, message[HEAD.size :])
        elif emulator.silent:
            time.sleep(wait_ms / 1000.0)
            status = SILENT
        elif (data := emulator.read(endpoint, wait_ms / 1000.0)) is None:
            status, data = SILENT, b""
        wire.send(bytes([status]) + data)


@functools.cache
def compiled_library():
    """The library that usb_wire.c makes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "libusb_wire.so"
        source = Path(__file__).with_suffix(".c")
        compiler = shutil.which("gcc") or "cc"
        subprocess.run([compiler, "-shared", "-fPIC", "-O2", "-o", str(path), str(source)], check=True)
        return ctypes.CDLL(str(path))


class Backend(UsbDevice):
    """The device at the other end."""

    ctx = handle = ctypes.c_void_p(1)

    @property
    def lib(self):
        """The transfers that do not wait, as `lib` of pyusb's backend for libusb 1.0."""
        return compiled_library()

    def __init__(self):
        self._own = threading.local()
        description = self._ask(DESCRIBE)
        *self.ids, self.kind = struct.unpack_from("<HHB", description)
        self.ends = description[5:]

    def _ask(self, op, endpoint=0, request=0, value=0, wait_ms=0, data=b""):
        try:
            if not hasattr(self._own, "wire"):
                self._own.wire = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
                self._own.wire.connect(os.environ["HAPSCENE_USB"])
            self._own.wire.send(HEAD.pack(op, endpoint, request, value, wait_ms) + data)
            answer = self._own.wire.recv(65536)
        except OSError:
            answer = b""
        if not answer or answer[0] == GONE:
            raise USBError("No such device (it may have been disconnected)", -4, 19)
        if answer[0] == SILENT:
            raise USBTimeoutError("Operation timed out", -7, 110)
        if answer[0] == REFUSED:
            raise USBError("Access denied (insufficient permissions)", -3, 13)
        if answer[0] == BUSY:
            raise USBError("Resource busy", -6, errno.EBUSY)
        return answer[1:]

    def claim_interface(self, handle, interface):
        self._ask(CLAIM)

    def release_interface(self, handle, interface):
        self._ask(RELEASE)

    def get_configuration(self, handle):
        self._ask(CONFIGURE)
        return 1

    def set_configuration(self, handle, value):
        self._ask(CONFIGURE)

    def ctrl_transfer(self, handle, kind, request, value, index, data, wait_ms):
        self._ask(CONTROL, 0, request, value)
        return 0

    def bulk_write(self, handle, ep, intf, data, wait_ms):
        self._ask(WRITE, ep, data=bytes(data))
        return len(data)

    def bulk_read(self, handle, ep, intf, buffer, wait_ms):
        data = self._ask(READ, ep, wait_ms=wait_ms)[: len(buffer)]
        buffer[: len(data)] = type(buffer)("B", data)
        return len(data)


def get_backend():
    return Backend()
