"""Channels of an identification model: states, inputs, outputs and constants."""

from collections.abc import Collection, Iterable, Sequence
from typing import NamedTuple

from ..._foundation.checks import require, require_known, require_unique
from ..air.turbulence import GUSTS
from ..instruments.channels import ANGULAR, FORCE, RATES
from ..vehicle.controls import SURFACES
from ..vehicle.force_axes import FORCE_AXES, ForceAxes
from .frames import FRAMES, Translation

EULER_ANGLES = ("phi", "pitch", "psi")
# section 4.2 c, and 6.2.3.1: four equations of the longitudinal motion, five of the lateral one
STATE_GROUPS = {
    "coupled": ("u", "v", "w", *RATES, *EULER_ANGLES),
    "longitudinal": ("u", "w", "q", "pitch"),
    "lateral": ("v", "p", "r", "phi", "psi"),
}
LATERAL_STATES = ("v", "p", "r", "beta")  # in either frame
AIR_PATH_STATES = {"u": "V", "v": "beta", "w": "alpha"}
# signals other than states and surfaces that can be measured or held
OTHER_SIGNALS = ("thrust", "altitude", "density", "sound_speed", *ANGULAR)
MOMENT_STATES = dict(zip(("Cl", "Cm", "Cn"), RATES, strict=True))


class Choice(NamedTuple):
    """Names of states, measured inputs and outputs, as `IdentificationModel` takes them."""

    states: tuple[str, ...]
    measured: tuple[str, ...]
    outputs: tuple[str, ...]


class Channels(NamedTuple):
    """The channels of an identification model.

    Attributes:
        frame: "body" or "air path".
        axes: axes of the force coefficients, a name in `FORCE_AXES`.
        states, inputs, outputs: names in order.
        measured: inputs that are neither surfaces nor histories of states.
        held: names of the constants.
    """

    frame: str
    axes: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    measured: tuple[str, ...]
    held: tuple[str, ...]

    @property
    def translation(self) -> Translation:
        """The three states of the velocity in this frame."""
        return FRAMES[self.frame]

    @property
    def force(self) -> ForceAxes:
        """The three force coefficients."""
        return FORCE_AXES[self.axes]

    @property
    def equation(self) -> dict[str, str]:
        """State whose equation a coefficient dominates, by coefficient: `Cm` and `q`."""
        forces = zip(self.force.names, self.translation.equation.values(), strict=True)
        return {**dict(forces), **MOMENT_STATES}

    @property
    def responses(self) -> tuple[str, ...]:
        """Coefficients whose equations are propagated."""
        return tuple(name for name, state in self.equation.items() if state in self.states)

    def affected(self, coefficient: str) -> tuple[str, ...]:
        """Return the propagated states whose rates a coefficient may change.

        Args:
            coefficient: one in these axes or in body axes.
        """
        if coefficient in self.translation.affected:
            return self.translation.affected_states(coefficient, self.states)
        own = self.translation.names if coefficient in self.force.names else ()
        return _among((*own, *RATES), self.states)

    @property
    def owner(self) -> dict[str, str]:
        """State whose equation a channel of the instruments depends on, by channel."""
        return owners(self.frame)

    @property
    def actuated(self) -> tuple[str, ...]:
        """Inputs that an actuator moves: surfaces and thrust.

        The other inputs are measured histories of states, or properties of the air.
        """
        return tuple(name for name in self.inputs if name in (*SURFACES, "thrust"))

    def without(self, responses: Collection[str]) -> Choice:
        """Return the choice without the equations of some coefficients.

        This implements `IdentificationModel.without`.

        Args:
            responses: coefficients among `self.responses`.
        """
        removed = [self.equation[name] for name in responses]
        return Choice(
            states=_except(self.states, removed),
            measured=(*self.measured, *(f"{name}dot" for name in removed if name in RATES)),
            outputs=tuple(name for name in self.outputs if self.owner[name] not in removed),
        )

    def with_gusts(self) -> Choice:
        """Return the choice with a gust along each propagated velocity as a measured input."""
        along = zip(GUSTS[:3], self.translation.equation.values(), strict=True)
        gusts = [gust for gust, state in along if state in self.states]
        return Choice(self.states, (*self.measured, *_except(gusts, self.inputs)), self.outputs)


def owners(frame: str) -> dict[str, str]:
    """Return the state whose equation a channel of the instruments depends on, by channel.

    Surfaces and thrust depend on no equation and are left out.

    Args:
        frame: "body" or "air path".
    """
    along, across, down = (FRAMES[frame].equation[force] for force in ("CX", "CY", "CZ"))
    translation = {
        "V": along,
        "beta": across,
        "alpha": down,
        "ax": along,
        "ay": across,
        "az": down,
        "az_pilot": down,
    }
    rotation = dict(zip(ANGULAR, RATES, strict=True))
    return translation | rotation | {name: name for name in (*RATES, *EULER_ANGLES, "altitude")}


