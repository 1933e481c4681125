"""Requirements on an input, and their checks."""
