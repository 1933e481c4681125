"""Effects of the truth that are computed without the library; their names are the library's."""

import dataclasses
from collections.abc import Sequence

from jaxid.effects.base import Effect


class TruthEffect:
    """An effect that only the truth has.

    Attributes:
        name: name that the library would give it.
        gain: its size.
    """

    name: str
    gain: float

    @property
    def card(self) -> "TruthEffect":
        """The effect itself, which has the family of a card."""
        return self

    @property
    def family(self) -> str:
        """Family that the library would give it: its name."""
        return self.name


@dataclasses.dataclass(frozen=True)
class SensorSquare(TruthEffect):
    """A curved sensor: `y -> y + gain y^2`, gain [1/unit of y]."""

    channel: str
    gain: float

    @property
    def name(self):
        return f"curvature of {self.channel}"


@dataclasses.dataclass(frozen=True)
class SensorAbsolute(TruthEffect):
    """A sensor with another slope on either side of zero: `y -> y + gain |y|`."""

    channel: str
    gain: float

    @property
    def name(self):
        return f"asymmetry of {self.channel}"


@dataclasses.dataclass(frozen=True)
class MassStep(TruthEffect):
    """A mass that steps: the rate of a state is divided by `1 + gain` after a time [s]."""

    state: str
    gain: float
    time: float

    @property
    def name(self):
        return f"step of mass of {self.state}"


@dataclasses.dataclass(frozen=True)
class HeightDependence(TruthEffect):
    """Change of a coefficient with height: `C += gain (exp(-climb/scale) - 1)`.

    `climb` is the height above the first sample [m], `scale` a length [m].
    """

    coefficient: str
    gain: float
    scale: float

    @property
    def name(self):
        return f"ground effect in {self.coefficient}"


@dataclasses.dataclass(frozen=True)
class Joint(TruthEffect):
    """Several effects that count as one: all surfaces with one lag, or one rate limit."""

    name: str
    parts: Sequence[Effect]
    gain: float = 1.0
