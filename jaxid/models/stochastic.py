"""`StochasticModel`: a model with the standard deviations of its noises as parameters."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp

from .._foundation.types import Array, Float
from ..data.record import Record
from .base import AbstractModel, selected
from .wrapper import AbstractWrapper, observed_sample


class StochasticModel(AbstractWrapper):
    """A model driven by random forces and measured with noise.

        dx = rhs(t, x, [u, d]) dt + diag(process) dw,
        d_k = c_k dw_k/dt (white),    or    d(d_k) = -d_k/T_k dt + sqrt(2/T_k) s_k dw_k,
        z_i = output(t_i, x_i, [u_i, d_i]) + n(t_i) + e_i,    e_i ~ N(0, diag(sensor^2))

    A disturbance acts through an input of the model, or is a force that is added to the rate of a
    state. The coloured noise n of a sensor is the sum of disturbances with memory that act on its
    output alone. The states are the states of the model followed by the disturbances with memory;
    the force in the equation of `v` is `force_v`. Simulated, it moves without noise. An output that
    depends on the rate of a state contains no white noise of its equation. Errors of sensors that
    the model applies to its sampled outputs have no memory, and are part of `output`.

    Args:
        model: the model; its inputs after `inputs` are disturbances.
        process: by state or disturbance. White, the square root of the spectral density [unit of
            the state per sqrt(s); unit of the disturbance times sqrt(s)]; with memory, the standard
            deviation [unit of the state per second; unit of the disturbance].
        correlation_time: by state or disturbance with memory [s].
        sensor: standard deviation of the noise, by output [unit of the output].
        initial: standard deviation of the initial state, by state [unit of the state]; zero if
            missing.
        inputs: names of the recorded inputs.
        on_outputs: output on which a disturbance with memory acts, by disturbance, as pairs.
    """

    model: AbstractModel
    process: dict[str, Float[Array, ""]]
    correlation_time: dict[str, Float[Array, ""]]
    sensor: dict[str, Float[Array, ""]]
    initial: dict[str, Float[Array, ""]]
    inputs: tuple[str, ...] = eqx.field(static=True)
    on_outputs: tuple[tuple[str, str], ...] = eqx.field(static=True, default=())

    @property
    def states(self):
        own = self.model.states
        return (*own, *(f"force_{name}" if name in own else name for name in self.with_memory))

    @property
    def outputs(self):
        return self.model.outputs

    @property
    def with_memory(self) -> tuple[str, ...]:
        """Names of the states and disturbances whose noise has a memory, in the order of their
        states.
        """
        return tuple(sorted(self.correlation_time))

    @property
    def white(self) -> tuple[str, ...]:
        """Names of the states and disturbances driven by white noise, in order."""
        return tuple(name for name in sorted(self.process) if name not in self.correlation_time)

    @property
    def white_disturbances(self) -> tuple[str, ...]:
        """Names of the disturbances without memory."""
        return tuple(name for name in self.white if name not in self.model.states)

    def rhs(self, t, x, u):
        own, disturbances = self._split(x)
        times = self._vector(self.correlation_time, self.with_memory)
        rates = self.model.rhs(t, own, self._inputs(u, disturbances))
        for name, force in zip(self.with_memory, disturbances, strict=True):
            if name in self.model.states:
                rates = rates.at[self.model.states.index(name)].add(force)
        return jnp.concatenate([rates, -disturbances / times])

    def signals(self, t, x, u):
        own, disturbances = self._split(x)
        signals = self.model.signals(t, own, self._inputs(u, disturbances))
        return signals | dict(zip(self.states, x, strict=True))

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        own, disturbances = self._split(x)
        inputs = self._inputs(u, disturbances)
        y = self.model.output_given(t, own, inputs, dx[: len(self.model.states)])
        y = observed_sample(self.model, t, y)
        for name, output in self.on_outputs:
            value = disturbances[self.with_memory.index(name)]
            y = y.at[self.outputs.index(output)].add(value)
        return y

    def observe(self, t, y):
        return y  # in `output`

    def initial_state(self, record):
        return jnp.concatenate([self.model.initial_state(record), jnp.zeros(len(self.with_memory))])

    def prepared(self, record: Record) -> Record:
        """The record with the channels of the model; the disturbances are not measured."""
        further = self.model.inputs[len(self.inputs) :]
        zeros = jnp.zeros((*record.u.shape[:-1], len(further)))
        wide = dataclasses.replace(
            record,
            u=jnp.concatenate([record.u, zeros], axis=-1),
            inputs=(*record.inputs, *further),
            input_units=(*record.input_units, *([""] * len(further))),
        )
        return selected(self.model.prepared(wide), self.inputs, self.outputs)

    def scales(self):
        groups = ("process", "correlation_time", "sensor", "initial")
        names = (f"{group}.{name}" for group in groups for name in getattr(self, group))
        return (*self.model.scales(), *names)

    def units(self):
        units = self.model.units()
        noise = {f"sensor.{name}": units.get(name, "") for name in self.sensor}
        noise |= {f"initial.{name}": units.get(name, "") for name in self.initial}
        noise |= {f"correlation_time.{name}": "s" for name in self.correlation_time}
        units |= {name: units.get(output, "") for name, output in self.on_outputs}
        for name in self.process:
            time = "s" if name in self.correlation_time else "sqrt(s)"
            unit, is_state = units.get(name, ""), name in self.model.states
            other = unit if time == "s" else f"{unit}*{time}"
            noise[f"process.{name}"] = f"{unit}/{time}" if is_state else other
        return units | noise

    def diffusion(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> Float[Array, "state noise"]:
        """Return the matrix `G` of `dx = rhs dt + G dw` with independent unit white noises."""
        columns = []
        for at, name in enumerate(self.with_memory, start=len(self.model.states)):
            size = self.process[name] * jnp.sqrt(2.0 / self.correlation_time[name])
            columns.append(jnp.zeros(len(self.states)).at[at].set(size))
        columns += [self._white_column(name, t, x, u) for name in self.white]
        return jnp.stack(columns, axis=-1) if columns else jnp.zeros((len(self.states), 0))

    def feedthrough(
        self, t: Float[Array, ""], x: Float[Array, " state"], u: Float[Array, " input"]
    ) -> Float[Array, "output white"]:
        """Return the derivative of the outputs with respect to the disturbances without memory."""
        at = [self.model.inputs.index(name) for name in self.white_disturbances]
        if not at:
            return jnp.zeros((len(self.outputs), 0))
        own, disturbances = self._split(x)
        inputs = self._inputs(u, disturbances)

        def outputs(values):
            y = self.model.output(t, own, inputs.at[jnp.array(at)].set(values))
            return observed_sample(self.model, t, y)

        return jax.jacfwd(outputs)(jnp.zeros(len(at)))

    def initial_covariance(self) -> Float[Array, "state state"]:
        """Return the covariance of the initial state; disturbances start in steady state."""
        own = [self.initial.get(name, jnp.zeros(())) for name in self.model.states]
        disturbances = [self.process[name] for name in self.with_memory]
        return jnp.diag(jnp.stack([*own, *disturbances]) ** 2)

    def sensor_deviations(self) -> Float[Array, " output"]:
        """Return the standard deviations of the measurement noise."""
        return self._vector(self.sensor, self.outputs)

    def _white_column(self, name, t, x, u):
        if name in self.model.states:
            at = self.states.index(name)
            return jnp.zeros(len(self.states)).at[at].set(self.process[name])
        own, disturbances = self._split(x)
        inputs = self._inputs(u, disturbances)
        unit = jnp.zeros(inputs.shape).at[self.model.inputs.index(name)].set(1.0)
        _, image = jax.jvp(lambda u: self.model.rhs(t, own, u), (inputs,), (unit,))
        return self.process[name] * jnp.pad(image, (0, len(self.with_memory)))

    def _split(self, x):
        count = len(self.model.states)
        return x[:count], x[count:]

    def _inputs(self, u, disturbances):
        """Return all inputs of the model; a white disturbance has the mean zero."""
        values = dict(zip(self.with_memory, disturbances, strict=True))
        further = self.model.inputs[len(self.inputs) :]
        zero = jnp.zeros(())
        return jnp.concatenate([u, *(values.get(name, zero)[None] for name in further)])

    @staticmethod
    def _vector(values, names):
        return jnp.stack([values[name] for name in names]) if names else jnp.zeros(0)
