"""What a dynamic model is, which of its parameters are free, and which effects it may lack."""

from .acting import Acting
from .augmented import Augmented
from .base import AbstractModel
from .effects import Effect
from .effects_actuator import InputDeadZone, InputHysteresis, InputPositionLimit, InputRateLimit
from .effects_equation import DryFriction, QuadraticDrag, StateLimit, Term
from .effects_input import InputBetweenSamples, InputBias, InputDelay, InputLag, InputScale
from .effects_memory import Hysteresis, LaggedSignal, Resonance
from .effects_parameter import ParameterDrift, ParameterShift, ParameterStep, not_free, parameter_effects
from .effects_sensor import SensorBias, SensorDelay, SensorLag, SensorSaturation, SensorScale
from .effects_sensor_more import SensorCrossTalk, SensorDrift, SensorQuantisation
from .effects_shape import DeadBand, Hinge, Saturating
from .free import Free, Parameters, free, with_values
from .library import general_effects
from .linear import LinearModel
from .names import parameter_names
from .noise import DiagonalNoise, FixedNoise, FullNoise
from .polynomial import Polynomial
from .replace import polynomials_of, with_polynomials
from .table_set import TableSet
from .tables import Table, outside, require_inside

__all__ = [
    "AbstractModel",
    "Acting",
    "Augmented",
    "DeadBand",
    "DiagonalNoise",
    "DryFriction",
    "Effect",
    "FixedNoise",
    "Free",
    "FullNoise",
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
    "LinearModel",
    "ParameterDrift",
    "ParameterShift",
    "ParameterStep",
    "Parameters",
    "Polynomial",
    "QuadraticDrag",
    "Resonance",
    "Saturating",
    "SensorBias",
    "SensorCrossTalk",
    "SensorDelay",
    "SensorDrift",
    "SensorLag",
    "SensorQuantisation",
    "SensorSaturation",
    "SensorScale",
    "StateLimit",
    "Table",
    "TableSet",
    "Term",
    "free",
    "general_effects",
    "not_free",
    "outside",
    "parameter_effects",
    "parameter_names",
    "polynomials_of",
    "require_inside",
    "with_polynomials",
    "with_values",
]
