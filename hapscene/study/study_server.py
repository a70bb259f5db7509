"""The page server of a study session: shows one trial at a time, plays its intervals, and records the answers.

The page receives nothing about what is compared: no names, levels or blocks, and not the correct answer. Each field
of a message from the page is checked.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from threading import Event, RLock
from typing import Final

from hapscene.errors import HapsceneError
from hapscene.io.files import Json
from hapscene.study.session import Session
from hapscene.study.stimulus import OutputPlayer
from hapscene.study.trial_order import Trial
from hapscene.wall_clock import CLOCK, Clock
from hapscene.web.server import PageConnection, WebServer

__all__ = ["StudyServer"]

GAP_S: Final = 0.4
"""Silence between the intervals of a trial [s]."""

LATENCY_MAX_S: Final = 86_400.0
"""Longest accepted response time [s]."""

MESSAGE_MAX: Final = 1024
"""Longest message from a page [bytes]; usual messages have about fifty."""


class StudyServer:
    """Serves the page of a session, and plays the intervals of its trials.

    Args:
        session: the session; the caller closes it.
        player: plays the intervals; closed with the server.
        host, port: address to listen at; port 0 selects a free one.
        clock: measures the silence between intervals.

    Attributes:
        url: address of the page, with its access token.
        public: whether other computers can reach the page.
        ended: set when all trials are answered.
        fault: message of an error that stopped the session; empty without one. The answers so far are kept.

    Raises:
        HapsceneError: websockets is not installed, or the address cannot be used.
    """

    def __init__(
        self, session: Session, player: OutputPlayer, *, host: str = "127.0.0.1", port: int = 0, clock: Clock = CLOCK
    ) -> None:
        self._session, self._player, self._clock = session, player, clock
        self._begun = False
        self._played: dict[int, int] = {}  # how often each interval of this trial was played completely
        self._ready: list[Callable[[], None]] = []  # play functions of the intervals
        self._lock, self._lane = RLock(), ThreadPoolExecutor(1, "study")
        self._playing, self.ended, self.fault = False, Event(), ""
        self._server = WebServer(
            resources.files("hapscene.study"),
            "study_page",
            take=lambda page, message: self.take(message),
            joined=self._join,
            host=host,
            port=port,
            message_max=MESSAGE_MAX,
        )
        self.url, self.public = self._server.url, self._server.public
        self._check_end()

    def __enter__(self) -> "StudyServer":
        self._server.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop playing, and close the server and its connections. Calling it twice has no effect."""
        self._player.close()
        self._lane.shutdown(cancel_futures=True)
        self._server.close()

    # --- progress of the participant

    @property
    def _trial(self) -> Trial | None:
        """The trial on the screen; None before the start and at the end."""
        return self._session.trial if self._begun else None

    def state(self) -> dict[str, Json]:
        """The state that the page shows."""
        plan, trial = self._session.plan, self._trial
        state: dict[str, Json] = {
            "title": plan.title,
            "done": self._session.done,
            "total": self._session.total,
            "handle": plan.channel != "headphones",
            "error": self.fault,
        }
        if trial is not None:
            return state | {
                "screen": "trial",
                "number": trial.number,
                "question": trial.block.question,
                "choices": trial.choices,
                "ends": getattr(trial.block, "labels", None) or (),
                "kind": "rating" if trial.block.kind == "rating" else "pair",
                "intervals": ("",) if trial.block.kind == "rating" else ("1", "2"),
                "played": sorted(self._played),
                "playing": self._playing,
            }
        if not self._begun:
            return state | {"screen": "begin", "consent": plan.consent, "instructions": plan.instructions}
        return state | {"screen": "end"}

    def _check_end(self) -> None:
        if self._session.trial is None:
            self._begun = True
            self.ended.set()

    # --- messages from pages

    def _join(self, page: PageConnection) -> None:
        with self._lock:
            page.send(self.state())

    def take(self, message: object) -> None:
        """Process a message from a page; an invalid one has no effect."""
        with self._lock:
            if not isinstance(message, dict) or self._playing or self.fault:
                return
            try:
                self._process(message)
            except (TypeError, ValueError, LookupError, OverflowError):
                return
            except HapsceneError as error:
                self.fault = str(error)
            self._server.send(self.state())

    def _process(self, message: dict[str, Json]) -> None:
        """Process {"continue": true}, {"play": [trial, first, end]} or {"answer": [trial, choice, seconds]}."""
        if message.get("continue") is True:
            self._begun = True
        trial = self._trial
        if trial is None:
            return
        if "play" in message:
            asked, first, end = message["play"]
            if asked == trial.number and type(first) is type(end) is int and 0 <= first < end <= len(trial.intervals):
                self._playing = True
                self._lane.submit(self._play, trial, range(first, end))
        if "answer" in message:
            asked, choice, latency_s = message["answer"]
            known = asked == trial.number and type(choice) is int and 0 <= choice < len(trial.choices)
            if known and len(self._played) == len(trial.intervals) and 0.0 <= float(latency_s) <= LATENCY_MAX_S:
                self._answer(trial, choice, float(latency_s))

    def _answer(self, trial: Trial, choice: int, latency_s: float) -> None:
        replays = sum(self._played.values()) - len(trial.intervals)
        self._played, self._ready = {}, []
        self._session.answer(choice, latency_s=latency_s, replays=replays)
        self._check_end()

    # --- playing

    def _play(self, trial: Trial, which: range) -> None:
        """Play intervals of a trial one after the other, and send the progress to the pages.

        All intervals are synthesised before the first is played: otherwise the synthesis time between two would give
        away which of them takes longer.
        """
        try:
            self._ready = self._ready or [self._player.ready(interval) for interval in trial.intervals]
            for place in which:
                if place > which.start:
                    self._clock.sleep_s(GAP_S)
                self._server.send({"plays": place})
                self._ready[place]()
                with self._lock:
                    self._played[place] = self._played.get(place, 0) + 1
        except HapsceneError as error:
            self.fault = str(error)
        except Exception as error:  # a defect of the program: shown on the page, and the session stops
            self.fault = f"{type(error).__name__}: {error}"
        with self._lock:
            self._playing = False
            self._server.send(self.state())
