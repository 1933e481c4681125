"""Which channels an identification model has: what is propagated, measured, held, and seen."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from .._foundation.checks import require, require_known, require_unique
from .controls import SURFACES
from .identification_frames import FRAMES
from .instrument_channels import ANGULAR, FORCE, RATES
from .turbulence import GUSTS

ANGLES = ("phi", "pitch", "psi")
GROUPS = {  # section 4.2 c, and 6.2.3.1: four equations of the longitudinal motion, five of the lateral one
    "coupled": ("u", "v", "w", *RATES, *ANGLES),
    "longitudinal": ("u", "w", "q", "pitch"),
    "lateral": ("v", "p", "r", "phi", "psi"),
}
IN_AIR = {"u": "V", "v": "beta", "w": "alpha"}
BESIDE = ("thrust", "altitude", "density", *ANGULAR)  # what can be measured or held beside states and surfaces


class Channels(NamedTuple):
    """The channels of an identification model.

    Attributes:
        frame: "body" or "air path".
        states, inputs, outputs: names in order.
        measured: those of the inputs that are neither surfaces nor stand in for a state.
        held: names of what is constant.
    """

    frame: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    measured: tuple[str, ...]
    held: tuple[str, ...]

    @property
    def owner(self) -> dict[str, str]:
        """By channel of the instruments, the state whose equation it tells of; surfaces and thrust tell of none."""
        return owners(self.frame)

    @property
    def actuated(self) -> tuple[str, ...]:
        """Inputs that an actuator moves: surfaces and thrust; the others are measured in the place of a state, or the air."""
        return tuple(name for name in self.inputs if name in (*SURFACES, "thrust"))


def owners(frame: str) -> dict[str, str]:
    """By channel of the instruments, the state whose equation it tells of.

    Args:
        frame: "body" or "air path".
    """
    along, across, down = (FRAMES[frame].equation[force] for force in ("CX", "CY", "CZ"))
    translation = {"V": along, "beta": across, "alpha": down, "ax": along, "ay": across, "az": down, "az_pilot": down}
    turning = dict(zip(ANGULAR, RATES, strict=True))
    return translation | turning | {name: name for name in (*RATES, *ANGLES, "altitude")}


def arranged(
    states: str | Sequence[str],
    frame: str,
    measured: Sequence[str],
    held: Iterable[str],
    instruments: tuple[str, ...],
    outputs: Sequence[str] | None,
) -> Channels:
    """The channels that a choice of states makes, in one order whatever the order of the choice.

    Args:
        states: the name of a group, or names.
        frame: "body" or "air path".
        measured: inputs beside the surfaces and the states not propagated; velocities of the air stand behind all others.
        held: what is constant.
        instruments: channels on board.
        outputs: a selection of them; None for those that tell of a state.

    Raises:
        InputError: for a name that does not exist, one that is two things at once, an altitude that is nothing, or an output
            that shows only what is measured.
    """
    require_known("frame", [frame], FRAMES)
    translation = FRAMES[frame].names
    possible = (*translation, *RATES, *ANGLES, "altitude")
    states, measured, held = _named(states, frame), tuple(measured), tuple(held)
    for kind, names in (("state", states), ("name in `measured`", measured)):
        require_unique(kind, names)
    require_known("state", states, possible)
    require(len(states) > 0, f"No state is propagated. Name at least one of {', '.join(possible)}.")
    given = tuple(f"{name}dot" for name in RATES if name not in states)
    beside = tuple(name for name in BESIDE if name not in ANGULAR or name in given)
    require_known("input (in `measured`)", measured, (*beside, *GUSTS[:3]))
    needed = tuple(name for name in possible if name not in states and name not in ("psi", "altitude"))
    require_known("constant (in `held`)", held, (*SURFACES, *beside, *needed))
    for name in measured:
        require(
            name not in (*states, *held), f"{name!r} is measured, and a state or held at a constant too. Choose one."
        )
    require("altitude" not in states or "altitude" not in held, "The altitude is a state and held too. Choose one.")
    require(
        "altitude" in (*states, *measured, *held),
        "The altitude, which says density and speed of sound, is not known. Hold it (`held={'altitude': 3000.0}`; a constant "
        "`altitude` of a record then takes its place), measure it (`measured=('altitude',)`) or make it a state.",
    )
    inputs = (
        *(name for name in SURFACES if name not in held),
        *(name for name in BESIDE if name in measured),
        *(name for name in needed if name not in held),
        *(name for name in GUSTS[:3] if name in measured),
    )
    constant = (*held, *(name for name in given if name not in (*held, *measured)))
    states = tuple(name for name in possible if name in states)
    return Channels(frame, states, inputs, _seen(outputs, frame, states, instruments), measured, constant)


def _named(states: str | Sequence[str], frame: str) -> tuple[str, ...]:
    """The states of a group in a frame, or those that are named."""
    if not isinstance(states, str):
        return tuple(states)
    require_known("group of states", [states], GROUPS)
    names = GROUPS[states]
    return tuple(IN_AIR[name] if frame == "air path" and name in IN_AIR else name for name in names)


def _seen(
    chosen: Sequence[str] | None, frame: str, states: tuple[str, ...], instruments: tuple[str, ...]
) -> tuple[str, ...]:
    """The outputs; an accelerometer also where its velocity is not propagated, for it tells of a coefficient."""
    owner = owners(frame)
    outputs = tuple(name for name in instruments if owner.get(name) in states) if chosen is None else tuple(chosen)
    require_known("output (of the instruments)", outputs, instruments)
    require_unique("output", outputs)
    require(len(outputs) > 0, "No instrument tells of a state that is propagated, so there is nothing to fit.")
    moving = bool({*FRAMES[frame].names} & set(states))
    for name in outputs:
        along = name in ("V", "alpha", "beta") and frame == "body" and moving
        require(
            owner.get(name) in states or along or name in (*FORCE, "az_pilot"),
            f"The output {name!r} shows only what is measured, and the fit would be perfect. Leave it out of `outputs`.",
        )
    return outputs
