"""A tool pushes a weightless crate for two seconds; prints the momentum of the crate and the impulse that it received.

hapscene serve crate.stl --unit m --swatch wood
python push.py
"""

import sys
import time

from hapscene_client import Client

MASS, STEP_S = 0.2, 1 / 60
client = Client(port=int(sys.argv[1]) if len(sys.argv) > 1 else 47700)
client.order("free", body="crate", mass=MASS, inertia=[8e-5] * 3)
client.frame(bodies=[("crate", (0, 0, 0), (0, 0, 0, 1), True)])
client.order("start", p=[-0.03, 0.0, 0.0])

x = v = received = 0.0
start_s = time.monotonic()
for k in range(120):
    time.sleep(max(start_s + (k + 1) * STEP_S - time.monotonic(), 0.0))
    client.poll()
    total = client.impulse("crate")[0]
    v, received = v + (total - received) / MASS, total
    x += v * STEP_S
    client.frame(
        aim=(-0.03 + 0.05 * k * STEP_S, 0, 0), bodies=[("crate", (x, 0, 0), (0, 0, 0, 1), (v, 0, 0), (0, 0, 0))]
    )
print(f"momentum {MASS * v} received {received}")
for tick, kind, body, swatch, speed in client.events:
    print(f"{tick}, {kind}, {body}, {swatch}, {speed:.3g}")
client.close()
