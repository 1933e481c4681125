"""`Effect`: one physical effect that a model may lack; each is absent while its gain is zero.

The general effects of every domain stand in `effects_equation`, `effects_input` and `effects_sensor`; a domain adds its own.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from equinox import AbstractVar

from .._foundation.types import Array, Float
from ..data.record import Record

Signals = dict[str, Float[Array, ""]]

# Bounds where less than nothing of an effect is another one: what leads does not lag, what overshoots does not stop.
PRESENT = {"gain": (0.0, float("inf"))}


class Effect(eqx.Module):
    """One physical effect, with a gain that is zero where the effect is absent.

    A subclass fills the slots in which it acts; the others leave everything as it is. Shape parameters (a lag's time, a
    saturation's level) are further array leaves with sensible starts.

    Attributes:
        gain: strength; zero is absent.
        name: a short unique name; parameters are called `name.gain`, `name.level`.
    """

    gain: AbstractVar[Float[Array, ""]]

    @property
    def name(self) -> str:
        """A short unique name."""
        raise NotImplementedError(
            f"{type(self).__name__} has no name: give it a property `name` that returns a short unique one."
        )

    @property
    def family(self) -> str:
        """The name without its shape: members of one family are starts of the same effect, of which one is kept."""
        return self.name

    @property
    def several(self) -> bool:
        """Whether more than one of its family can act at once: a structure has many modes, a sensor one delay."""
        return False

    @property
    def sentence(self) -> str:
        """What the effect is, in words that an engineer uses."""
        return self.name

    @property
    def place(self) -> str:
        """Where it acts: `equation of v`, `input u`, `sensor y`."""
        return "model"

    @property
    def signals_used(self) -> tuple[str, ...]:
        """Signals of which what it adds is a function; empty where it is none. Several effects in one place that are functions
        of the same signals are parts of one unknown function."""
        return ()

    @property
    def unit(self) -> str:
        """Unit of the gain; empty where none is stated."""
        return ""

    @property
    def complexity(self) -> int:
        """How much it asks one to believe: the number of factors of a term, or of its shape parameters and one. Of effects
        that predict equally well the simplest is preferred."""
        return 1

    @property
    def refines(self) -> str:
        """Family of a simpler effect that this one says more closely; empty where there is none. It is tried while that one is
        in, takes its place, and starts from its values of the parameters that both have: first the effect, then its finer
        points."""
        return ""

    @property
    def stage(self) -> int:
        """Where it stands among the effects of a model: what acts later has a higher one, as a sensor's stop behind its scale."""
        return 0

    @property
    def fixed(self) -> tuple[str, ...]:
        """Shape parameters that stay as `start` sets them; the others are estimated once the effect is in."""
        return ()

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest value of own parameters, where physics sets them: of what is `whole` no less than none."""
        return PRESENT if self.whole else {}

    @property
    def void_on_bounds(self) -> tuple[str, ...]:
        """Parameters on whose bounds the effect is none, or another: a bend where there are no samples beyond it."""
        return ("gain",) if self.whole else ()

    @property
    def whole(self) -> bool:
        """Whether it is all there at a gain of one, and something else at any other: a lag of gain two is nearly a delay."""
        return False

    def kin(self) -> tuple["Effect", ...]:
        """The next shapes of its kind, which a library need not hold: where one of them does nearly as well, the form is open."""
        return ()

    @property
    def begin(self) -> float:
        """The gain from which a refit starts: zero, but where nothing is felt of a small gain."""
        return 0.0

    def worth_trying(self, measured: dict[str, Float[np.ndarray, " _"]]) -> bool:
        """Whether to refit with it whatever its score, because at zero gain the score hardly sees it."""
        return False

    def shown(self, measured: dict[str, Float[np.ndarray, " _"]]) -> bool:
        """Whether the records show it by themselves, whatever the model: where it helps, it comes in before all others."""
        return False

    def start(
        self,
        signals: dict[str, Float[np.ndarray, " sample"]],
        measured: dict[str, Float[np.ndarray, " _"]],
        step: float,
    ) -> "Effect":
        """The same effect with its shape set from the signals of the training records.

        Args:
            signals: time `t`, states, inputs and what the model adds, as simulated, every valid sample; `number of the record`;
                and of each output `shown NAME`, what the declared model shows, and `residual NAME`, what it leaves: zero where
                that is not measured.
            measured: measured outputs, every valid sample.
            step: typical time between two samples [s].
        """
        return self

    def check(self, t: Float[np.ndarray, "*case time"]) -> None:
        """Refuse sample times on which it is not defined."""

    # Slots ----------------------------------------------------------------------------------------------------------------

    @property
    def extra_states(self) -> tuple[str, ...]:
        """Names of the states that the effect brings with it."""
        return ()

    def initial(self, record: Record) -> Signals:
        """Its own states at the first sample of a record; one that is not named starts at zero.

        Args:
            record: a single one.
        """
        return {}

    @property
    def rates_of(self) -> tuple[str, ...]:
        """Signals whose rates `extra_rates` needs, beside those of the states."""
        return ()

    def input_path(self, path, inputs: tuple[str, ...]):
        """Acts on the input signal before the equations sample it."""
        return path

    def input(self, u: Float[Array, " input"], extra: Signals, inputs: tuple[str, ...]) -> Float[Array, " input"]:
        """Acts on the value of the input at an instant."""
        return u

    def declared(self, t: Float[Array, ""]) -> Signals:
        """Acts on the parameters of the declared model: returns what is to be added at a time, by dotted name."""
        return {}

    def equations(self, dx: Signals, signals: Signals) -> Signals:
        """Acts on the state derivatives: returns what is to be added, by state."""
        return {}

    @property
    def terms(self) -> tuple[tuple[str, str], ...]:
        """States and products of signals, for an effect that is no more than `d(state)/dt += gain * product` in each.

        Such effects are many; said in this way they are evaluated together, and cost one compilation for all.
        """
        return ()

    def extra_rates(self, extra: Signals, u: Signals, signals: Signals, rates: Signals) -> Signals:
        """Time derivatives of the effect's own states.

        Args:
            extra: the states that effects brought.
            u: the input as it arrives at this effect, which `input` may then change.
            signals: states and all that the model computes of them.
            rates: of the model's states and of the signals in `rates_of`, with all that effects add.
        """
        return {}

    def observe(
        self, t: Float[Array, " time"], y: Float[Array, "time output"], outputs: tuple[str, ...]
    ) -> Float[Array, "time output"]:
        """Acts on the sampled output signal."""
        return y


def zero() -> Float[Array, ""]:
    """A gain that is absent."""
    return jnp.zeros(())
