"""What an identification model may lack: those effects of aircraft of which its motion and its outputs would show something."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..models.base import canonical
from ..models.effects import Effect
from ..models.names import parameter_names
from .effects import lacking_terms
from .effects_library import signals_of, usual_effects
from .instrument_channels import RATES

if TYPE_CHECKING:
    from .identification import IdentificationModel

STATES_OF: Mapping[str, tuple[str, ...]] = {  # what a factor of a term says, in either frame
    "alpha": ("w", "alpha"),
    "beta": ("v", "beta"),
    **{f"{rate}hat": (rate,) for rate in RATES},
}
LATERAL = ("Ix", "Iz", "Ixz", "reference.y")  # felt in roll and yaw only
LATERAL_OF_ENGINES = ("position.y", "momentum")


def effects_of(model: "IdentificationModel") -> tuple[Effect, ...]:
    """Terms that the coefficients may lack whose equations are propagated, `alpha^2 in Cm` and so on, and what else an aircraft
    lacks most often; without what is held constant, and what only instruments would feel that are no outputs."""
    moved = {name: model.translation.moved(name, model.states) for name in model.responses}
    terms = lacking_terms(model.airframe.aerodynamics.terms, moved)
    names = tuple(name for name in parameter_names(canonical(model)) if _is_felt(model, name))
    usual = usual_effects(names, moved, signals_of(canonical(model)))
    return (*(term for term in terms if not _is_constant(model, term.signals_used)), *usual)


def _is_constant(model: "IdentificationModel", factors: tuple[str, ...]) -> bool:
    """Whether one of the factors of a term does not move."""
    return any(name in model.held for factor in factors for name in STATES_OF.get(factor, (factor,)))


def _is_felt(model: "IdentificationModel", name: str) -> bool:
    """Whether the motion or an output would show another value of a parameter."""
    part, _, rest = name.partition(".")
    if part == "instruments":
        return rest.split(".")[1] in model.outputs
    lateral = name in LATERAL or (part == "engines" and name.endswith(LATERAL_OF_ENGINES))
    return not (lateral and {"p", "r"} <= set(model.held))
