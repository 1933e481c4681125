"""General effects with additional states: lagged signal, resonance, hysteresis.

In the equations below, `scalar` is the quantity that a `Placement` adds to equations of motion. An
effect with zero gain is absent.
"""

import dataclasses

import equinox as eqx
import jax.numpy as jnp

from .._foundation.types import Array, Float
from .base import zero
from .card import EffectCard
from .input import UNSET_TIME
from .placement import AS_CUBIC, Placement, ScalarEffect
from .rate_hysteresis import bouc_wen
from .shape_initialisation import longest_record, max_deviation, misfit_peak, time_scale_of

# width before `initialise_shape` sets it (chosen): wider than any signal in SI units, so that z is
# constant
UNSET_WIDTH = 1e6
LOOP_WIDTHS = 1e-9, float("inf")  # derived: a width is positive
# Chosen: beyond it the bend is a corner; below one the slope is infinite at z = 0.
EXPONENTS = 1.0, 20.0
# least initial lag in sample intervals (chosen): with a shorter lag, integration is inaccurate
MIN_LAG_STEPS = 2.0
# phase change per sample interval [rad], derived: at this frequency a Runge-Kutta step of one
# sample interval damps the oscillation by about 1 %
MAX_RADIANS_PER_STEP = 1.0
MAX_DAMPING = 0.7  # about 1/sqrt(2), derived: above it the frequency response has no peak


class LaggedSignal(ScalarEffect):
    """First-order lag in the effect of a signal: adds `gain (lagged - signal)`.

        d(lagged)/dt = (signal - lagged) / time,    e = lagged - signal
        de/dt = -e/time - d(signal)/dt,             scalar += gain e

    An example is unsteady flow, whose force lags the angle of attack. The additional state is `e`.
    Its initial value is zero: at the first sample the lagged signal equals the signal. Where the
    initial state of the model is estimated, so is this value. The signal must be a function of
    states, as the rate of an input is unknown (for inputs, see `InputLag`).

    Args:
        placement: equations in which the scalar acts.
        signal: the lagged signal.
        multiple: initial time constant, as a multiple of the signal's time scale: its standard
            deviation over the root mean square of its rate.
        gain: factor of the lagged part [unit of the scalar/unit of the signal].
        time: time constant [s].
        longest: upper bound of the time constant, the duration of the longest record [s].
    """

    placement: Placement = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    multiple: float = eqx.field(static=True, default=1.0)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    time: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(UNSET_TIME))
    longest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(jnp.inf))

    @property
    def card(self):
        family = f"lagged {self.signal} in {self.placement.name}"
        return EffectCard(
            name=f"{family} (from {self.multiple:g} times its time scale)",
            description=f"{self.signal} acts {self.placement.words} with a lag",
            location=self.placement.location,
            family=family,
            signals=(self.signal,),
            complexity=AS_CUBIC,
            bounds={"time": (1e-6, self.longest)},
            fixed=("longest",),
            degenerate_at_bounds=("time",),
        )

    def initialise_shape(self, signals, measured, step):
        longest = longest_record(signals)
        time = self.multiple * time_scale_of(signals[self.signal], signals, step)
        time = min(max(time, MIN_LAG_STEPS * step), longest)
        return eqx.tree_at(
            lambda effect: (effect.time, effect.longest),
            self,
            (jnp.asarray(time), jnp.asarray(longest)),
        )

    @property
    def extra_states(self):
        return (f"error of {self.name}",)

    @property
    def rates_of(self):
        return (self.signal,)

    def scalar(self, signals):
        return signals[self.extra_states[0]]

    def extra_rates(self, extra, u, signals, rates):
        error = self.extra_states[0]
        return {error: -extra[error] / self.time - rates[self.signal]}


