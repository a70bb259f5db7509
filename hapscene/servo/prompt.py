"""Being woken on time, as far as the system lets a thread ask for it."""

import ctypes
import os
import sys
from typing import Final

from hapscene.native import INTERPRETED

_PR_SET_TIMERSLACK: Final = 29

SLACK_NS: Final = 1
"""How much later than asked the system may wake the thread so as to wake others with it [ns]: 50,000 by default."""

PRIORITY: Final = 1
"""Least of the real-time priorities [1]: before all that is not real-time, behind sound and interrupts."""


def be_prompt() -> bool:
    """Have the calling thread woken promptly; whether it then runs before all that is not real-time.

    Real-time priority is given to root, to who has CAP_SYS_NICE, and where `ulimit -r` is not 0; without it the thread
    waits for its turn among the others. On Linux only: elsewhere nothing is changed.
    """
    if sys.platform != "linux":
        return False
    ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(SLACK_NS))
    if INTERPRETED:  # holds Python's lock and never sleeps: nothing may have to wait for that
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return False
    return True
