"""General effects with a memory of their own: a signal that acts with a lag, a resonance, and hysteresis."""

import equinox as eqx
import jax.numpy as jnp

from .._foundation.types import Array, Float
from .acting import Acting, ActingEffect
from .effects import zero
from .effects_input import NO_LAG_YET
from .followers import bouc_wen
from .starts import longest_in, misfit_peak, reach_of, time_scale_of

NO_WIDTH_YET = 1e6  # wide against any signal in SI units: z stands still until `start` sets the width
SHORTEST = 2.0  # steps between samples: a lag starts no shorter, which a fixed step could not follow
FASTEST = 1.0  # radians from sample to sample: of what swings faster a Runge-Kutta step of that length damps 1 % away
NO_PEAK = 0.7  # damping ratio from 1/sqrt(2) on, beyond which nothing resonates


class LaggedSignal(ActingEffect):
    """What a signal does lags behind it (quasi-unsteady): `gain (lagged - signal)` is added.

        d(lagged)/dt = (signal - lagged) / time,    e = lagged - signal
        de/dt = -e/time - d(signal)/dt,             scalar += gain e

    The state that is carried is `e`. It starts at zero: the lagged signal begins at the signal itself, wherever that is, and also
    where the first state is estimated. The signal is a state, or made of states; an input has no known rate (`InputLag`).

    Args:
        acting: where it acts.
        signal: what is late.
        multiple: where the time starts, as a multiple of the signal's own time scale, its standard deviation over that of its
            rate.
        gain: what acts with the lag [unit of the scalar over that of the signal].
        time: of the lag [s].
        longest: that it can be; what lags behind by more than a record follows nothing in it [s].
    """

    acting: Acting = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    multiple: float = eqx.field(static=True, default=1.0)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    time: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(NO_LAG_YET))
    longest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(jnp.inf))

    @property
    def name(self):
        return f"{self.family} (from {self.multiple:g} times its own time)"

    @property
    def family(self):
        return f"lagged {self.signal} in {self.acting.name}"

    @property
    def sentence(self):
        return f"{self.signal} acts {self.acting.words} with a lag"

    @property
    def bounds(self):
        return {"time": (1e-6, float(self.longest))}

    @property
    def fixed(self):
        return ("longest",)

    @property
    def void_on_bounds(self):
        return ("time",)

    def start(self, signals, measured, step):
        longest = longest_in(signals)
        time = self.multiple * time_scale_of(signals[self.signal], signals, step)
        time = min(max(time, SHORTEST * step), longest)
        return eqx.tree_at(lambda one: (one.time, one.longest), self, (jnp.asarray(time), jnp.asarray(longest)))

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


class Resonance(ActingEffect):
    """A further mode that a signal excites and that acts back: a part that bends, a load that swings, a liquid that sloshes.

        dz/dt = frequency w,    dw/dt = frequency (signal - z) - 2 damping frequency w,    scalar += gain z

    At low frequencies `z` is the signal itself, of which what the declared model makes of it takes its share. It starts settled
    where the record's first input holds it, else at rest at zero.

    Args:
        acting: where it acts.
        signal: what excites it, an input as a rule.
        peak: where the declared model errs most, beside what it shows, that is where it starts: 1 is the highest peak.
        gain: what acts [unit of the scalar over that of the signal].
        frequency: natural frequency [rad/s].
        damping: ratio to the critical one.
        highest: that the frequency can be, which the step between samples can follow [rad/s].
    """

    acting: Acting = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    peak: int = eqx.field(static=True, default=1)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    frequency: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(1.0 / NO_LAG_YET))
    damping: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(0.1))
    highest: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(jnp.inf))

    @property
    def name(self):
        return f"{self.family} (from peak {self.peak})"

    @property
    def family(self):
        return f"resonance to {self.signal} in {self.acting.name}"

    @property
    def several(self):
        return True

    @property
    def sentence(self):
        return f"{self.signal} excites a resonance that acts {self.acting.words}"

    @property
    def bounds(self):
        return {"frequency": (1e-6, float(self.highest)), "damping": (1e-6, NO_PEAK)}

    @property
    def fixed(self):
        return ("highest",)

    @property
    def void_on_bounds(self):
        return ("frequency", "damping")

    def start(self, signals, measured, step):
        highest = FASTEST / step
        frequency, width = misfit_peak(signals, step, self.peak, highest)
        values = (jnp.asarray(value) for value in (frequency, min(width / frequency, 0.5 * NO_PEAK), highest))
        return eqx.tree_at(lambda one: (one.frequency, one.damping, one.highest), self, tuple(values))

    @property
    def extra_states(self):
        return (f"z of {self.name}", f"w of {self.name}")

    def initial(self, record):
        return {self.extra_states[0]: record.channel(self.signal)[0]} if self.signal in record.inputs else {}

    def scalar(self, signals):
        return signals[self.extra_states[0]]

    def extra_rates(self, extra, u, signals, rates):
        at, moving = self.extra_states
        z, w = extra[at], extra[moving]
        return {at: self.frequency * w, moving: self.frequency * (signals[self.signal] - z - 2.0 * self.damping * w)}


class Hysteresis(ActingEffect):
    """Hysteresis in a signal, after Bouc and Wen, in normalised form with exponent two.

        width dz/dt = ds/dt - (|ds/dt| |z| z + ds/dt z^2) / 2,    scalar += gain z

    From rest `z = tanh(s / width)`, which tends to one; on the way back it first falls by `1 / width`, a straight line, so that a
    cycle encloses an area. A small width is dry friction of the signal's motion. The signal is a state, or made of states.

    Args:
        acting: where it acts.
        signal: in which there is hysteresis.
        fraction: where the width starts, as a fraction of how far the signal goes from its centre.
        gain: half the height of the loop [unit of the scalar].

    Source: Wen, Method for Random Vibration of Hysteretic Systems, J. Eng. Mech. Div. ASCE 102 (1976), pp. 249-263, with
        A = 1, beta = gamma = 1/2, n = 2.
    """

    acting: Acting = eqx.field(static=True)
    signal: str = eqx.field(static=True)
    fraction: float = eqx.field(static=True, default=0.2)
    gain: Float[Array, ""] = eqx.field(default_factory=zero)
    width: Float[Array, ""] = eqx.field(default_factory=lambda: jnp.array(NO_WIDTH_YET))

    @property
    def name(self):
        return f"hysteresis of {self.signal} in {self.acting.name}"

    @property
    def sentence(self):
        return f"hysteresis of {self.signal} {self.acting.words}"

    @property
    def bounds(self):
        return {"width": (1e-9, float("inf"))}

    def start(self, signals, measured, step):
        return eqx.tree_at(
            lambda effect: effect.width, self, jnp.asarray(self.fraction * reach_of(signals[self.signal]))
        )

    @property
    def extra_states(self):
        return (f"z of {self.name}",)

    @property
    def rates_of(self):
        return (self.signal,)

    def scalar(self, signals):
        return signals[self.extra_states[0]]

    def extra_rates(self, extra, u, signals, rates):
        # |z| <= 1 by its equation; where a step is too long for that, the clip keeps it finite.
        z = jnp.clip(extra[self.extra_states[0]], -1.0, 1.0)
        return {self.extra_states[0]: bouc_wen(z, rates[self.signal], self.width)}
