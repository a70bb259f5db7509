"""The session of one participant: the present trial, answers on disk, and resuming after an interruption."""

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Self

from hapscene.errors import StudyError
from hapscene.io.files import read_bytes, refusing, write_whole
from hapscene.study.plan import PLAN_MAX_B, Plan, check_name, stimuli_sha256
from hapscene.study.results_file import MISSING, ResultsFile
from hapscene.study.trial_order import Trial, trials

__all__ = ["PLAN", "RESULTS", "Session"]

RESULTS: Final = "results.csv"
PLAN: Final = "plan.toml"


class Session:
    """The session of one participant; begins, or resumes at the next unanswered trial. Use as a context, or call
    `close`.

    The folder contains a copy of the plan, and `results.csv`, to which every answer appends a row. Only one session at
    a time can write to a folder. The order in which participants begin balances the orders of trials.

    Attributes:
        trial: the present trial; None when all are answered.
        done: number of answers.
        total: number of trials of this participant.
    """

    trial: Trial | None
    done: int
    total: int

    def __init__(self, plan: Plan, folder: str | Path, person: str) -> None:
        """Begin or resume a session.

        Args:
            plan: plan of the study.
            folder: folder for the answers; created if necessary.
            person: name of the participant; preferably a pseudonym such as P01.

        Raises:
            StudyError: the folder belongs to another plan or is in use by another session, the answers in it do not
                fit the plan, or recordings or swatches have changed since they were given.
        """
        self.plan, self.folder, self.person = plan, Path(folder), check_name("person", person)
        _keep_plan(plan, self.folder)
        self._file = ResultsFile(self.folder / RESULTS)
        try:
            self._resume()
        except BaseException:
            self.close()
            raise

    def _resume(self) -> None:
        rows, self._sha256 = self._file.rows, stimuli_sha256(self.plan)
        for row in rows if self._sha256 else ():
            if row["stimuli_sha256"] not in (MISSING, self._sha256):
                raise StudyError(
                    f"{self.folder / RESULTS}: {row['person']}, trial {row['trial']}: a recording or swatch of the "
                    "plan has changed since this answer; restore the file, or use another folder"
                )
        mine = [row for row in rows if row["person"] == self.person]
        others = {row["person"] for row in rows} - {self.person}
        self._place = _integer(mine[0], "place") if mine else len(others)
        self._trials = trials(self.plan, self.person, self._place)
        self.trial, self.done = next(self._trials, None), 0
        self.total = self.plan.trial_count
        for row in mine:
            self._replay(row)

    def answer(self, choice: int, *, latency_s: float, replays: int = 0) -> None:
        """Record the answer to the present trial; it is on disk when this returns, and `trial` is the next one.

        Args:
            choice: index of a choice of the trial.
            latency_s: response time from the end of the last interval [s].
            replays: number of repeated intervals [count].

        Raises:
            StudyError: an argument is out of range, no trial is left, or the answer could not be written.
        """
        trial = self.trial
        if trial is None:
            raise StudyError(f"{self.person} has already answered all {self.done} trials")
        if not 0 <= choice < len(trial.choices):
            raise StudyError(
                f"choice {choice} is out of range; expected 0 to {len(trial.choices) - 1} ({', '.join(trial.choices)})"
            )
        if not 0.0 <= latency_s < math.inf:
            raise StudyError(f"latency_s is {latency_s:g}; expected a finite time of at least 0 s")
        self._file.add(
            {
                **self._expected(trial),
                "choice": trial.choices[choice],
                "rating": trial.choices[choice] if trial.block.kind == "rating" else None,
                "answer": choice,
                "correct": None if trial.correct is None else int(choice == trial.correct),
                "level": trial.level,
                "stimuli_sha256": self._sha256,
                "latency_s": f"{latency_s:.3f}",
                "replays": replays,
                "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
            }
        )
        self._advance(choice, None)

    def _expected(self, trial: Trial) -> dict[str, object]:
        """The fields of a row that follow from the plan. They must be equal when a session resumes."""
        return {
            "person": self.person,
            "place": self._place,
            "channel": self.plan.channel,
            "trial": trial.number,
            "block": trial.block.name,
            "kind": trial.block.kind,
            **{f"stimulus_{number}": one.stimulus.name for number, one in enumerate(trial.intervals, 1)},
            "parameter": getattr(trial.block, "parameter", None),
            "correct_answer": trial.correct,
            "plan_sha256": self.plan.sha256,
        }

    def _advance(self, choice: int, level: float | None) -> None:
        try:
            self.trial = self._trials.send((choice, level))
        except StopIteration:
            self.trial = None
        self.done += 1

    def _replay(self, row: Mapping[str, str]) -> None:
        """Answer the present trial as recorded in a row of the file."""
        where = f"{self.folder / RESULTS}: {self.person}, trial {row['trial']}"
        if self.trial is None:
            raise StudyError(f"{where}: the plan has fewer trials; use another folder")
        for name, value in self._expected(self.trial).items():
            if row[name] != (MISSING if value is None else str(value)):
                raise StudyError(f"{where}: {name} is {row[name]!r}; the plan has {value!r}; use another folder")
        choice = _integer(row, "answer")
        if not 0 <= choice < len(self.trial.choices):
            raise StudyError(f"{where}: answer {choice} is out of range; expected 0 to {len(self.trial.choices) - 1}")
        try:
            level = None if self.trial.level is None else float(row["level"])
        except ValueError:
            raise StudyError(f"{where}: level is {row['level']!r}; expected a number") from None
        self._advance(choice, level)

    def close(self) -> None:
        """Close the results file, so that another session can use the folder."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _keep_plan(plan: Plan, folder: Path) -> None:
    """Create the folder and copy the plan into it; refuse a folder of another plan."""
    path = folder / PLAN
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as reason:
        raise StudyError(f"{folder}: cannot be created: {reason.strerror}") from None
    if not path.exists():
        if (folder / RESULTS).exists():
            raise StudyError(f"{folder}: has answers but no {PLAN}; use another folder")
        write_whole(path, plan.content, StudyError)
    with refusing(StudyError):
        if read_bytes(path, PLAN_MAX_B, "plan of a study") != plan.content:
            raise StudyError(f"{folder}: belongs to another plan, {path}; use that plan, or another folder")


def _integer(row: Mapping[str, str], name: str) -> int:
    try:
        return int(row[name])
    except ValueError:
        raise StudyError(f"{RESULTS}: trial {row['trial']}: {name} is {row[name]!r}; expected an integer") from None
