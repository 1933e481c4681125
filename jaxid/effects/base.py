"""`Effect`: one physical effect that a model may lack; an effect with zero gain is absent.

The general effects are in `equation.py`, `dynamics.py`, `static_nonlinearity.py`, `input.py`,
`actuator.py`, `sensor.py`, `sensor_curve.py`, `sensor_quantisation.py` and `parameter.py`; a domain
adds effects.
"""

from typing import final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import AbstractVar
from jax.core import Tracer

from .._foundation.types import Array, Float
from ..data.record import INITIAL_STATE, Record
from .card import EffectCard

Signals = dict[str, Float[Array, ""]]


class Effect(eqx.Module):
    """One physical effect, with a gain that is zero where the effect is absent.

    A subclass describes itself in `card` and implements the slots in which it acts; by default a
    slot changes nothing. Shape parameters (a lag's time constant, a saturation's level) are further
    array leaves with sensible initial values.

    Attributes:
        gain: strength; zero if the effect is absent.
        card: facts about the effect (`EffectCard`): a class attribute, or a property if the facts
            depend on fields.
    """

    gain: AbstractVar[Float[Array, ""]]

    @property
    def card(self) -> EffectCard:
        """Facts about the effect."""
        raise NotImplementedError(
            f"{type(self).__name__} has no card. Give it a class attribute or a property `card`, "
            "such as "
            "card = jaxid.effects.EffectCard(name='cogging', description='the magnets pull towards "
            "their poles', "
            "location=jaxid.effects.Location(jaxid.effects.LocationKind.EQUATION, 'v'))."
        )

    @property
    @final
    def name(self) -> str:
        """Name of the effect, from its card."""
        return self.card.name

    @property
    @final
    def starts(self) -> tuple[str, ...]:
        """Dotted names of the parameters that state how a record begins: the initial values of the
        added states, and `EffectCard.by_record`.
        """
        states = (f"{INITIAL_STATE}.{state}" for state in self.extra_states)
        return (*states, *(f"{self.name}.{field}" for field in self.card.by_record))

    def neighbouring_shapes(self) -> tuple["Effect", ...]:
        """Return similar effects of another shape, such as the next higher power, which are sums of
        terms (`terms`).

        They need not be in the library of candidates. If one of them fits nearly as well, the form
        of the effect is not determined.
        """
        return ()

    def score_blind(self, measured: dict[str, Float[np.ndarray, " _"]]) -> bool:
        """Return whether to refit with the effect regardless of its score.

        The score is the sensitivity at zero gain, which is uninformative for some effects.

        Args:
            measured: measured outputs, every valid sample.
        """
        return False

    def evident_in_data(self, measured: dict[str, tuple[Float[np.ndarray, " _"], ...]]) -> bool:
        """Return whether the records alone show the effect, without a model.

        Such an effect is added before all others.

        Args:
            measured: measured outputs: the valid samples of each record.
        """
        return False

    def initialise_shape(
        self,
        signals: dict[str, Float[np.ndarray, " sample"]],
        measured: dict[str, Float[np.ndarray, " _"]],
        step: float,
    ) -> "Effect":
        """Return the effect with its shape parameters set from the training records.

        Args:
            signals: simulated signals at every recorded row: time `t` [s], states, inputs and the
                model's signals; `number of the record`; for each output `simulated NAME`, the
                output of the declared model, and `residual NAME`, its residual, both zero where
                that output is not measured.
            measured: measured outputs, every valid sample.
            step: typical sample interval [s].
        """
        return self

    def check(self, t: Float[np.ndarray, "*case time"]) -> None:
        """Check that the effect is defined for these sample times.

        Args:
            t: sample times of records [s].

        Raises:
            InputError: if it is not.
        """

    # Slots ----------------------------------------------------------------------------------------

    def input_signal(self, path, inputs: tuple[str, ...]):
        """Return the input signal with the effect, before the equations sample it."""
        return path

    def input(
        self, u: Float[Array, " input"], extra: Signals, inputs: tuple[str, ...]
    ) -> Float[Array, " input"]:
        """Return the value of the input with the effect, at one time."""
        return u

    def parameter_offsets(self, t: Float[Array, ""]) -> Signals:
        """Return the offsets of the declared model's parameters at a time, by dotted name."""
        return {}

    def equations(self, dx: Signals, signals: Signals) -> Signals:
        """Return the terms added to the state derivatives, by state."""
        return {}

    @property
    def terms(self) -> tuple[tuple[str, str], ...]:
        """Pairs of state and product of signals, for an effect `d(state)/dt += gain * product`.

        All such effects of a model are evaluated together, in one compiled expression.
        """
        return ()

    @property
    def extra_states(self) -> tuple[str, ...]:
        """Names of the states that the effect adds."""
        return ()

    def initial_extra_states(self, record: Record) -> Signals:
        """Return the initial values of added states for a record; the others start at zero.

        Args:
            record: a single record.
        """
        return {}

    def extra_rates(self, extra: Signals, u: Signals, signals: Signals, rates: Signals) -> Signals:
        """Return the time derivatives of the added states.

        Args:
            extra: the added states of all effects.
            u: input of this effect, after the effects before it and before its `input`.
            signals: states and the signals that the model computes from them.
            rates: time derivatives of the model's states and of the signals in `rates_of`,
                including the terms that effects add.
        """
        return {}

    @property
    def rates_of(self) -> tuple[str, ...]:
        """Signals whose rates `extra_rates` needs, in addition to the rates of the states."""
        return ()

    def observe(
        self, t: Float[Array, " time"], y: Float[Array, "time output"], outputs: tuple[str, ...]
    ) -> Float[Array, "time output"]:
        """Return the sampled outputs with the effect."""
        return y


def zero() -> Float[Array, ""]:
    """Return a zero gain."""
    return jnp.zeros(())


def is_negative(gain: Float[Array, ""]) -> bool:
    """Return whether a gain is below zero; False if its value is unknown, as under `jit`."""
    if isinstance(gain, Tracer) or not isinstance(gain, (int, float, np.ndarray, jax.Array)):
        return False
    return np.size(gain) == 1 and bool(np.all(np.asarray(gain) < 0))
