"""What a person looks at: figures, one HTML page, and a folder of both; alone in using matplotlib and jinja2."""

from . import figures
from .folder import require_new, write_json, write_study
from .html import html

__all__ = ["figures", "html", "require_new", "write_json", "write_study"]
