"""`AbstractModel`: a dynamic model whose parameters are its array leaves."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import AbstractVar
from jax.core import Tracer

from .._foundation.checks import InputError, require, require_known
from .._foundation.host import as_columns, columns_at, is_integer_array
from .._foundation.types import Array, Float
from ..data.arguments import OTHER_NAMES
from ..data.record import Record
from .pseudo_measurements import PseudoMeasurements, WeakMeasurements

MOST_PRINTED = 16  # numbers of an array that are printed with a model (chosen)


class AbstractModel(eqx.Module):
    r"""A continuous-time state-space model with sampled outputs.

        dx/dt = rhs(t, x, u),    y(t_i) = output(t_i, x(t_i), u(t_i))

    A model defines the motion and its measurement. The free parameters, the estimation method and
    the data are defined elsewhere (`Free`, the likelihood, `Record`). Numbers given for array
    leaves are converted at the entry points.

    A subclass names its channels and implements `rhs`, and `output` unless all outputs are states.
    The hooks below have defaults that are suitable for most models. A model without states is
    static (a sensor calibration, or aerodynamic coefficients computed from accelerations): its
    `rhs` returns `x`, and its outputs are its equations.

    Attributes:
        states, inputs, outputs: the names of the channels, in order.
    """

    states: AbstractVar[tuple[str, ...]]
    inputs: AbstractVar[tuple[str, ...]]
    outputs: AbstractVar[tuple[str, ...]]

    @abc.abstractmethod
    def rhs(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> Float[Array, " state"]:
        """The time derivative of the state, in the units of the state per second."""

    def output(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> Float[Array, " output"]:
        """The outputs of perfect instruments at this instant; by default the states of the names in
        `outputs`.

        Raises:
            InputError: by default, if an output is no state.
        """
        others = [name for name in self.outputs if name not in self.states]
        require(
            not others,
            f"{type(self).__name__} has no method `output`, which is needed for outputs that are "
            f"no states: {', '.join(others)}. Write `output(t, x, u)`.",
        )
        return jnp.stack([x[self.states.index(name)] for name in self.outputs])

    # Hooks ----------------------------------------------------------------------------------------

    def initial_state(self, record: Record) -> Float[Array, " state"]:
        """The state at the first sample: for states that are outputs their first valid sample, else
        zero.

        A record's constants `initial_state.<state>` take precedence (`first_state`).
        """
        at = jnp.argmax(record.mask, axis=0)[None]
        valid, z = (jnp.take_along_axis(part, at, axis=0)[0] for part in (record.mask, record.z))
        first = dict(zip(self.outputs, jnp.where(valid, z, 0.0), strict=True))
        return jnp.array([first.get(name, 0.0) for name in self.states], float)

    def signals(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> dict[str, Float[Array, ""]]:
        """Scalars on which an effect may depend, by name: states, inputs, and further signals of a
        domain.
        """
        return dict(zip(self.states + self.inputs, jnp.concatenate([x, u]), strict=True))

    def immediate_signals(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> dict[str, Float[Array, ""]]:
        """Signals that follow from state and input without the equations of motion; all by default.

        Effects may use the rates of these signals. A model that returns only a part of the signals
        here saves a second copy of its equations in every compiled program.
        """
        return self.signals(t, x, u)

    def rhs_and_signals(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> tuple[Float[Array, " state"], dict[str, Float[Array, ""]]]:
        """Rate of the state, and signals; a model can compute them together."""
        return self.rhs(t, x, u), self.signals(t, x, u)

    def output_given(
        self,
        t: Float[Array, ""],
        x: Float[Array, " state"],
        u: Float[Array, " input"],
        dx: Float[Array, " state"],
    ) -> Float[Array, " output"]:
        """The outputs of perfect instruments for a given rate `dx` of the state.

        A model with instruments that measure the rate of the state (an accelerometer) computes
        their outputs from `dx` here, and its `output` calls this method with its `rhs`. The
        outputs then include the effects that are added to the equations. By default no output
        depends on `dx`, and the result is `output(t, x, u)`.

        Args:
            dx: rate of the state, with all effects [the units of the state per second].
        """
        return self.output(t, x, u)

    def input_signal(self, path):
        """Transform the input signal before the equations sample it, such as by a delay or another
        hold between samples.
        """
        return path

    def observe(
        self, t: Float[Array, " time"], y: Float[Array, "time output"]
    ) -> Float[Array, "time output"]:
        """Apply to the sampled outputs those sensor effects that act on a time history, such as a
        sensor's delay.
        """
        return y

    def with_disturbance_inputs(self) -> "AbstractModel":
        """The same model with random disturbances of its environment as further inputs, after its
        inputs; the model unchanged if it has none.

        Such an input is needed where a random force in an equation is not a sufficient model: a
        gust acts on an aircraft's vane as well as on its wing.
        """
        return self

    def effects(self):
        """Candidates for missing effects in addition to the general ones: a tuple of `Effect`."""
        return ()

    def equations(self) -> tuple[str, ...]:
        """Names of the equations in which an effect may be missing: the states, or the outputs of a
        model without states.
        """
        return self.states or self.outputs

    def equations_with_terms(self) -> tuple[str, ...] | None:
        """States to whose equations the general library may add its terms (products of states and
        inputs, friction, limits).

        With None, `uncertain_equations` decides. A model whose effects replace these terms returns
        `()`.
        """
        return None

    def actuated(self) -> tuple[str, ...]:
        """Inputs that an actuator drives; all by default.

        Effects of actuators, such as limits and a dead zone, are candidates for these inputs. A
        measured state or altitude that is used as an input has no actuator: it can have the delay,
        bias and scale factor of an instrument.
        """
        return self.inputs

    def input_rates(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> dict[str, Float[Array, ""]]:
        """Rates of inputs that follow from state and input, by name; none by default.

        The climb is the rate of a measured altitude. `advice` compares such an input with the
        integral of its rate, which shows a wrong unit or sign.
        """
        return {}

    def prepared(self, record: Record) -> Record:
        """The record reduced to the channels of this model.

        An input may be any of the record's channels (a measured state may replace its equation); an
        output must be one of the record's outputs. Channels that were not measured are refused.

        Args:
            record: a single record, which may have more channels.

        Returns:
            A record with this model's inputs and outputs, in their order.

        Raises:
            InputError: when a channel is missing, or an input has samples that are not valid.
        """
        return selected(record, self.inputs, self.outputs)

    def pseudo_measurements(self, record: Record) -> PseudoMeasurements:
        """The model's equations, solved for the responses of a regression.

        Args:
            record: a single record, with all measured channels.

        Raises:
            InputError: by default, because the model defines no pseudo-measurements.
        """
        raise InputError(
            f"{type(self).__name__} has no pseudo-measurements, which a regression needs. "
            "Write its method `pseudo_measurements(record)`."
        )

    def weak_measurements(self, record: Record) -> WeakMeasurements:
        """The model's equations for a regression in weak form, which differentiates no channel.

        Args:
            record: a single record, with all measured channels.

        Raises:
            InputError: by default, because the model defines no such equations.
        """
        raise InputError(
            f"{type(self).__name__} has no equations in weak form. Write its method "
            "`weak_measurements(record)`, or leave `weak_radius` out."
        )

    def without(self, responses: tuple[str, ...]) -> "AbstractModel":
        """The same model without the equations of these responses, whose measured states become
        inputs.

        Args:
            responses: names of responses of the model's pseudo-measurements.

        Raises:
            InputError: by default, if there are any responses.
        """
        if responses:
            raise InputError(
                f"{type(self).__name__} cannot leave out the equations of {', '.join(responses)}. "
                "Keep them, or write its method `without(responses)`."
            )
        return self

    def sensor_errors(self) -> tuple[str, ...]:
        """Names of the parameters that are sensor errors, as candidates of `consistency`; none by
        default.
        """
        return ()

    def corrected(self, record: Record) -> Record:
        """The record corrected for the sensor errors that are parameters of the model.

        Args:
            record: a record or a stack, which may have more channels than the model.

        Raises:
            InputError: by default, because the model defines no correction.
        """
        raise InputError(
            f"{type(self).__name__} has no correction of a record for sensor errors. "
            "Write its method `corrected(record)`."
        )

    def usual_ranges(self) -> dict[str, tuple[float, float]]:
        """Return the range of usual values of parameters, by dotted name; empty by default.

        An estimate outside its range may stand for an effect that the model does not have.
        """
        return {}

    def scales(self) -> tuple[str, ...]:
        """Names of the parameters that are positive scales, such as standard deviations; none by
        default. The confidence interval of a scale is symmetric in its logarithm.
        """
        return ()

    def units(self) -> dict[str, str]:
        """Units of states, inputs, outputs and parameters by name; the unit of a missing name is
        unknown. Inputs and outputs are in SI units, as in records.
        """
        return {}

    def __repr__(self) -> str:
        """The fields, with the values of small arrays."""
        return eqx.tree_pformat(jax.tree.map(_printed, self))


def _printed(leaf):
    """Return the numbers of a small array to six digits, and any other leaf unchanged."""
    if isinstance(leaf, Tracer) or not eqx.is_inexact_array_like(leaf):
        return leaf
    if np.size(leaf) > MOST_PRINTED or np.iscomplexobj(leaf):
        return leaf
    return jax.tree.map(lambda number: float(f"{number:.6g}"), np.asarray(leaf, float).tolist())


def equations_of(model: AbstractModel) -> tuple[str, ...]:
    """Names of the equations in which an effect may be missing: the states, or the outputs of a
    model without states.
    """
    return model.equations()


def right_hand_sides(
    model: AbstractModel, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
) -> Float[Array, " equation"]:
    """Values of the equations of `equations_of`: the rates of the states, or the outputs."""
    return model.rhs(t, x, u) if equations_of(model) == model.states else model.output(t, x, u)


def selected(record: Record, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Record:
    """The record reduced to the named channels; an input may be a measured output without gaps.

    Args:
        record: a single record, which may have more channels.
        inputs, outputs: names of the channels.

    Raises:
        InputError: when a channel is missing, or an input has samples that are not valid.
    """
    present = (*record.inputs, *record.outputs)
    require_known("channel (needed as input)", inputs, present, OTHER_NAMES)
    require_known("channel (needed as output)", outputs, record.outputs, OTHER_NAMES)
    for name in inputs:
        gaps = (
            0
            if name in record.inputs
            else int(np.sum(~np.asarray(record.mask)[..., record.outputs.index(name)]))
        )
        require(
            gaps == 0,
            f"Record {record.names[0]!r}: {name!r} is used as an input and {gaps} of its samples "
            "are missing. Fill the gaps first, or keep the equation of this state.",
        )
    columns = tuple(record.outputs.index(name) for name in outputs)
    units = dict(
        zip(
            (*record.inputs, *record.outputs),
            (*record.input_units, *record.output_units),
            strict=True,
        )
    )
    u = [record.channel(name) for name in inputs]
    return Record(
        t=record.t,
        u=as_columns(u, shape=record.t.shape),
        z=columns_at(record.z, at=columns),
        mask=columns_at(record.mask, at=columns),
        constants=record.constants,
        inputs=inputs,
        outputs=outputs,
        input_units=tuple(units[name] for name in inputs),
        output_units=tuple(units[name] for name in outputs),
        names=record.names,
    )


def canonical(tree):
    """Convert every numeric leaf to one dtype, so that numbers, weak types and float32 do not cause
    another compilation.
    """
    return jax.tree.map(lambda leaf: as_float(leaf) if _is_number(leaf) else leaf, tree)


def as_float(numbers):
    """Return numbers as one array of JAX's widest float, strongly typed.

    Concrete numbers are converted by NumPy, which needs no compilation. They are copied, as JAX
    would use the memory of a NumPy array, which the user may change later.
    """
    if isinstance(numbers, jax.Array) and numbers.dtype == float and not numbers.weak_type:
        return numbers
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(numbers))
    return jnp.asarray(numbers if traced else np.array(numbers, float), float)


def _is_number(leaf) -> bool:
    return not isinstance(leaf, bool) and (
        isinstance(leaf, int | float | np.number)
        or eqx.is_inexact_array(leaf)
        or is_integer_array(leaf)
    )
