"""What the page's server complains of, on the terminal: one line for each kind, and at the end how often it came.

Whoever reaches the port can make a server complain as often as he likes, in words of his choice: so only our own words
are printed, and each once.
"""

import logging
import sys
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

KINDS_MAX: Final = 20
"""How many kinds are told apart [count]: what is complained of is ours to word, but not all of it is ours."""


class CountedLog(logging.Handler):
    """A handler for loggers, and for an event loop; thread-safe, as handlers are.

    Attributes:
        logger: writes here, and is known to nobody else.
        counts: how often each kind came.
    """

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.counts: Counter[str] = Counter()
        self.logger = logging.Logger("hapscene.paint")
        self.logger.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """A line for what is new. Of others' records only the template: what is put into it may be from outside."""
        kind = str(record.msg).partition("\n")[0]
        if record.exc_info and record.exc_info[1] is not None:
            kind += f": {_place(record.exc_info[1])}"
        if kind not in self.counts and len(self.counts) >= KINDS_MAX:
            kind = "something else went wrong"
        self.counts[kind] += 1
        if self.counts[kind] == 1:
            _print(kind)

    def note_loop(self, loop: Any, context: dict[str, Any]) -> None:
        """What an event loop calls where nobody caught an error."""
        error = context.get("exception")
        self.logger.error(context["message"], exc_info=error)

    def close(self) -> None:
        """Say how often what came more than once."""
        for kind, count in self.counts.items():
            if count > 1:
                _print(f"{count} times: {kind}")
        self.counts.clear()
        super().close()


def _place(error: BaseException) -> str:
    """What an error is and where it comes from, without its words."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    where = f" in {Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno}" if trace is not None else ""
    return f"{type(error).__name__}{where}"


def _print(text: str) -> None:
    with suppress(OSError, ValueError):  # the terminal is gone
        print(f"hapscene: note: {text}", file=sys.stderr, flush=True)
