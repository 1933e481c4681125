"""What a measured set needs beside its records: a declared physical model and how it is simulated."""

from typing import Any, NamedTuple

from ..data.datasets import DataSet
from ..estimation.likelihoods import OutputError
from ..models.base import AbstractModel
from ..models.free import Free


class Declared(NamedTuple):
    """A measured set with the physical model that is declared for it, before any effect is added.

    Attributes:
        data: the records with their official split.
        model: the declared model, with rough starting values.
        free: its free parameters.
        likelihood: output error, with the steps that its fastest motion needs.
    """

    data: DataSet
    model: AbstractModel
    free: Free
    likelihood: OutputError

    @property
    def parts(self) -> dict[str, Any]:
        """All that `close_loop` is told of the set, by the names of its arguments; all its tests have one window."""
        (window,) = set(self.data.window.values())
        own = {"model": self.model, "free": self.free, "likelihood": self.likelihood}
        return own | {"train": self.data.train, "test": self.data.test, "window": window}
