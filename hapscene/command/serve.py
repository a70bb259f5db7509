"""`hapscene serve`."""

import argparse
from contextlib import ExitStack
from typing import Any, Final

from hapscene.command.console import say
from hapscene.command.options import (
    HOST,
    add_command,
    add_reading_options,
    check_scene,
    loading,
    port,
    reading,
    tell_size,
)
from hapscene.interrupt import interrupt_noted

PORT: Final = 47700
"""Where engines find it unless told otherwise; in the range that nobody has registered."""


def add_serve(commands: Any) -> None:
    command = add_command(commands, "serve", _serve)
    command.add_argument("scene", metavar="SCENE", help="a scene, a mesh, or a model of MuJoCo as it starts")
    command.add_argument("--udp", type=port, default=PORT, metavar="PORT", help=f"0: any free one (default {PORT})")
    command.add_argument("--ws", type=port, metavar="PORT", help="take orders over WebSocket, too; 0: any free one")
    command.add_argument("--host", default=HOST, help=f"address to listen at (default {HOST}: this machine alone)")
    command.add_argument("--device", default="omni", metavar="NAME", help="that is held (default omni)")
    command.add_argument("--swatch", help="of a mesh that is not painted")
    add_reading_options(command)


def _serve(options: argparse.Namespace) -> int:
    """Touch for another program, over a socket: a game engine or simulator moves the bodies, and is told what happens.

    docs/bridge-protocol.md says what is sent; examples/engines has a client for each of several languages, and a page
    that tunes, paints, adds and removes bodies over WebSocket. The bodies of MODEL.xml of MuJoCo are served; their
    physics is the other program's.

    for example:
      hapscene serve cup.scene.json --ws 47701
      hapscene serve crate.stl --unit m --swatch wood --udp 47700 --device premium-1.5
    """
    check_scene(options.scene, options.unit, options.swatch)
    from hapscene.bridge.orders import Orders
    from hapscene.bridge.server import BridgeServer
    from hapscene.bridge.web_door import WebDoor
    from hapscene.servo import Servo
    from hapscene.touch import open_scene, step

    with step(say, loading(options.scene)):
        scene = open_scene(options.scene, options.unit, options.swatch, say=say, **reading(options))
    tell_size(scene, options.scene, options.device)
    with ExitStack() as stack:
        orders = Orders(servo := Servo(scene, options.device))
        server = stack.enter_context(BridgeServer(orders, options.host, options.udp))
        door = None if options.ws is None else WebDoor(server, options.host, options.ws)
        with step(say, f"starting the {options.device}"):
            stack.enter_context(servo)
        stack.enter_context(orders)
        with interrupt_noted() as noted:
            say(f"udp {server.address[0]}:{server.address[1]}   (Ctrl-C ends)\n")
            if door is not None:
                stack.enter_context(door)
                say(f"ws://{door.address[0]}:{door.address[1]}\n")
            if not server.address[0].startswith("127."):
                say("open to the network: whoever speaks first from anywhere moves what is felt\n")
            server.serve(noted)
        told = ", ".join(f"{name} {count:,}" for name, count in sorted(orders.counts.items()))
    say(f"ended; {told or 'nobody came'}\n")
    return 0
