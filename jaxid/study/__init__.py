"""Complete workflows: model completion, identification, instrument consistency."""

from ..loop import LoopOptions, Outcome
from ..loop.evidence import Decision
from .close_loop import close_loop
from .consistency import consistency
from .consistency_result import Consistency
from .identification import Identification
from .identify import identify
from .identify_options import LONG_RECORDS, IdentifyOptions
from .rivals import discrimination
from .rounds import Alternative, Candidate, Round
from .study import Study

__all__ = [
    "LONG_RECORDS",
    "Alternative",
    "Candidate",
    "Consistency",
    "Decision",
    "Identification",
    "IdentifyOptions",
    "LoopOptions",
    "Outcome",
    "Round",
    "Study",
    "close_loop",
    "consistency",
    "discrimination",
    "identify",
]