class Resonance(ScalarEffect):
    """Additional mode, excited by a signal: structural bending, a slung load, sloshing.

        dz/dt = frequency w
        dw/dt = frequency (signal - z) - 2 damping frequency w
        scalar += gain z

    At low frequency z equals the signal, so that the declared model's response to this signal
    absorbs part of the effect. If the signal is an input, the mode starts in equilibrium with the
    record's first input, otherwise at rest at zero.

    Args:
        placement: equations in which the scalar acts.
        signal: the excitation, usually an input.
        peak: rank of the peak in the relative residual spectrum (`misfit_peak`) that gives the
            initial frequency; 1 is the highest peak.
        gain: factor of the mode [unit of the scalar/unit of the signal].
        frequency: natural frequency [rad/s].
        damping: damping ratio [1].
        highest: upper bound of the frequency, set by the sample interval [rad/s].
    """

    placement: Placement = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    peak: int = eqx.field(static=True, default=1)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    frequency: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(1.0 / UNSET_TIME))
    damping: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.1))
    highest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(jnp.inf))

    @property
    def card(self):
        family = f"resonance to {self.signal} in {self.placement.name}"
        return EffectCard(
            name=f"{family} (from peak {self.peak})",
            description=f"{self.signal} excites a resonance that acts {self.placement.words}",
            location=self.placement.location,
            family=family,
            signals=(self.signal,),
            complexity=AS_CUBIC,
            bounds={"frequency": (1e-6, self.highest), "damping": (1e-6, MAX_DAMPING)},
            repeatable=True,
            fixed=("highest",),
            degenerate_at_bounds=("frequency", "damping"),
        )

    def initialise_shape(self, signals, measured, step):
        highest = MAX_RADIANS_PER_STEP / step
        frequency, width = misfit_peak(signals, step, self.peak, highest)
        values = (
            jnp.asarray(value)
            for value in (frequency, min(width / frequency, 0.5 * MAX_DAMPING), highest)
        )
        return eqx.tree_at(
            lambda effect: (effect.frequency, effect.damping, effect.highest), self, tuple(values)
        )

    @property
    def extra_states(self):
        return (f"z of {self.name}", f"w of {self.name}")

    def initial_extra_states(self, record):
        return (
            {self.extra_states[0]: record.channel(self.signal)[0]}
            if self.signal in record.inputs
            else {}
        )

    def scalar(self, signals):
        return signals[self.extra_states[0]]

    def extra_rates(self, extra, u, signals, rates):
        position, velocity = self.extra_states
        z, w = extra[position], extra[velocity]
        return {
            position: self.frequency * w,
            velocity: self.frequency * (signals[self.signal] - z - 2.0 * self.damping * w),
        }


class Hysteresis(ScalarEffect):
    """Bouc-Wen hysteresis in a signal, in normalised form.

        width dz/dt = ds/dt - |z|^n (b |ds/dt| sign(z) + (1 - b) ds/dt),    scalar += gain z

    Here `s` is the signal. With exponent n = 2 and reversal b = 1/2, if s rises from zero, with z
    zero at first, `z = tanh(s / width)`, which tends to one. After s reverses, z follows a straight
    line of slope `1 / width` until it changes sign, so that a cycle encloses an area. As the width
    tends to zero, the effect becomes dry friction, `gain sign(ds/dt)`. The signal must be a
    function of states. With a free shape n and b are estimated from there; this effect refines the
    one with a fixed shape.

    Args:
        placement: equations in which the scalar acts.
        signal: the signal with hysteresis.
        fraction: initial width, as a fraction of the signal's largest deviation from its centre.
        gain: half the height of the loop [unit of the scalar].
        width: `dz/ds` at z = 0 is `1 / width` [unit of the signal].
        exponent, reversal: n and b [-].
        free_shape: estimate them.

    Source: Wen, Method for Random Vibration of Hysteretic Systems, J. Eng. Mech. Div. ASCE 102
    (1976), pp. 249-263, with A = 1, beta = b, gamma = 1 - b.
    """

    placement: Placement = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.2)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(UNSET_WIDTH))
    exponent: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(2.0))
    reversal: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.5))
    free_shape: bool = eqx.field(static=True, default=False)

    @property
    def card(self):
        name = f"hysteresis of {self.signal} in {self.placement.name}"
        simple = EffectCard(
            name=name,
            description=f"hysteresis of {self.signal} {self.placement.words}",
            location=self.placement.location,
            signals=(self.signal,),
            complexity=AS_CUBIC,
            fixed=("exponent", "reversal"),
            bounds={"width": LOOP_WIDTHS},
        )
        if not self.free_shape:
            return simple
        return dataclasses.replace(
            simple,
            name=f"shaped {name}",
            family=f"shaped {name}",
            description=f"{simple.description}, of its own shape",
            complexity=AS_CUBIC + 2,
            fixed=(),
            refines=name,
            bounds={"width": LOOP_WIDTHS, "exponent": EXPONENTS, "reversal": (0.0, 1.0)},
        )

    def initialise_shape(self, signals, measured, step):
        return eqx.tree_at(
            lambda effect: effect.width,
            self,
            jnp.asarray(self.fraction * max_deviation(signals[self.signal])),
        )

    @property
    def extra_states(self):
        return (f"z of {self.name}",)

    @property
    def rates_of(self):
        return (self.signal,)

    @property
    def shape(self):
        """Width, exponent and reversal."""
        return self.width, self.exponent, self.reversal

    def scalar(self, signals):
        return signals[self.extra_states[0]]

    def extra_rates(self, extra, u, signals, rates):
        # The exact z is within +-1; the clip keeps z finite if the integration step is too long.
        z = jnp.clip(extra[self.extra_states[0]], -1.0, 1.0)
        return {self.extra_states[0]: bouc_wen(z, rates[self.signal], *self.shape)}
