"""`Location`: the part of a model in which an effect or a disturbance acts."""

import enum
from typing import NamedTuple


class LocationKind(enum.Enum):
    """Kind of the part of a model."""

    EQUATION = "equation"
    COEFFICIENT = "coefficient"
    INPUT = "input"
    SENSOR = "sensor"
    PARAMETER = "parameter"
    AIR = "air"
    MODEL = "model"

    @property
    def label(self) -> str:
        """Word for the kind in tables of a residual, where a sensor is called by its output."""
        return "output" if self is LocationKind.SENSOR else self.value


class Location(NamedTuple):
    """Part of a model in which something acts.

    Attributes:
        kind: of the part.
        name: of the state whose equation it is, of the coefficient, channel or parameter, or of
            what moves in the air; empty for the model as a whole.
    """

    kind: LocationKind
    name: str

    @property
    def label(self) -> str:
        """Words for tables of a residual: `equation v`, `input u`, `output y`."""
        return f"{self.kind.label} {self.name}".rstrip()

    def __str__(self) -> str:
        """Words in a sentence: `equation of v`, `input u`, `sensor y`, `model`."""
        of = " of" if self.kind is LocationKind.EQUATION else ""
        return f"{self.kind.value}{of} {self.name}".rstrip()
