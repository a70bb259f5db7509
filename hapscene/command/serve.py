"""`hapscene serve`."""

import argparse
from contextlib import ExitStack
from typing import Any, Final

from hapscene.command.console import say
from hapscene.command.options import HOST, add_command, add_reading_options, check_scene, loading, port
from hapscene.interrupt import interrupt_noted

PORT: Final = 47700
"""Where engines find it unless told otherwise; in the range that nobody has registered."""


def add_serve(commands: Any) -> None:
    command = add_command(commands, "serve", _serve)
    command.add_argument("scene", metavar="SCENE", help="a scene, or a mesh")
    command.add_argument("--udp", type=port, default=PORT, metavar="PORT", help=f"0: any free one (default {PORT})")
    command.add_argument("--host", default=HOST, help=f"address to listen at (default {HOST}: this machine alone)")
    command.add_argument("--device", default="omni", metavar="NAME", help="that is held (default omni)")
    command.add_argument("--swatch", help="of a mesh that is not painted")
    add_reading_options(command)


def _serve(options: argparse.Namespace) -> int:
    """Touch for another program, over a socket: a game engine or simulator moves the bodies, and is told what happens.

    docs/bridge-protocol.md says what is sent; examples/engines has a client for each of several languages.

    for example:
      hapscene serve cup.scene.json
      hapscene serve crate.stl --unit m --swatch wood --udp 47700 --device premium-1.5
    """
    check_scene(options.scene, options.unit, options.swatch)
    from hapscene.bridge.server import BridgeServer
    from hapscene.servo import Servo
    from hapscene.touch import open_scene, step

    with step(say, loading(options.scene)):
        scene = open_scene(options.scene, options.unit, options.swatch, say=say, accept_damaged=options.accept_damaged)
    bodies, swatches = (tuple(part.name for part in parts) for parts in (scene.bodies, scene.swatches))
    with ExitStack() as stack:
        servo = Servo(scene, options.device)
        server = stack.enter_context(BridgeServer(servo, bodies, swatches, options.host, options.udp))
        with step(say, f"starting the {options.device}"):
            stack.enter_context(servo)
        with interrupt_noted() as noted:
            say(f"udp {server.address[0]}:{server.address[1]}   (Ctrl-C ends)\n")
            if not server.address[0].startswith("127."):
                say("open to the network: whoever speaks first from anywhere moves what is felt\n")
            server.serve(noted)
        told = ", ".join(f"{name} {count:,}" for name, count in sorted(server.counts.items()))
    say(f"ended; {told or 'nobody came'}\n")
    return 0
