"""Time of a block of texture in the tick, alive and warped, against plain ones here or in another checkout.

    python -m hapscene_benchmarks.texture_tick [CHECKOUT] [--rounds N]

Each round times every case once, one checkout after the other, so that what else the machine does meets all alike.
Ratios are of each time to that of the first checkout's order 40 in the same round.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

import numpy as np

TICKS: Final = 5000
HERE: Final = Path(__file__).resolve()


def cases() -> dict[str, Any]:
    """Textures by name; those that this checkout of hapscene cannot make are left out."""
    from hapscene.dsp.ar_filter import ar_from_reflection
    from hapscene.surface.texture import Texture

    found, rng = {}, np.random.default_rng(0)
    force, speed = (grid.ravel() for grid in np.meshgrid([0.5, 1.0, 2.0], [0.05, 0.1, 0.2]))
    kinds: dict[str, dict[str, Any]] = {"order 40": {}, "order 28": {}, "order 52": {}}
    if "life" in Texture.__dataclass_fields__:
        from hapscene.surface.life import Life

        life = Life(np.full(2, 0.3), np.full(2, 20.0), np.full(2, 100.0))
        kinds |= {"order 40, alive": {"life": life}, "order 28, warped": {"warp": 0.75}}
        kinds["order 28, warped, alive"] = {"life": life, "warp": 0.75}
    for models, at_N, at_m_s in (("one filter", force[-1:], speed[-1:]), ("nine models", force, speed)):
        for kind, fields in kinds.items():
            a = ar_from_reflection(rng.uniform(-0.4, 0.4, (len(at_N), int(kind[6:8]))))
            made = Texture.from_models(1e4, at_N, at_m_s, a=a, variance_m2_s4=np.ones(len(a)), **fields)
            found[f"{models}, {kind}"] = made
    return found


def serve() -> None:
    """Tell the names of the cases, then for each name read the time of a tick of it [µs]."""
    from numba import njit

    from hapscene.dsp.noise import seeded_state
    from hapscene.records import OUTPUT, TOUCH
    from hapscene.surface.effect_compile import call_effect, compile_effect
    from hapscene.surface.effect_registry import load_effect
    from hapscene.surface.swatch import Swatch

    effect = load_effect("lpc_texture")
    rows = np.zeros(TICKS, TOUCH)
    rows["tick_s"], rows["rate_Hz"], rows["block"], rows["touching"] = 1e-3, 1e4, 10, 1
    t_s = 1e-3 * np.arange(TICKS)
    rows["force_N"], rows["slip_m_s"] = 1.0 + 0.8 * np.sin(7.0 * t_s), 0.1 + 0.08 * np.sin(11.0 * t_s)

    @njit
    def play(address: Any, p: Any, table: Any, s: Any, out: Any) -> None:
        for i in range(len(rows)):
            call_effect(address, rows[i], p, 0, table, s, 0, out)

    ready = {}
    for name, texture in cases().items():
        p, s = np.zeros(1, effect.param_dtype), np.zeros(1, effect.state_dtype)
        for param in effect.params:
            p[param.name] = param.default
        s["rng"] = seeded_state(0, effect.name)
        assert effect.table is not None
        table = effect.table(Swatch("timed", texture=texture), 1e4)
        ready[name] = p.view(np.uint8), table, s.view(np.uint8), np.zeros(1, OUTPUT)[0]
    address = compile_effect(effect)
    print(";".join(ready), flush=True)
    for line in sys.stdin:
        start_s = time.perf_counter()
        play(address, *ready[line.strip()])
        print(1e6 * (time.perf_counter() - start_s) / TICKS, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", nargs="?", type=Path)
    parser.add_argument("--rounds", type=int, default=100)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        return serve()
    asked: list[tuple[Any, str, str]] = []
    found: dict[tuple[str, str], list[float]] = {}
    with tempfile.TemporaryDirectory() as links:
        for where in filter(None, (options.checkout, HERE.parents[1])):
            path = Path(links) / str(len(asked))
            path.mkdir()
            (path / "hapscene").symlink_to(where.resolve() / "hapscene")
            (path / "hapscene_plugins").symlink_to(where.resolve() / "plugins")
            served = subprocess.Popen(
                [sys.executable, str(HERE), "--serve"], env=os.environ | {"PYTHONPATH": str(path)},
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            )  # fmt: skip
            asked += [(served, where.name, name) for name in _answer(served).split(";")]
        for _ in range(options.rounds):
            for served, where_name, name in asked:
                found.setdefault((where_name, name), []).append(float(_answer(served, name)))
    base = np.array(next(iter(found.values())))
    for (where_name, name), times in found.items():
        ratio = np.median(np.array(times) / base)
        print(f"{where_name:12} {name:36} {np.median(times):6.2f} µs  least {min(times):6.2f}  ratio {ratio:.2f}")


def _answer(served: "subprocess.Popen[str]", asked: str = "") -> str:
    assert served.stdin is not None and served.stdout is not None
    if asked:
        served.stdin.write(asked + "\n")
        served.stdin.flush()
    return served.stdout.readline().strip()


if __name__ == "__main__":
    main()
