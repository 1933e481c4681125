"""`AbstractModel`: a dynamic model whose parameters are its own array leaves."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import AbstractVar
from jax.core import Tracer

from .._foundation.checks import InputError, require, require_known
from .._foundation.types import Array, Float
from ..data.record import Record
from .pseudo import PseudoMeasurements


class AbstractModel(eqx.Module):
    r"""A continuous-time state-space model with sampled outputs.

        dx/dt = rhs(t, x, u),    y(t_i) = output(t_i, x(t_i), u(t_i))

    A model says what moves and what is seen. Which of its parameters are free, how it is fitted, and to which data, are said
    elsewhere (`Free`, the likelihood, `Record`). Numbers given for array leaves are converted at the entry points.

    A subclass names its channels and writes two functions; the hooks below have defaults that suit most models. One without
    states (a calibration, or coefficients that accelerations say) returns `x` as its rate; its outputs are its equations.

    Attributes:
        states, inputs, outputs: the names of the channels, in order.
    """

    states: AbstractVar[tuple[str, ...]]
    inputs: AbstractVar[tuple[str, ...]]
    outputs: AbstractVar[tuple[str, ...]]

    @abc.abstractmethod
    def rhs(self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]) -> Float[Array, " state"]:
        """The time derivative of the state, in the units of the state per second."""

    @abc.abstractmethod
    def output(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> Float[Array, " output"]:
        """What perfect instruments would show at this instant."""

    # Hooks ----------------------------------------------------------------------------------------------------------------

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        """The state at the first sample: the measured output where an output is a state, else zero."""
        first = dict(zip(self.outputs, jnp.where(record.mask[0], record.z[0], 0.0), strict=True))
        return jnp.array([first.get(name, 0.0) for name in self.states], float)

    def signals(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> dict[str, Float[Array, ""]]:
        """The scalars that an effect may depend on, by name: states and inputs, and what a domain adds to them."""
        return dict(zip(self.states + self.inputs, jnp.concatenate([x, u]), strict=True))

    def immediate_signals(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> dict[str, Float[Array, ""]]:
        """Those of the signals that follow from state and input without the equations of motion, and of which effects may want
        the rate; all by default. A domain that says which spares every program a second model."""
        return self.signals(t, x, u)

    def rhs_and_signals(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> tuple[Float[Array, " state"], dict[str, Float[Array, ""]]]:
        """The rate of the state and the signals, for a model that computes them together."""
        return self.rhs(t, x, u), self.signals(t, x, u)

    def output_given(
        self,
        t: Float[Array, ""],
        x: Float[Array, " state"],
        u: Float[Array, " input"],
        dx: Float[Array, " state"],
    ) -> Float[Array, " output"]:
        """What perfect instruments would show if the state moved at the rate `dx`.

        A model whose instruments feel the state's rate (an accelerometer) computes them from `dx` here and lets `output`
        pass its own `rhs`: they then see whatever an effect adds to the equations. By default no instrument does, and the
        output is `output(t, x, u)`.

        Args:
            dx: the rate of the state, with all that acts on it [the units of the state per second].
        """
        return self.output(t, x, u)

    def input_path(self, path):
        """What happens to the input signal before it is sampled by the equations (a delay, its run between samples)."""
        return path

    def observe(self, t: Float[Array, " time"], y: Float[Array, "time output"]) -> Float[Array, "time output"]:
        """What the instruments make of the sampled outputs; what acts on a whole signal (a sensor's delay) belongs here."""
        return y

    def gusty(self) -> "AbstractModel":
        """The same model with random motions of what surrounds it as further inputs, behind its own; itself where it has none.

        Where a gust moves an aircraft's vane as well as its wing, a force in an equation does not say what it does.
        """
        return self

    def effects(self):
        """Candidates for missing effects beside the general ones: a tuple of `Effect`."""
        return ()

    def equations(self) -> tuple[str, ...]:
        """What has an equation in which something may be missing: the states; of a model that has none, the outputs."""
        return self.states or self.outputs

    def equations_with_terms(self) -> tuple[str, ...] | None:
        """States in whose equations the general library may put its terms (products of states and inputs, friction, limits).

        None leaves it to `uncertain_equations`; a model whose own effects take the place of these terms says `()`.
        """
        return None

    def actuated(self) -> tuple[str, ...]:
        """Inputs that an actuator moves, so that they may lack its limits and dead zone; all by default. A measured state or
        an altitude that is an input has none: it can be late, off and scaled, as any instrument."""
        return self.inputs

    def prepared(self, record: Record) -> Record:
        """The record with the channels that this model has, from one that may hold more.

        An input may be any of the record's channels (a measured state may stand in for its equation); an output must be one
        of its outputs. What is not measured at all is refused, nothing is filled in.

        Args:
            record: a single record.

        Returns:
            A record with this model's inputs and outputs, in their order.

        Raises:
            InputError: when a channel is missing, or an input has samples that are not valid.
        """
        return selected(record, self.inputs, self.outputs)

    def pseudo_measurements(self, record: Record) -> PseudoMeasurements:
        """The model's equations, solved for what a regression explains.

        Args:
            record: a single record, with all that was measured.

        Raises:
            InputError: by default: the model states none.
        """
        raise InputError(
            f"{type(self).__name__} has no pseudo-measurements, and a regression has nothing to explain. "
            "Write its method `pseudo_measurements(record)`."
        )

    def without(self, responses: tuple[str, ...]) -> "AbstractModel":
        """The same model without the equations of these responses; their states are inputs of it, measured.

        Args:
            responses: of the model's pseudo-measurements.

        Raises:
            InputError: by default, unless there are none: the model says of no equation how it is left out.
        """
        if responses:
            raise InputError(
                f"{type(self).__name__} cannot leave out the equations of {', '.join(responses)}. "
                "Keep them, or write its method `without(responses)`."
            )
        return self

    def sensor_errors(self) -> tuple[str, ...]:
        """Parameters that are errors of instruments and worth trying, for `consistency`: none by default."""
        return ()

    def corrected(self, record: Record) -> Record:
        """The record without the errors of instruments that the model's parameters are.

        Args:
            record: one or a stack, which may hold more channels than the model has.

        Raises:
            InputError: by default: the model says of no error how it is taken out.
        """
        raise InputError(
            f"{type(self).__name__} does not say how errors are taken out of a record. "
            "Write its method `corrected(record)`."
        )

    def units(self) -> dict[str, str]:
        """Units by name, of states, inputs, outputs and parameters; a name that is absent has no stated unit."""
        return {}


def equations_of(model: AbstractModel) -> tuple[str, ...]:
    """What has an equation in which something may be missing: the states; of a model that has none, the outputs."""
    return model.equations()


def right_hand_sides(
    model: AbstractModel, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
) -> Float[Array, " equation"]:
    """What these equations say: the rates of the states, or the outputs."""
    return model.rhs(t, x, u) if equations_of(model) == model.states else model.output(t, x, u)


def selected(record: Record, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Record:
    """A record with these channels, from one that may hold more; an input may be a measured output without gaps.

    Args:
        record: a single record.
        inputs, outputs: names of its channels.

    Raises:
        InputError: when a channel is missing, or an input has samples that are not valid.
    """
    require_known("channel (needed as input)", inputs, (*record.inputs, *record.outputs))
    require_known("channel (needed as output)", outputs, record.outputs)
    for name in inputs:
        gaps = 0 if name in record.inputs else int(jnp.sum(~record.mask[..., record.outputs.index(name)]))
        require(
            gaps == 0,
            f"Record {record.names[0]!r}: {name!r} stands in as an input and {gaps} of its samples are missing. "
            "Fill the gaps before, or keep the equation of this state.",
        )
    columns = [record.outputs.index(name) for name in outputs]
    units = dict(zip((*record.inputs, *record.outputs), (*record.input_units, *record.output_units), strict=True))
    u = [record.channel(name) for name in inputs]
    return Record(
        t=record.t,
        u=jnp.stack(u, axis=-1) if u else jnp.zeros((*record.t.shape, 0)),
        z=record.z[..., columns],
        mask=record.mask[..., columns],
        constants=record.constants,
        inputs=inputs,
        outputs=outputs,
        input_units=tuple(units[name] for name in inputs),
        output_units=tuple(units[name] for name in outputs),
        names=record.names,
    )


def canonical(tree):
    """Bring every numeric leaf to one dtype, so that numbers, weak types and float32 do not compile anew."""
    return jax.tree.map(lambda leaf: _float(leaf) if _is_number(leaf) else leaf, tree)


def _float(leaf):
    """A number as an array of JAX's widest float; one of another type goes through NumPy, which compiles no conversion."""
    known = isinstance(leaf, Tracer) or (isinstance(leaf, jax.Array) and leaf.dtype == float and not leaf.weak_type)
    return jnp.asarray(leaf if known else np.asarray(leaf, float), float)


def _is_number(leaf) -> bool:
    return not isinstance(leaf, bool) and (isinstance(leaf, int | float | np.floating) or eqx.is_inexact_array(leaf))
