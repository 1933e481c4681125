"""The judgement of a study: is the right thing named, and nothing else?"""

import enum
from collections.abc import Collection

from jaxid.loop import Outcome

from .systems import Answer, System


class Verdict(enum.Enum):
    """Judgement of a study.

    Attributes:
        RIGHT: the right answer.
        DOUBT: the effects are found, but not called the cause; or something is called missing where
            nothing is, without a cause.
        WRONG: a wrong cause is named, or nothing is called missing where an effect is.
    """

    RIGHT = enum.auto()
    DOUBT = enum.auto()
    WRONG = enum.auto()


EXPECTED = {Answer.NOTHING: Outcome.NOTHING_MISSING, Answer.FORCES: Outcome.PROCESS_NOISE}
SILENT = (Outcome.NOTHING_MISSING, Outcome.PROCESS_NOISE, Outcome.COLOURED_NOISE)


def judge(system: System, outcome: Outcome, families: Collection[str]) -> Verdict:
    """Return the judgement of a study.

    Args:
        system: the system.
        outcome: outcome of its study.
        families: families of the effects that the study has added.
    """
    named = outcome is Outcome.EXPLAINED
    if system.answer in EXPECTED:
        right, wrong = outcome is EXPECTED[system.answer], named
    elif system.answer is Answer.NAMED:
        right = named and set(families) == system.families
        wrong = (named and not right) or outcome in SILENT
    else:
        right, wrong = not named and outcome not in SILENT, named or outcome in SILENT
    return Verdict.RIGHT if right else Verdict.WRONG if wrong else Verdict.DOUBT
