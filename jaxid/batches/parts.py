"""The share of a batch that one of several processes computes: whole files of the store."""

from typing import NamedTuple

import numpy as np

from .._foundation.checks import InputError, require

CASES_PER_FILE = 256  # largest number of cases in a file of a variable; chosen


class Part(NamedTuple):
    """One of several parts of a batch.

    Attributes:
        number: of this part, from zero.
        count: number of parts.
    """

    number: int
    count: int

    @classmethod
    def of(cls, given: tuple[int, int] | None) -> "Part":
        """Return a checked part; the whole batch for None."""
        part = cls(0, 1) if given is None else cls(*given)
        require(
            part.count >= 1 and 0 <= part.number < part.count,
            f"`part` is {tuple(part)}. Give the number of this process, from zero, and the number "
            "of processes, such as (0, 4).",
        )
        return part

    @classmethod
    def read(cls, text: str) -> "Part":
        """Return the part that a text such as `0/4` names."""
        number, _, count = text.partition("/")
        if not (number.isdecimal() and count.isdecimal()):
            raise InputError(
                f"The part is {text!r}. Give the number of this process, from zero, and the number "
                "of processes, such as 0/4."
            )
        return cls.of((int(number), int(count)))

    def files(self, cases: int, rows: int) -> np.ndarray:
        """Return the numbers of the files of this part.

        Args:
            cases: number of cases of the batch.
            rows: cases in a file.
        """
        return np.arange(self.number, -(-cases // rows), self.count)

    def cases(self, cases: int, rows: int) -> np.ndarray:
        """Return the indices of the cases of this part; the arguments are those of `files`."""
        indices = np.arange(cases)
        return indices[np.isin(indices // rows, self.files(cases, rows))]

    def rows(self, cases: int) -> int:
        """Return the number of cases in a file, with which all parts have as many files."""
        rounds = -(-cases // (self.count * CASES_PER_FILE))
        return -(-cases // (self.count * rounds))
