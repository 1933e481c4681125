"""Reports of a study: figures, an HTML page, and a folder of both.

This is the only package that uses matplotlib and jinja2.
"""

from .folder import (
    Written,
    require_new,
    require_writable,
    write_design,
    write_json,
    write_or_elsewhere,
    write_study,
)
from .html import html

__all__ = [
    "Written",
    "html",
    "require_new",
    "require_writable",
    "write_design",
    "write_json",
    "write_or_elsewhere",
    "write_study",
]
