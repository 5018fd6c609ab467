"""Rates of a trust sweep with their 95 % intervals, by kind and overall, as numbers and as tables."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence

from dqreg.compare.proportions import interval, interval_words, share_words
from dqreg.compare.trust.sweep import TrustSweep
from dqreg.compare.trust.trial import Trial
from dqreg.report.table import Column, Table

# Codes and wrong accepts shown in the tables; the JSON has all.
SHOWN_CODES, SHOWN_WRONG = 4, 200
ALL_GOOD, ALL_WRONG = "all good tasks", "all wrong poses"


@dataclasses.dataclass(frozen=True)
class Rate:
    """How often the verdict on one kind of task was right."""

    kind: str
    group: str
    good: bool
    words: str
    tasks: int
    right: int  # Poses that came out right
    accepted_right: int
    accepted_wrong: int
    errors: int  # Tasks that raised, crashed or took too long
    # Of a good kind the fraction accepted with a right pose; of a bad one the fraction accepted of the wrong poses
    rate: float
    low: float  # 95 % interval, Clopper and Pearson
    high: float
    seconds: float  # Mean time of a task
    codes: dict[str, int]  # How many verdicts each code stands in, of those that were not accepted
    rivals: int  # Tasks with equally good poses, and how many of them named one
    named: int

    @property
    def counted(self) -> tuple[int, int]:
        """Of what the rate is the share: how many, of how many."""
        return (self.accepted_right, self.tasks) if self.good else (self.accepted_wrong, self.tasks - self.right)


def rates(sweep: TrustSweep) -> list[Rate]:
    """A rate for each kind, and the two totals at the end."""
    made = [
        _rate(kind.name, kind.group, kind.good, kind.words, [one for one in sweep.trials if one.kind == kind.name])
        for kind in sweep.kinds
    ]
    good = [one for one in sweep.trials if one.good]
    if good:
        made.append(_rate(ALL_GOOD, "good", True, "accepted with the right pose", good))
    # A wrong pose is a wrong pose, whatever the task was.
    made.append(_rate(ALL_WRONG, "bad", False, "accepted though the pose is wrong", list(sweep.trials)))
    return made


def _rate(kind: str, group: str, good: bool, words: str, trials: Sequence[Trial]) -> Rate:
    right = sum(one.right for one in trials)
    accepted_right = sum(one.right and one.level == "accepted" for one in trials)
    accepted_wrong = sum(one.wrong_accept for one in trials)
    count, total = (accepted_right, len(trials)) if good else (accepted_wrong, len(trials) - right)
    low, high = interval(count, total) if total else (float("nan"),) * 2
    refused = [one for one in trials if one.level != "accepted"]
    codes = Counter(code for one in refused for code in set(one.codes))
    return Rate(
        kind=kind,
        group=group,
        good=good,
        words=words,
        tasks=len(trials),
        right=right,
        accepted_right=accepted_right,
        accepted_wrong=accepted_wrong,
        errors=sum(one.level == "error" for one in trials),
        rate=count / total if total else float("nan"),
        low=low,
        high=high,
        seconds=sum(one.seconds for one in trials) / max(len(trials), 1),
        codes=dict(codes.most_common()),
        rivals=sum(one.named is not None for one in trials),
        named=sum(bool(one.named) for one in trials),
    )


def tables(sweep: TrustSweep) -> list[Table]:
    """Good kinds, bad kinds, and every wrong pose that was accepted."""
    made = rates(sweep)
    titles = {
        True: "Good tasks: the right pose ought to be accepted",
        False: "Bad tasks: no wrong pose may be accepted",
    }
    found = [_kinds(title, [rate for rate in made if rate.good is good], good=good) for good, title in titles.items()]
    wrong = [one for one in sweep.trials if one.wrong_accept]
    if wrong:
        found.append(_wrong(wrong))
    refused = [one for one in sweep.trials if one.good and not (one.right and one.level == "accepted")]
    if refused:
        found.append(_refused(refused))
    return [table for table in found if table.rows]


def _kinds(title: str, chosen: Sequence[Rate], *, good: bool) -> Table:
    numbers = ("tasks", "right pose", "accepted, right", "accepted, wrong", "errors")
    columns = (
        Column("kind", align="left"),
        *(
            Column(name, align="right")
            for name in (*numbers, "accepted" if good else "wrongly accepted", "95 % interval", "s")
        ),
        Column("refused for", align="left", wraps=True),
        Column("what", align="left", wraps=True),
    )
    rows = tuple(
        (
            rate.kind,
            rate.tasks,
            rate.right,
            rate.accepted_right,
            rate.accepted_wrong,
            rate.errors,
            percent(rate.rate),
            interval_words(*rate.counted) if rate.counted[1] else "-",
            f"{rate.seconds:.1f}",
            ", ".join(f"{code} {count}" for code, count in list(rate.codes.items())[:SHOWN_CODES]),
            rate.words + (f"; rivals named {share_words(rate.named, rate.rivals)}" if rate.rivals else ""),
        )
        for rate in chosen
    )
    note = (
        "Accepted: of all tasks, with a pose that is right. 95 % interval: Clopper and Pearson."
        if good
        else "Wrongly accepted: of the tasks whose pose did not come out right."
    )
    return Table("good" if good else "bad", title, columns, rows, note)


def _wrong(trials: Sequence[Trial]) -> Table:
    columns = (Column("kind", align="left"), Column("seed", align="right"), Column("error", align="right"),
               Column("repeat it", align="left"), Column("reason", align="left", wraps=True))  # fmt: skip
    rows = tuple((one.kind, one.seed, f"{one.error:.3g}", command(one), one.reason) for one in trials[:SHOWN_WRONG])
    note = "Error: worst displacement in diagonals of the part, of a drive in metres; none where no pose is right."
    return Table("accepted-wrong", f"Wrong poses that were accepted: {len(trials)}", columns, rows, note)


def _refused(trials: Sequence[Trial]) -> Table:
    columns = (Column("kind", align="left"), Column("seed", align="right"), Column("pose", align="left"),
               Column("error", align="right"), Column("codes", align="left", wraps=True),
               Column("repeat it", align="left"))  # fmt: skip
    rows = tuple(
        (one.kind, one.seed, "right" if one.right else "wrong", f"{one.error:.3g}", ", ".join(one.codes), command(one))
        for one in trials[:SHOWN_WRONG]
    )
    return Table("good-refused", f"Good tasks that were not accepted: {len(trials)}", columns, rows)


def command(one: Trial) -> str:
    """The command that carries out one trial alone."""
    return f"dqreg compare --sweep trust --kinds {one.kind} --first-seed {one.seed} --seeds 1"


def percent(value: float) -> str:
    """A fraction in percent.

    >>> percent(0.0123), percent(float("nan"))
    ('1.2 %', '-')
    """
    return "-" if value != value else f"{100.0 * value:.3g} %" if value < 0.001 else f"{100.0 * value:.1f} %"
