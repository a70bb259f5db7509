"""Worker process of `against`: runs a path over a mesh for each input line, and prints the times.

It imports hapscene from the checkout in PYTHONPATH and therefore uses only the public interface.
"""

import json
import sys
import time

import numpy as np

import hapscene


def main() -> None:
    scene = hapscene.Scene()
    scene.add(sys.argv[1], name="body", unit="m", swatch="wood")
    path = np.load(sys.argv[2])
    renderer = hapscene.Renderer(scene)
    for _ in sys.stdin:
        renderer.reset(path[0])
        recording = renderer.run(path)
        on = recording.touching
        renderer.reset(path[0])
        step_ns = np.zeros(len(path))
        for k, place in enumerate(path):
            start_ns = time.perf_counter_ns()
            renderer.step(place)
            step_ns[k] = time.perf_counter_ns() - start_ns
        times = {"tick": float(np.median(recording.tick_ns[on])), "step": float(np.median(step_ns[on]))}
        print(json.dumps({name: 1e-3 * ns for name, ns in times.items()}), flush=True)


if __name__ == "__main__":
    main()
