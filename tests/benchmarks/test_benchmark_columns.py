"""The benchmark of all columns compares two different methods."""

from benchmarks.columns import METHODS


def test_methods_are_linearised_steps_and_forward_mode():
    linearised, forward = METHODS.values()
    assert linearised.linearised
    assert not forward.linearised
