"""The first stage of `identify`: regressions of the responses."""
