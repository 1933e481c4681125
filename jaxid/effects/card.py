"""`EffectCard`: facts about an effect other than its equations."""

import dataclasses
from collections.abc import Mapping
from types import MappingProxyType

from .._foundation.location import Location
from .._foundation.types import Array, Float

Bound = float | Float[Array, ""]

# Bounds of an effect that with negative gain would be another effect: a lag would be a lead.
PRESENT: Mapping[str, tuple[Bound, Bound]] = MappingProxyType({"gain": (0.0, float("inf"))})


@dataclasses.dataclass(frozen=True, kw_only=True)
class EffectCard:
    """Facts about an effect: its name, its location, and how a search treats it.

    An effect creates its card on each access, also under `jit`, where the effect's arrays are
    traced. Therefore pass an array bound without `float`, and compute no text from the value of a
    traced array. Bounds are read outside of `jit` only.

    Two defaults follow from `unit_gain`: the gain is bounded by zero and infinity unless `bounds`
    contains the gain, and `degenerate_at_bounds` contains the gain.

    Attributes:
        name: short and unique; parameters are called `name.gain`, `name.level`.
        description: the effect in the words of an engineer.
        location: where the effect acts.
        family: name without the shape. The members of a family are one effect with different
            initial shapes, and only one of them is kept; by default the name.
        unit: unit of the gain; empty if not stated.
        signals: arguments of the added term if it is a function of signals, otherwise empty.
            Effects at one location with the same signals are parts of one unknown function.
        complexity: prior complexity, used to break ties: the number of factors of a term, or 1 +
            the number of shape parameters. Among effects that predict equally well the simplest
            is preferred.
        bounds: lowest and highest physical value of the effect's parameters.
        unit_gain: true if the effect is only physical at a gain of zero or one (e.g. an actuator
            lag). A gain of two then points to another cause.
        repeatable: true if more than one member of its family can act at once: a structure has
            many modes, a sensor one delay.
        refines: family of a simpler effect that this effect describes in more detail; empty by
            default. The effect is tried while the simpler effect is in the model, replaces it, and
            starts from its values of the parameters that both have.
        delay: parameter that is a delay or a time constant [s] of an input or a sensor; empty if
            the effect is neither. A found one is compared with another course in time.
        stage: order among the effects of a model; a higher stage acts later, e.g. the saturation
            of a sensor after its scale.
        each_sample: True for an error of a sensor that acts on each sample alone, without the
            history that a delay or a drift needs, so that a Kalman filter can apply it.
        fixed: shape parameters that keep the value of `initialise_shape`; the others are estimated
            once the effect is in the model.
        by_record: parameters with one value for each record: the memory of the effect at the first
            sample. They are estimated, as the states that the effect adds, where the initial
            states of the records are free; otherwise they keep their value.
        degenerate_at_bounds: parameters at whose bounds the effect is absent or equals another
            effect, e.g. the level of a hinge without samples beyond it.
        initial_gain: gain from which a refit starts; nonzero if a small gain has no influence on
            the outputs.
    """

    name: str
    description: str
    location: Location
    family: str = ""
    unit: str = ""
    signals: tuple[str, ...] = ()
    complexity: int = 1
    bounds: Mapping[str, tuple[Bound, Bound]] = dataclasses.field(default_factory=dict)
    unit_gain: bool = False
    repeatable: bool = False
    refines: str = ""
    delay: str = ""
    stage: int = 0
    each_sample: bool = False
    fixed: tuple[str, ...] = ()
    by_record: tuple[str, ...] = ()
    degenerate_at_bounds: tuple[str, ...] = ()
    initial_gain: float = 0.0

    def __post_init__(self):
        if not self.family:
            object.__setattr__(self, "family", self.name)
        if self.unit_gain:
            object.__setattr__(self, "bounds", {**PRESENT, **self.bounds})
            gain = dict.fromkeys(("gain", *self.degenerate_at_bounds))
            object.__setattr__(self, "degenerate_at_bounds", tuple(gain))