def group_states(states: str | Sequence[str], frame: str) -> tuple[str, ...]:
    """Return the states of a group in a frame, or the given names.

    Args:
        states: the name of a group, or names of states.
        frame: "body" or "air path".

    Raises:
        InputError: for an unknown group.
    """
    if not isinstance(states, str):
        return tuple(states)
    require_known("group of states", [states], STATE_GROUPS)
    names = STATE_GROUPS[states]
    return (
        tuple(AIR_PATH_STATES.get(name) or name for name in names) if frame == "air path" else names
    )


def arrange_channels(
    states: str | Sequence[str],
    frame: str,
    measured: Sequence[str],
    held: Iterable[str],
    instruments: tuple[str, ...],
    outputs: Sequence[str] | None,
    axes: str = "body",
) -> Channels:
    """Return the channels for a choice of states, in an order independent of the choice's order.

    Args:
        states: the name of a group, or names of states.
        frame: "body" or "air path".
        measured: inputs other than the surfaces and the states that are not propagated; velocities
            of the air come last.
        held: names of the constants.
        instruments: channels on board.
        outputs: a selection of these channels; None for all that depend on a propagated equation.
        axes: axes of the force coefficients.

    Raises:
        InputError: for an unknown name, a name with two roles, an altitude without a role, or an
            output that depends on measured inputs only.
    """
    require_known("frame", [frame], FRAMES)
    possible = (*FRAMES[frame].names, *RATES, *EULER_ANGLES, "altitude")
    chosen, measured, held = group_states(states, frame), tuple(measured), tuple(held)
    _check_states(chosen, measured, possible)
    # A state that is not propagated is measured or held; so is the acceleration of such a rate.
    accelerations = tuple(f"{name}dot" for name in _except(RATES, chosen))
    others = _among(OTHER_SIGNALS, (*OTHER_SIGNALS[:4], *accelerations))
    histories = _except(possible, (*chosen, "psi", "altitude"))
    require_known("input (in `measured`)", measured, (*others, *GUSTS[:3]))
    require_known("constant (in `held`)", held, (*SURFACES, *others, *histories))
    _check_one_role(chosen, measured, held)
    return Channels(
        frame=frame,
        axes=axes,
        states=_among(possible, chosen),
        inputs=(
            *_except(SURFACES, held),
            *_among(OTHER_SIGNALS, measured),
            *_except(histories, held),
            *_among(GUSTS[:3], measured),
        ),
        outputs=_outputs(outputs, frame, chosen, instruments),
        measured=measured,
        held=(*held, *_except(accelerations, (*held, *measured))),
    )


def _among(names: Iterable[str], chosen: Collection[str]) -> tuple[str, ...]:
    return tuple(name for name in names if name in chosen)


def _except(names: Iterable[str], removed: Collection[str]) -> tuple[str, ...]:
    return tuple(name for name in names if name not in removed)


def _check_states(
    states: tuple[str, ...], measured: tuple[str, ...], possible: tuple[str, ...]
) -> None:
    """Refuse repeated names, unknown states, and an empty choice of states."""
    require_unique("state", states)
    require_unique("name in `measured`", measured)
    require_known("state", states, possible)
    require(len(states) > 0, f"No state is propagated. Name at least one of {', '.join(possible)}.")


def _check_one_role(
    states: tuple[str, ...], measured: tuple[str, ...], held: tuple[str, ...]
) -> None:
    """Refuse a name with two roles of state, input and constant, and an altitude without a role."""
    for name in measured:
        require(
            name not in (*states, *held),
            f"{name!r} is measured, and it is also a state or held. Choose one.",
        )
    require(
        "altitude" not in states or "altitude" not in held,
        "The altitude is a state, and it is also held. Choose one.",
    )
    require(
        "altitude" in (*states, *measured, *held),
        "The altitude, which determines density and speed of sound, is not known. Hold it "
        "(`held={'altitude': 3000.0}`; a constant `altitude` of a record replaces this value), "
        "measure it (`measured=('altitude',)`) or make it a state.",
    )


def _outputs(
    chosen: Sequence[str] | None, frame: str, states: tuple[str, ...], instruments: tuple[str, ...]
) -> tuple[str, ...]:
    """Return the outputs.

    An accelerometer may be chosen even if its velocity is not propagated, because it depends on a
    coefficient.
    """
    owner = owners(frame)
    outputs = (
        tuple(name for name in instruments if owner.get(name) in states)
        if chosen is None
        else tuple(chosen)
    )
    require_known("output (of the instruments)", outputs, instruments)
    require_unique("output", outputs)
    require(
        len(outputs) > 0,
        "No instrument depends on a propagated state, so there is nothing to fit.",
    )
    moving = bool({*FRAMES[frame].names} & set(states))
    for name in outputs:
        along = name in ("V", "alpha", "beta") and frame == "body" and moving
        require(
            owner.get(name) in states or along or name in (*FORCE, "az_pilot"),
            f"The output {name!r} depends only on measured inputs, and the fit would be perfect. "
            "Leave it out of `outputs`.",
        )
    return outputs
