"""JSON text of results, in which a number that is not finite is null."""

import json
import math
from typing import Any


def json_text(content: Any) -> str:
    """Return plain numbers, words, lists and dictionaries as indented JSON."""
    return json.dumps(_finite(content), indent=2)


def _finite(value: Any) -> Any:
    """Return the value with None in place of numbers that JSON cannot represent."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
