"""`hapscene warmup`."""

import argparse
import time
from typing import Any

from hapscene.command.options import add_command


def add_warmup(commands: Any) -> None:
    command = add_command(commands, "warmup", _warmup)
    command.add_argument("--quick", action="store_true", help="only what a first touch needs")


def _warmup(options: argparse.Namespace) -> int:
    """Compile beforehand, so that no first use of a feature waits.

    What is compiled is kept in the cache, whose folder is named at the end. Functions that are there are not compiled.

    for example:
      hapscene warmup
      hapscene warmup --quick
    """
    from hapscene.compiled.cache import cache_folder
    from hapscene.errors import HapsceneError
    from hapscene.native import INTERPRETED
    from hapscene.warm_up import warm_up

    if INTERPRETED:
        raise HapsceneError("NUMBA_DISABLE_JIT=1 turns compiling off: unset it to compile")
    folder = cache_folder()
    if folder is None:
        raise HapsceneError("the cache cannot be written: set NUMBA_CACHE_DIR to a folder of yours")
    start_s = time.perf_counter()
    warm_up(options.quick)
    count = sum(1 for _ in folder.glob("*.nbc"))
    print(f"{count} compiled functions in {folder}; {time.perf_counter() - start_s:.0f} s")
    return 0
