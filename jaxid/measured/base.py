"""`Declared`: a measured data set with a declared physical model and its likelihood."""

from typing import Any, NamedTuple

from ..data.datasets import DataSet
from ..estimation.likelihoods import OutputError
from ..models.base import AbstractModel
from ..models.free import Free


class Declared(NamedTuple):
    """A measured data set with its declared physical model, without effects.

    Attributes:
        data: the records with their official split.
        model: the declared model, with rough starting values.
        free: its free parameters.
        likelihood: output error, with the steps that the fastest motion of the model requires.
    """

    data: DataSet
    model: AbstractModel
    free: Free
    likelihood: OutputError

    @property
    def parts(self) -> dict[str, Any]:
        """Arguments of `close_loop` by name. All test records have the same window."""
        (window,) = set(self.data.window.values())
        arguments = {"model": self.model, "free": self.free, "likelihood": self.likelihood}
        return arguments | {"train": self.data.train, "test": self.data.test, "window": window}
