"""Complete workflows: model completion, identification, instrument consistency."""

from ..loop import LoopOptions, Outcome
from ..loop.evidence import Decision
from .close_loop import close_loop
from .consistency import consistency
from .consistency_result import Consistency
from .identification import Identification
from .identify import identify
from .identify_options import LONG_RECORDS, IdentifyOptions
from .many.close_loop_many import close_loop_many
from .many.studies import Studies, StudyResult
from .next_record import next_record, separating_input
from .record_checks.advice import advice
from .record_checks.findings import Advice, Excitation, Finding, FindingKind
from .rivals import discrimination
from .rounds import Alternative, Candidate, Round
from .second_opinion import Refusal, SecondOpinion
from .study import Study

__all__ = [
    "LONG_RECORDS",
    "Advice",
    "Alternative",
    "Candidate",
    "Consistency",
    "Decision",
    "Excitation",
    "Finding",
    "FindingKind",
    "Identification",
    "IdentifyOptions",
    "LoopOptions",
    "Outcome",
    "Refusal",
    "Round",
    "SecondOpinion",
    "Studies",
    "Study",
    "StudyResult",
    "advice",
    "close_loop",
    "close_loop_many",
    "consistency",
    "discrimination",
    "identify",
    "next_record",
    "separating_input",
]
