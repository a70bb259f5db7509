"""Follower and leader as processes of their own: a socket, a side, a session."""

import math
import socket
from typing import Any

from hapscene.constants import ACCELERATION_RATE_HZ
from hapscene.device.omni import Omni
from hapscene.errors import HapsceneError
from hapscene.handle.loop import new_handle
from hapscene.handle.plant import Plant
from hapscene.interrupt import interrupt_noted
from hapscene.teleoperation.coupling import Coupling
from hapscene.teleoperation.follower import new_follower
from hapscene.teleoperation.leader import new_leader
from hapscene.teleoperation.link import Impairment
from hapscene.teleoperation.operation import UP, world_of
from hapscene.teleoperation.session import Session
from hapscene.teleoperation.site import START_M, explore, plate
from hapscene.touch import speak


def run_follower(
    address: tuple[str, int],
    allowed: str,
    swatch: str,
    coupling: Coupling,
    impairment: Impairment,
    duration_s: float = math.inf,
    seed: int = 0,
) -> dict[str, Any]:
    """Touch a plate for the first leader that speaks from the host `allowed`, until it ends; returns how it went.

    Says where it listens in one line on standard output, once it is ready.

    Raises:
        HapsceneError: an address that cannot be listened at, an unknown swatch.
    """
    world = world_of(plate(swatch), seed=seed)  # owns what the follower's compiled tick looks into
    side = new_follower(world, Omni(), coupling, START_M, UP)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.bind(address)
        except OSError as reason:
            raise HapsceneError(f"{address[0]}:{address[1]}: cannot be listened at: {reason.strerror}") from None
        session = Session(side, sock, impairment=impairment, seed=seed, allowed=_resolved(allowed))
        session.rehearse()
        host, port = sock.getsockname()
        with interrupt_noted() as noted:
            speak(f"a follower listens at {host}:{port}\n")
            return session.run(duration_s, noted)


def run_leader(
    address: tuple[str, int],
    grip: str,
    compensator: str,
    coupling: Coupling,
    impairment: Impairment,
    duration_s: float = math.inf,
    seed: int = 0,
) -> dict[str, Any]:
    """Feel what a follower touches, with a simulated hand that explores over and over; returns how it went.

    Raises:
        HapsceneError: nobody follows at that address; an unknown grip or compensator.
    """
    gesture = explore(grip, coupling.stiffness_N_m)
    handle = new_handle(Plant(), Plant(), compensator, ACCELERATION_RATE_HZ, seed)
    side = new_leader(Omni(), handle, coupling, START_M, UP)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.connect(address)
        except OSError as reason:
            raise HapsceneError(f"{address[0]}:{address[1]}: cannot be reached: {reason.strerror}") from None
        session = Session(side, sock, gesture.intent, impairment, seed)
        session.rehearse()
        with interrupt_noted() as noted:
            speak(f"a leader calls {address[0]}:{address[1]}\n")
            return session.run(duration_s, noted)


def _resolved(host: str) -> str:
    """The address of a host."""
    try:
        return socket.gethostbyname(host)
    except OSError as reason:
        raise HapsceneError(f"{host}: no such host: {reason.strerror}") from None
