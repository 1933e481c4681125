"""Complete workflows: model completion, identification, instrument consistency."""

from .close_loop import close_loop
from .consistency import consistency
from .consistency_result import Consistency
from .identification import Identification
from .identify import identify
from .identify_options import LONG_RECORDS, IdentifyOptions
from .next_record import next_record, separating_input
from .options import LoopOptions
from .outcome import Outcome
from .rivals import discrimination
from .rounds import Alternative, Decision
from .study import Study

__all__ = [
    "LONG_RECORDS",
    "Alternative",
    "Consistency",
    "Decision",
    "Identification",
    "IdentifyOptions",
    "LoopOptions",
    "Outcome",
    "Study",
    "close_loop",
    "consistency",
    "discrimination",
    "identify",
    "next_record",
    "separating_input",
]
