"""`AbstractWrapper`: a model around another one."""

from typing import ClassVar

from equinox import AbstractVar

from .._foundation.types import Array, Float
from .base import AbstractModel


class AbstractWrapper(AbstractModel):
    """A model around another one; it has the parameters and hooks of the model inside, except for
    hooks that it defines itself.

    Attributes:
        model: the model inside. The names of its parameters stay as they are.
    """

    model: AbstractVar[AbstractModel]
    transparent: ClassVar[tuple[str, ...]] = ("model",)

    def __getattr__(self, name: str):
        """A field or method that only the model inside has, such as a parameter."""
        # also where a property of this class fails, whose name the model inside has too
        if name.startswith("__") or name == "model" or hasattr(type(self), name):
            raise AttributeError(name)
        return getattr(self.model, name)

    def initial_state(self, record):
        return self.model.initial_state(record)

    def signals(self, t, x, u):
        return self.model.signals(t, x, u)

    def input_signal(self, path):
        return self.model.input_signal(path)

    def observe(self, t, y):
        return self.model.observe(t, y)

    def effects(self):
        return self.model.effects()

    def equations(self):
        return self.model.equations()

    def equations_with_terms(self):
        return self.model.equations_with_terms()

    def actuated(self):
        return self.model.actuated()

    def prepared(self, record):
        return self.model.prepared(record)

    def pseudo_measurements(self, record):
        return self.model.pseudo_measurements(record)

    def weak_measurements(self, record):
        return self.model.weak_measurements(record)

    def sensor_errors(self):
        return self.model.sensor_errors()

    def corrected(self, record):
        return self.model.corrected(record)

    def usual_ranges(self):
        return self.model.usual_ranges()

    def scales(self):
        return self.model.scales()

    def units(self):
        return self.model.units()


def observed_sample(
    model: AbstractModel, t: Float[Array, ""], y: Float[Array, " output"]
) -> Float[Array, " output"]:
    """Return the outputs of one sample with the errors of its sensors, which have no memory.

    Args:
        model: the model, whose `observe` acts on each sample alone.
        t: time of the sample [s].
        y: outputs of perfect instruments.
    """
    row = y[None]
    observed = model.observe(t[None], row)
    return y if observed is row else observed[0]
