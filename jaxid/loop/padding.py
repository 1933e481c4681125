"""`Padding`: parameters without effect, so that hypotheses of similar size share their programs."""

from typing import NamedTuple

import numpy as np

# Chosen: parameters of effects are padded to multiples of this, so that few widths are compiled.
# More padding costs arithmetic, less costs compilations.
COLUMN_BLOCK = 8
# The same for the initial values of states that effects add (chosen).
ROW_BLOCK = 2


class Padding(NamedTuple):
    """Numbers of parameters of a problem, and of its program, in which the padding stands last.

    Attributes:
        own: number of per-record parameters.
        own_width: the same with padding.
        shared: number of shared parameters.
        shared_width: the same with padding.
    """

    own: int
    own_width: int
    shared: int
    shared_width: int

    @classmethod
    def none(cls, own: int, shared: int) -> "Padding":
        """Return the padding of a program without any."""
        return cls(own, own, shared, shared)

    def padded_own(self, values, fill: int | float = 0) -> np.ndarray:
        """Return values of the per-record parameters, along the last axis, with padding."""
        return _filled(values, self.own_width - self.own, fill)

    def padded_shared(self, values, fill: int | float = 0) -> np.ndarray:
        """Return values of the shared parameters, along the last axis, with padding."""
        return _filled(values, self.shared_width - self.shared, fill)

    def padded_columns(self, columns) -> np.ndarray:
        """Return columns of all parameters, the per-record ones first, with columns of zeros."""
        own, shared = np.split(np.asarray(columns), [self.own], axis=-1)
        return np.concatenate([self.padded_own(own), self.padded_shared(shared)], axis=-1)


def padded_number(number: int, block: int, least: int = 1) -> int:
    """Return a number rounded up to a multiple of a block, at least `least` blocks."""
    return block * max(least, -(-number // block))


def _filled(values, number: int, fill: int | float) -> np.ndarray:
    """Return values with a number of others behind the last."""
    values = np.asarray(values)
    widths = [(0, 0)] * (values.ndim - 1) + [(0, number)]
    return np.pad(values, widths, constant_values=fill)
