"""Modes of motion with their names, from a linearisation, and the linearisation in Euler angles that shows them."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import require, require_known
from .._foundation.types import Array, Float, Numbers
from ..models.base import AbstractModel
from ..simulation.linearise import Linearisation, linearise
from .frames import euler, quaternion

CLASSICAL = ("u", "w", "q", "pitch", "v", "p", "r", "phi")  # the eight states of the classical modes
SHORT, LONG = ("w", "q", "alpha"), ("u", "pitch", "V", "gamma")
YAWING, ROLLING, BANKING = ("v", "r", "beta"), ("p",), ("phi",)
LONGITUDINAL, LATERAL = SHORT + LONG, YAWING + ROLLING + BANKING
QUATERNION, ANGLES = ("e0", "e1", "e2", "e3"), ("phi", "pitch", "psi")
CLEAR = 0.65  # our choice: share of its states in a lone oscillation that makes it a short period or a phugoid
DEFECTIVE = 1e12  # condition of the eigenvectors beyond which two of them are one
REAL = 1e-9  # imaginary part, relative to the size of the eigenvalue, that is rounding


class Mode(NamedTuple):
    """One mode: a real eigenvalue, or a pair of complex ones, of which the upper is kept.

    Attributes:
        name: short period, phugoid, third oscillatory; dutch roll, roll, spiral, lateral phugoid; else unnamed.
        eigenvalue: [rad/s].
        participation: by state, how much of the mode lives in it; the shares add up to one and depend on no units.
    """

    name: str
    eigenvalue: complex
    participation: Mapping[str, float]

    @property
    def oscillatory(self) -> bool:
        """Whether it is a pair of complex eigenvalues."""
        return self.eigenvalue.imag > 0

    @property
    def natural_frequency(self) -> float:
        """`|eigenvalue|` [rad/s]."""
        return abs(self.eigenvalue)

    @property
    def damping(self) -> float:
        """`-Re(eigenvalue)/|eigenvalue|`: 1 or -1 where it does not oscillate, NaN for an eigenvalue of zero."""
        return -self.eigenvalue.real / abs(self.eigenvalue) if self.eigenvalue else math.nan

    @property
    def period(self) -> float:
        """`2 pi/Im(eigenvalue)` [s], infinite where it does not oscillate."""
        return 2.0 * math.pi / self.eigenvalue.imag if self.oscillatory else math.inf

    @property
    def time_to_half(self) -> float:
        """`ln 2/-Re(eigenvalue)` [s], infinite where the amplitude does not decay."""
        return math.log(2.0) / -self.eigenvalue.real if self.eigenvalue.real < 0 else math.inf

    @property
    def time_to_double(self) -> float:
        """`ln 2/Re(eigenvalue)` [s], infinite where the amplitude does not grow."""
        return math.log(2.0) / self.eigenvalue.real if self.eigenvalue.real > 0 else math.inf


class Modes(tuple[Mode, ...]):
    """The modes of a linearisation, fastest first, which print as a table."""

    def named(self, name: str) -> Mode:
        """The one mode of this name.

        Raises:
            InputError: when there is none or there are several.
        """
        require_known("mode", [name], dict.fromkeys(mode.name for mode in self))
        found = [mode for mode in self if mode.name == name]
        require(len(found) == 1, f"There are {len(found)} modes called {name!r}; take them by position.")
        return found[0]

    def __str__(self) -> str:
        width = max([len(mode.name) for mode in self] + [4])
        head = f"{'mode':<{width}} {'eigenvalue [rad/s]':>22} {'wn [rad/s]':>11} {'damping':>8} {'period [s]':>11}"
        lines = [head + f" {'half in [s]':>12} {'double in [s]':>14}  where it lives"]
        for mode in self:
            value = f"{mode.eigenvalue.real:.4g}"
            if mode.oscillatory:
                value += f" +- {mode.eigenvalue.imag:.4g}i"
            numbers = f"{mode.natural_frequency:>11.4g} {mode.damping:>8.3f} {_or_dash(mode.period):>11}"
            times = f"{_or_dash(mode.time_to_half):>12} {_or_dash(mode.time_to_double):>14}"
            most = sorted(mode.participation.items(), key=lambda item: -item[1])[:3]
            where = ", ".join(f"{state} {share:.0%}" for state, share in most if share > 0.05)
            lines.append(f"{mode.name:<{width}} {value:>22} {numbers} {times}  {where}".rstrip())
        return "\n".join(lines)

    __repr__ = __str__


def linearise_euler(
    aircraft: AbstractModel, t: Float[Numbers, ""] | float, x: Float[Numbers, " state"], u: Float[Numbers, " input"]
) -> Linearisation:
    """The linearisation of a model with a quaternion `e0 e1 e2 e3`, in bank, pitch and heading instead.

        d/dt (phi, pitch, psi) = d euler/de  edot( e(phi, pitch, psi) )

    so that the redundant fourth element, whose mode means nothing, is gone. Pure, as `linearise`.

    Args:
        aircraft: with the four states `e0` to `e3`, one after the other.
        t: time [s].
        x: its state, at a pitch that is not 90 deg.
        u: its input.

    Returns:
        Matrices with `phi`, `pitch` and `psi` [rad] among the states; take the classical eight with
        `reduced(states=CLASSICAL)`, which holds the surfaces and the engines at the point.

    Raises:
        InputError: when the model has no quaternion, or a shape does not fit.
    """
    require(
        all(name in aircraft.states for name in QUATERNION),
        f"The model has no quaternion {', '.join(QUATERNION)} among its states: {', '.join(aircraft.states)}. Use `linearise`.",
    )
    x = jnp.asarray(x, float)
    require(x.shape == (len(aircraft.states),), f"x has shape {x.shape}; the model has {len(aircraft.states)} states.")
    wrapped = _InEulerAngles(aircraft)  # pyright: ignore[reportCallIssue]  (as in models/library.py)
    return linearise(wrapped, t, wrapped.from_model(x), u)


def modes(linearisation: Linearisation) -> Modes:
    """Eigenvalues of a linearisation, named by where they live and not by their order.

        A v = lambda v,    w' A = lambda w',    participation of state k: |w_k v_k| / sum over all states

    Participation does not depend on the units of the states. A mode belongs to the motion, longitudinal or lateral, that
    holds most of it. Of two longitudinal oscillations the one with more of w and q is the short period, the other the phugoid; a
    lone one between the two is the third oscillatory mode of an aircraft without static stability. A lateral oscillation with
    most in v and r is the dutch roll, one with most in p and phi the lateral phugoid (roll and spiral coupled, as at high
    alpha); a real mode with most in p is the roll, with most in phi the spiral.

    Args:
        linearisation: of one case, at an equilibrium, with states called u w q pitch, v p r phi or the wind-axis V alpha
            gamma beta; from `linearise_euler` for an aircraft with a quaternion. Others (actuators, altitude) may be there;
            those on which nothing depends, position and heading, are left out.

    Returns:
        The modes, fastest first.

    Raises:
        InputError: for a batch, a matrix that is not finite, or states of a quaternion.
    """
    A = np.asarray(linearisation.A)
    require(
        A.ndim == 2,
        f"A has shape {A.shape}. Take one case out of the batch, as with jax.tree.map(lambda a: a[0], ...).",
    )
    require(bool(np.all(np.isfinite(A))), "The linearisation is not finite: the model diverges at this point.")
    require(
        not set(QUATERNION) & set(linearisation.states),
        "A quaternion hides the classical modes. Linearise with `linearise_euler`.",
    )
    states = _fed_back(A, linearisation.states)
    at = np.array([linearisation.states.index(name) for name in states], int)
    values, right = np.linalg.eig(A[np.ix_(at, at)])
    require(
        bool(np.linalg.cond(right) < DEFECTIVE),
        "Two modes are one and the same: A has no full set of eigenvectors. Keep the states that matter with "
        "`reduced(states=...)`, such as jaxid.aircraft.modes.CLASSICAL.",
    )
    left = np.linalg.inv(right)
    share = np.abs(left.T * right)
    share /= np.sum(share, axis=0)
    every = [_clean(complex(value)) for value in values]
    kept = [int(i) for i in np.argsort(-np.abs(values), kind="stable") if every[i].imag >= 0]
    found = [(every[i], dict(zip(states, map(float, share[:, i]), strict=True))) for i in kept]
    names = _names(found)
    return Modes(Mode(name, *one) for name, one in zip(names, found, strict=True))


class _InEulerAngles(AbstractModel):
    """A model with its quaternion replaced by three angles."""

    model: AbstractModel

    @property
    def states(self) -> tuple[str, ...]:
        at = self.model.states.index("e0")
        return self.model.states[:at] + ANGLES + self.model.states[at + 4 :]

    @property
    def inputs(self) -> tuple[str, ...]:
        return self.model.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        return self.model.outputs

    def rhs(self, t, x, u):
        inner = self.to_model(x)
        return jax.jvp(self.from_model, (inner,), (self.model.rhs(t, inner, u),))[1]

    def output(self, t, x, u):
        return self.model.output(t, self.to_model(x), u)

    def to_model(self, x: Float[Array, " state"]) -> Float[Array, " inner"]:
        at = self.states.index("phi")
        return jnp.concatenate([x[:at], quaternion(*x[at : at + 3]), x[at + 3 :]])

    def from_model(self, x: Float[Array, " inner"]) -> Float[Array, " state"]:
        at = self.model.states.index("e0")
        return jnp.concatenate([x[:at], jnp.stack(euler(x[at : at + 4])), x[at + 4 :]])


def _names(found) -> list[str]:
    """A name for each eigenvalue with its participation."""
    names = ["unnamed"] * len(found)
    share = [lambda states, p=p: sum(p.get(state, 0.0) for state in states) for _, p in found]
    pair = [value.imag > 0 for value, _ in found]
    longitudinal = [i for i, of in enumerate(share) if of(LONGITUDINAL) > 0.5]
    lateral = [i for i, of in enumerate(share) if of(LATERAL) > 0.5]

    fast = {i: share[i](SHORT) / share[i](LONGITUDINAL) for i in longitudinal}
    oscillations = sorted((i for i in longitudinal if pair[i]), key=lambda i: -fast[i])
    if len(oscillations) > 1:
        names[oscillations[0]], names[oscillations[-1]] = "short period", "phugoid"
    elif oscillations:
        (only,) = oscillations
        alone = len(longitudinal) == 1
        is_fast, is_slow = fast[only] > (0.5 if alone else CLEAR), fast[only] < (0.5 if alone else 1.0 - CLEAR)
        names[only] = "short period" if is_fast else "phugoid" if is_slow else "third oscillatory"

    yaw = {i: share[i](YAWING) / share[i](LATERAL) for i in lateral}
    oscillations = sorted((i for i in lateral if pair[i]), key=lambda i: -yaw[i])
    for rank, i in enumerate(oscillations):
        first_of_two = len(oscillations) > 1 and rank == 0
        names[i] = "dutch roll" if first_of_two or (rank == 0 and yaw[i] > 0.5) else "lateral phugoid"
    for name, states in (("roll", ROLLING), ("spiral", BANKING)):
        alike = [i for i in lateral if not pair[i] and names[i] == "unnamed"]
        most = max(alike, key=lambda i: share[i](states), default=None)
        if most is not None and share[most](states) == max(share[most](s) for s in (YAWING, ROLLING, BANKING)):
            names[most] = name
    return names


def _fed_back(A: np.ndarray, states: tuple[str, ...]) -> list[str]:
    """The states on which the rate of some state depends, those left out not counted: all but position and heading."""
    none = 1e-11 * np.max(np.abs(A), initial=0.0)
    kept = list(range(len(states)))
    while True:
        idle = [k for k in kept if np.all(np.abs(A[kept, k]) <= none)]
        if not idle:
            return [states[k] for k in kept]
        kept = [k for k in kept if k not in idle]


def _clean(value: complex) -> complex:
    """The eigenvalue without an imaginary part that is rounding."""
    return value if abs(value.imag) > REAL * abs(value) else complex(value.real, 0.0)


def _or_dash(time: float) -> str:
    return f"{time:.4g}" if math.isfinite(time) else "-"
