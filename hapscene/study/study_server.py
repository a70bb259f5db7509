"""The server of the page on which a person is asked: one sitting, one trial at a time.

The page is told nothing of what is compared: neither names nor levels nor blocks, nor which answer is right. It may
send anything: each field of a message is checked.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib import resources
from itertools import groupby
from threading import Event, RLock
from typing import Any, Final

from hapscene.errors import HapsceneError
from hapscene.study.plan import Plan
from hapscene.study.playing import OutputPlayer
from hapscene.study.sitting import Sitting
from hapscene.study.trial_order import Trial, trials
from hapscene.wall_clock import CLOCK, Clock
from hapscene.web.server import PageConnection, WebServer

__all__ = ["StudyServer", "practice_trials"]

GAP_S: Final = 0.4
"""Silence between the intervals of a trial [s]."""

LATENCY_MAX_S: Final = 86_400.0
"""Longest time that an answer is believed to take [s]."""

MESSAGE_MAX: Final = 1024
"""Longest message [bytes]; a page sends some fifty."""


class StudyServer:
    """Serves the page of a sitting while it is open, and plays what is asked about.

    Args:
        sitting: that is gone on with; it stays the caller's to close.
        player: what plays; the caller's, too.
        host, port: where to listen; port 0 for any that is free.
        clock: measures the silence between intervals.

    Attributes:
        url: of the page, with its token: whoever has it may answer, nobody else.
        public: whether it is served to others than this machine.
        ended: set once all is answered.
        fault: what broke: the answers so far are kept. Empty while all is well.

    Raises:
        HapsceneError: websockets is missing; the port is taken, the host not ours.
    """

    def __init__(
        self, sitting: Sitting, player: OutputPlayer, *, host: str = "127.0.0.1", port: int = 0, clock: Clock = CLOCK
    ) -> None:
        self._sitting, self._player, self._clock = sitting, player, clock
        self._practice = [] if sitting.done else practice_trials(sitting.plan)
        self._begun, self._rested, self._feedback = False, sitting.done, ""
        self._heard: dict[int, int] = {}  # of this trial: how often each interval was played to its end
        self._ready: list[Callable[[], None]] = []  # plays each interval; all are made before the first is heard
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
        self._look()

    def __enter__(self) -> "StudyServer":
        self._server.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close it, and every connection; what is played breaks off. Twice does no harm."""
        self._player.close()
        self._lane.shutdown(cancel_futures=True)
        self._server.close()

    # --- where the person is

    @property
    def _trial(self) -> Trial | None:
        """What is asked now, if the person is not elsewhere."""
        if not self._begun or self._due:
            return None
        return self._practice[0] if self._practice else self._sitting.trial

    @property
    def _due(self) -> bool:
        """Whether a break is due."""
        every, done = self._sitting.plan.break_every, self._sitting.done
        return bool(every) and done > self._rested and done % every == 0 and self._sitting.trial is not None

    def state(self) -> dict[str, Any]:
        """What the page is told."""
        plan, trial = self._sitting.plan, self._trial
        told: dict[str, Any] = {
            "title": plan.title,
            "done": self._sitting.done,
            "total": self._sitting.total,
            "felt": plan.channel != "headphones",
            "feedback": self._feedback,
            "said": self.fault,
        }
        if trial is not None:
            practising = bool(self._practice)
            return told | {
                "screen": "trial",
                "number": -len(self._practice) if practising else trial.number,
                "practice": practising,
                "question": trial.block.question,
                "choices": trial.choices,
                "ends": getattr(trial.block, "labels", None) or (),
                "kind": "rating" if trial.block.kind == "rating" else "pair",
                "intervals": ("",) if trial.block.kind == "rating" else ("1", "2"),
                "heard": sorted(self._heard),
                "playing": self._playing,
            }
        if not self._begun:
            texts = {"consent": plan.consent, "instructions": plan.instructions, "practices": len(self._practice)}
            return told | {"screen": "begin", **texts}
        return told | {"screen": "break" if self._due else "end"}

    def _look(self) -> None:
        if self._sitting.trial is None:
            self._begun = True
            self.ended.set()

    # --- what pages say

    def _join(self, page: PageConnection) -> None:
        with self._lock:
            page.send(self.state())

    def take(self, said: Any) -> None:
        """Do what a message of a page says; an invalid one has no effect."""
        with self._lock:
            if not isinstance(said, dict) or self._playing or self.fault:
                return
            try:
                self._do(said)
            except (TypeError, ValueError, LookupError, OverflowError):
                return
            except HapsceneError as error:
                self.fault = str(error)
            self._server.send(self.state())

    def _do(self, said: dict[str, Any]) -> None:
        """{"go": true}; {"play": [trial, first interval, end]}; {"answer": [trial, choice, seconds]}."""
        if said.get("go") is True:
            self._begun, self._rested = True, self._sitting.done
        trial, number = self._trial, self.state().get("number")
        if trial is None:
            return
        if "play" in said:
            asked, first, end = said["play"]
            if asked == number and type(first) is type(end) is int and 0 <= first < end <= len(trial.intervals):
                self._playing = True
                self._lane.submit(self._play, trial, range(first, end))
        if "answer" in said:
            asked, choice, latency_s = said["answer"]
            known = asked == number and type(choice) is int and 0 <= choice < len(trial.choices)
            if known and len(self._heard) == len(trial.intervals) and 0.0 <= float(latency_s) <= LATENCY_MAX_S:
                self._answer(trial, choice, float(latency_s))

    def _answer(self, trial: Trial, choice: int, latency_s: float) -> None:
        replays = sum(self._heard.values()) - len(trial.intervals)
        self._heard, self._ready, self._feedback = {}, [], ""
        if self._practice:
            self._practice.pop(0)
            if trial.correct is not None:
                right = trial.choices[trial.correct]
                self._feedback = "That was right." if choice == trial.correct else f"It was the other one: {right}."
            return
        self._sitting.answer(choice, latency_s=latency_s, replays=replays)
        self._look()

    # --- what is played

    def _play(self, trial: Trial, which: range) -> None:
        """Play some intervals of a trial, one after the other, and tell the pages.

        What a stimulus takes to be made is in no silence between two: it would tell which is which.
        """
        try:
            self._ready = self._ready or [self._player.ready(interval) for interval in trial.intervals]
            for place in which:
                if place > which.start:
                    self._clock.sleep_s(GAP_S)
                self._server.send({"plays": place})
                self._ready[place]()
                with self._lock:
                    self._heard[place] = self._heard.get(place, 0) + 1
        except HapsceneError as error:
            self.fault = str(error)
        except Exception as error:  # a fault of ours: it is told, and nothing more is asked
            self.fault = f"{type(error).__name__}: {error}"
        with self._lock:
            self._playing = False
            self._server.send(self.state())


def practice_trials(plan: Plan) -> list[Trial]:
    """The first trials of each block, in an order and with noise that no participant has."""
    if not plan.practice:
        return []
    found, answers = list[Trial](), trials(plan, "practice", 0)
    trial = next(answers, None)
    while trial is not None:
        found.append(trial)
        try:
            trial = answers.send((trial.correct or 0, None))
        except StopIteration:
            trial = None
    return [one for _, own in groupby(found, lambda trial: trial.block.name) for one in list(own)[: plan.practice]]
