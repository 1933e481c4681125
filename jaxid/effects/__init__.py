"""Effects that a model may lack: the abstract `Effect`, the general library, and `Augmented`."""

from .._foundation.location import Location, LocationKind
from .actuator import (
    CommonInputRateLimit,
    InputDeadZone,
    InputHysteresis,
    InputPositionLimit,
    InputRateLimit,
)
from .augmented import Augmented
from .base import Effect
from .card import EffectCard
from .dynamics import Hysteresis, LaggedSignal, Resonance
from .equation import DryFriction, QuadraticDrag, StateLimit, Term
from .input import (
    CommonInputLag,
    InputBetweenSamples,
    InputBias,
    InputDelay,
    InputLag,
    InputScale,
)
from .library import general_effects
from .parameter import ParameterDrift, ParameterShift, ParameterStep, not_free, parameter_effects
from .placement import Placement
from .sensor import (
    SensorBias,
    SensorCrossTalk,
    SensorDelay,
    SensorDrift,
    SensorLag,
    SensorSaturation,
    SensorScale,
)
from .sensor_curve import SensorCurve
from .sensor_quantisation import SensorQuantisation
from .static_nonlinearity import DeadBand, Hinge, Saturation

__all__ = [
    "Augmented",
    "CommonInputLag",
    "CommonInputRateLimit",
    "DeadBand",
    "DryFriction",
    "Effect",
    "EffectCard",
    "Hinge",
    "Hysteresis",
    "InputBetweenSamples",
    "InputBias",
    "InputDeadZone",
    "InputDelay",
    "InputHysteresis",
    "InputLag",
    "InputPositionLimit",
    "InputRateLimit",
    "InputScale",
    "LaggedSignal",
    "Location",
    "LocationKind",
    "ParameterDrift",
    "ParameterShift",
    "ParameterStep",
    "Placement",
    "QuadraticDrag",
    "Resonance",
    "Saturation",
    "SensorBias",
    "SensorCrossTalk",
    "SensorCurve",
    "SensorDelay",
    "SensorDrift",
    "SensorLag",
    "SensorQuantisation",
    "SensorSaturation",
    "SensorScale",
    "StateLimit",
    "Term",
    "general_effects",
    "not_free",
    "parameter_effects",
]
