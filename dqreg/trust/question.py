"""A question of the verdict: its figure and limit, whether they speak against a pose, and what is said then."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator

from dqreg.trust.evidence import Evidence
from dqreg.trust.records import Check, Code, Reason, Relation, Unit

Figures = Callable[[Evidence], tuple[float, float]]
Sentences = Callable[[Evidence], Iterator[str]]


@dataclasses.dataclass(frozen=True)
class Question:
    """One row of the verdict: doubt and check follow from it, so that they cannot part."""

    code: Code
    words: str  # What is asked
    relation: Relation  # How a figure that passes stands to its limit
    unit: Unit
    figures: Figures  # Figure and limit; where the figure is NaN it was not asked for
    sentences: Sentences  # What is said where the figure does not pass: one or several
    must_be_known: bool = False  # A figure, or a limit, of NaN does not pass
    yes_or_no: bool = False  # The figure is 0 for yes, and is not shown
    instead: Question | None = None  # Asked in place of it where that has a figure

    def doubts(self, evidence: Evidence) -> Iterator[Reason]:
        """What speaks against the pose."""
        asked, value, limit = self._asked(evidence)
        if asked._is_against(value, limit):
            for sentence in asked.sentences(evidence):
                yield Reason(sentence, asked.code)

    def check(self, evidence: Evidence) -> Check:
        """The question with its figure, whether that speaks against the pose or not."""
        asked, value, limit = self._asked(evidence)
        is_against, is_shown = asked._is_against(value, limit), math.isfinite(value) and not asked.yes_or_no
        passed = not is_against if is_against or is_shown or asked.yes_or_no else None
        shown = value if is_shown else math.nan
        return Check(asked.code, asked.words, shown, asked.relation, limit, asked.unit, passed)

    def _asked(self, evidence: Evidence) -> tuple[Question, float, float]:
        """What is asked, with figure and limit."""
        if self.instead is not None:
            value, limit = self.instead.figures(evidence)
            if not math.isnan(value):
                return self.instead, value, limit
        return self, *self.figures(evidence)

    def _is_against(self, value: float, limit: float) -> bool:
        if math.isnan(value) or math.isnan(limit):
            return self.must_be_known
        return value < limit if self.relation == "at least" else value > limit


def asks(
    code: Code,
    words: str,
    relation: Relation,
    unit: Unit,
    figures: Figures,
    *,
    must_be_known: bool = False,
    yes_or_no: bool = False,
    instead: Question | None = None,
) -> Callable[[Sentences], Question]:
    """Make the function below it, which yields the sentences, a question."""
    return lambda sentences: Question(
        code, words, relation, unit, figures, sentences, must_be_known, yes_or_no, instead
    )


def if_asked(value: float) -> float:
    """A figure that is asked for and must be known: one that is not is beyond any limit."""
    return math.inf if math.isnan(value) else value


def in_sizes(evidence: Evidence, length: float) -> float:
    """A length in sizes of the target; NaN where that has none."""
    return length / evidence.size if evidence.size > 0.0 else math.nan
