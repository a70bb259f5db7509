"""One person's run of a plan: what is asked now, and the answer onto the disk; killed, it goes on where it was."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, Self

from hapscene.errors import StudyError, warn
from hapscene.files import read_bytes, refusing, write_whole
from hapscene.study.plan import PLAN_MAX_B, Plan, check_name, sources
from hapscene.study.results_file import MISSING, ResultsFile
from hapscene.study.trial_order import Trial, trials

RESULTS: Final = "results.csv"
PLAN: Final = "plan.toml"

PLAYED: Final = ("stimulus_1", "stimulus_2", "stimulus_3", "stimuli_sha256")
"""Columns that say what was played."""


class Sitting:
    """One person's run of a plan, as a context or until `close`: begins, or goes on at the next trial.

    The folder holds the plan, as it was, and `results.csv`, to which every answer adds a row. One sitting at a time
    writes into a folder; people follow each other, and the place at which they began balances the orders.

    Attributes:
        trial: the one to be answered now; None at the end.
        done: answers given.
        total: trials of this person; a most, where staircases may end before.
        cut_B: bytes that a killed sitting had left of a row, gone now [bytes].
    """

    trial: Trial | None
    done: int
    total: int
    cut_B: int

    def __init__(self, plan: Plan, folder: str | Path, person: str) -> None:
        """Begins, or goes on.

        Args:
            plan: the plan.
            folder: where the answers are kept; made when it is missing.
            person: their name, or better a number such as P01.

        Raises:
            StudyError: a folder of another plan, held by another sitting, whose answers do not fit the plan, or are to
                a recording or swatch that has changed.

        Warns:
            UserWarning: answers that do not say what they are to: earlier versions did not keep it.
        """
        self.plan, self.folder, self.person = plan, Path(folder), check_name("person", person)
        _check_plan(plan, self.folder)
        self._file = ResultsFile(self.folder / RESULTS)
        try:
            _keep_plan(plan, self.folder, answered=bool(self._file.rows))
            self.cut_B = self._file.cut_B
            rows = self._file.rows
            self._sources = sources(plan)
            self._check_stimuli(rows)
            mine = [row for row in rows if row["person"] == person]
            others = dict.fromkeys(row["person"] for row in rows if row["person"] != person)
            self._place = _whole(mine[0], "place") if mine else len(others)
            self._trials = trials(plan, person, self._place)
            self.trial, self.done = next(self._trials, None), 0
            self.total = sum(block.most for block in plan.blocks)
            for row in mine:
                self._replay(row)
        except BaseException:
            self.close()
            raise

    def answer(self, choice: int, *, latency_s: float, replays: int = 0) -> None:
        """Gives the answer to the trial; it is on the disk when this returns, and the next trial stands in `trial`.

        Args:
            choice: index into the trial's choices.
            latency_s: from the end of what was played to the answer [s].
            replays: how often it was played again [count].

        Raises:
            StudyError: no such choice or time, nothing is asked any more, or the answer could not be written.
        """
        trial = self.trial
        if trial is None:
            raise StudyError(f"{self.person}: all {self.done} trials are answered")
        if not 0 <= choice < len(trial.choices):
            raise StudyError(f"choice must be from 0 to {len(trial.choices) - 1} ({', '.join(trial.choices)})")
        if not 0.0 <= latency_s < math.inf:
            raise StudyError(f"latency_s must be a time in seconds, is {latency_s:g}")
        self._file.add(
            {
                **self._expected(trial),
                "choice": trial.choices[choice],
                "rating": trial.choices[choice] if trial.kind == "rating" else None,
                "answer": choice,
                "correct": None if trial.correct is None else int(choice == trial.correct),
                "level": trial.level,
                "stimuli_sha256": self._stimuli_sha256([str(one.stimulus["name"]) for one in trial.intervals]),
                "latency_s": f"{latency_s:.3f}",
                "replays": replays,
                "time": datetime.now(UTC).isoformat(timespec="milliseconds"),
            }
        )
        self._go_on(choice, None)

    def _expected(self, trial: Trial) -> dict[str, object]:
        """What a row has of the trial: what must be the same where the sitting goes on."""
        names = [interval.stimulus["name"] for interval in trial.intervals]
        blocks = {block.name: block for block in self.plan.blocks}
        return {
            "person": self.person,
            "place": self._place,
            "channel": self.plan.channel,
            "trial": trial.number,
            "block": trial.block,
            "kind": trial.kind,
            **{f"stimulus_{number}": name for number, name in enumerate(names, 1)},
            "parameter": blocks[trial.block].parameter or None,
            "correct_answer": trial.correct,
            "plan_sha256": self.plan.sha256,
        }

    def _stimuli_sha256(self, names: Sequence[str]) -> str | None:
        """Of the files that stimuli are made of, in order; None where one cannot be read."""
        found = [self._sources.get(name, "") for name in names]
        return hashlib.sha256("".join(found).encode()).hexdigest() if all(found) else None

    def _check_stimuli(self, rows: Sequence[Mapping[str, str]]) -> None:
        """What anybody was played here is what would be played now."""
        for played, row in {tuple(row[name] for name in PLAYED): row for row in rows}.items():
            names = [name for name in played[:-1] if name in self.plan.stimuli]
            now, then = self._stimuli_sha256(names), played[-1]
            if now and then == MISSING:
                said = "whether the recordings and swatches are still the same is not known"
                warn(f"{self.folder / RESULTS}: some answers do not say what was played: {said}", UserWarning)
            elif now and now != then:
                of = [str(self.plan.stimuli[name]["recording"] or self.plan.stimuli[name]["swatch"]) for name in names]
                where = f"{self.folder / RESULTS}: {row['person']}, trial {row['trial']}"
                raise StudyError(
                    f"{where}: what was played has changed since: {' or '.join(dict.fromkeys(of))}; "
                    "put back what it was, or take another folder"
                )

    def _go_on(self, choice: int, level: float | None) -> None:
        try:
            self.trial = self._trials.send((choice, level))
        except StopIteration:
            self.trial = None
        self.done += 1
        if self.trial is None:
            self.total = self.done

    def _replay(self, row: Mapping[str, str]) -> None:
        where = f"{self.folder / RESULTS}: {self.person}, trial {row['trial']}"
        if self.trial is None:
            raise StudyError(f"{where}: the plan asks no more; take another folder")
        for name, value in self._expected(self.trial).items():
            if row[name] != (MISSING if value is None else str(value)):
                raise StudyError(f"{where}: {name} is {row[name]!r}, by the plan it is {value!r}; take another folder")
        choice = _whole(row, "answer")
        if not 0 <= choice < len(self.trial.choices):
            raise StudyError(f"{where}: no choice has the index {choice}")
        try:
            level = None if self.trial.level is None else float(row["level"])
        except ValueError:
            raise StudyError(f"{where}: level must be a number, is {row['level']!r}") from None
        self._go_on(choice, level)

    def close(self) -> None:
        """Lets another sitting write into the folder."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _check_plan(plan: Plan, folder: Path) -> None:
    """The folder is there, and can be one of this plan: nothing of another is touched."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as reason:
        raise StudyError(f"{folder}: cannot be made: {reason.strerror}") from None
    path = folder / PLAN
    if path.exists() and not (folder / RESULTS).exists():
        _keep_plan(plan, folder, answered=True)


def _keep_plan(plan: Plan, folder: Path, *, answered: bool) -> None:
    """The plan is in the folder, as it was; another one is refused, once there are answers to it."""
    path = folder / PLAN
    if not answered:
        write_whole(path, plan.content, StudyError)
    if not path.exists():
        raise StudyError(f"{folder}: has answers and no {PLAN} that they are of; take another folder")
    with refusing(StudyError):
        if read_bytes(path, PLAN_MAX_B, "plan of a study") != plan.content:
            raise StudyError(f"{folder}: holds answers to another plan, {path}; give another folder, or that plan")


def _whole(row: Mapping[str, str], name: str) -> int:
    try:
        return int(row[name])
    except ValueError:
        raise StudyError(f"{RESULTS}: trial {row['trial']}: {name} must be a whole number, is {row[name]!r}") from None
