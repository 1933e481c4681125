"""Terms of `identify`: regressions, reduced structures, adaptation."""
