"""Modes of motion with their names, and the linearisation in Euler angles."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.checks import require, require_known
from ..._foundation.types import Array, Float, Numbers
from ...models.base import AbstractModel
from ...simulation.linearise import Linearisation, linearise
from ..physics.frames import euler, quaternion

# the eight states of the classical modes
CLASSICAL = ("u", "w", "q", "pitch", "v", "p", "r", "phi")
SHORT, LONG = ("w", "q", "alpha"), ("u", "pitch", "V", "gamma")
YAWING, ROLLING, BANKING = ("v", "r", "beta"), ("p",), ("phi",)
LONGITUDINAL_MODE_STATES, LATERAL_MODE_STATES = SHORT + LONG, YAWING + ROLLING + BANKING
QUATERNION, EULER_ANGLES = ("e0", "e1", "e2", "e3"), ("phi", "pitch", "psi")
# chosen: share of the fast or slow states that makes a single oscillation a short period or phugoid
CLEAR_SHARE = 0.65
MAX_CONDITION = 1e12  # chosen: above this condition number two eigenvectors coincide
REAL_RTOL = 1e-9  # chosen: a smaller imaginary part relative to the eigenvalue is rounding


class Mode(NamedTuple):
    """A mode: a real eigenvalue, or the upper one of a complex pair.

    Attributes:
        name: short period, phugoid, third oscillatory; dutch roll, roll, spiral, lateral phugoid;
            otherwise unnamed.
        eigenvalue: eigenvalue [rad/s].
        participation: participation of each state in the mode; the shares add up to one and are
            independent of units.
    """

    name: str
    eigenvalue: complex
    participation: Mapping[str, float]

    @property
    def oscillatory(self) -> bool:
        """True for a pair of complex eigenvalues."""
        return self.eigenvalue.imag > 0

    @property
    def natural_frequency(self) -> float:
        """Natural frequency `|eigenvalue|` [rad/s]."""
        return abs(self.eigenvalue)

    @property
    def damping(self) -> float:
        """Damping ratio `-Re(eigenvalue)/|eigenvalue|`.

        It is 1 or -1 for a real eigenvalue, NaN for an eigenvalue of zero.
        """
        return -self.eigenvalue.real / abs(self.eigenvalue) if self.eigenvalue else math.nan

    @property
    def period(self) -> float:
        """Period `2 pi/Im(eigenvalue)` [s], infinite for a real eigenvalue."""
        return 2.0 * math.pi / self.eigenvalue.imag if self.oscillatory else math.inf

    @property
    def time_to_half(self) -> float:
        """Time to half amplitude `ln 2/-Re(eigenvalue)` [s], infinite without decay."""
        return math.log(2.0) / -self.eigenvalue.real if self.eigenvalue.real < 0 else math.inf

    @property
    def time_to_double(self) -> float:
        """Time to double amplitude `ln 2/Re(eigenvalue)` [s], infinite without growth."""
        return math.log(2.0) / self.eigenvalue.real if self.eigenvalue.real > 0 else math.inf


class Modes(tuple[Mode, ...]):
    """Modes of a linearisation, fastest first; they print as a table."""

    def named(self, name: str) -> Mode:
        """Return the mode with a name.

        Args:
            name: name of the mode.

        Raises:
            InputError: if no mode has this name, or more than one.
        """
        require_known("mode", [name], dict.fromkeys(mode.name for mode in self))
        matches = [mode for mode in self if mode.name == name]
        require(
            len(matches) == 1,
            f"There are {len(matches)} modes called {name!r}; take them by position.",
        )
        return matches[0]

    def __str__(self) -> str:
        width = max([len(mode.name) for mode in self] + [4])
        head = f"{'mode':<{width}} {'eigenvalue [rad/s]':>22} {'wn [rad/s]':>11} {'damping':>8}"
        head += f" {'period [s]':>11} {'half in [s]':>12} {'double in [s]':>14}"
        lines = [f"{head}  main states"]
        for mode in self:
            value = f"{mode.eigenvalue.real:.4g}"
            if mode.oscillatory:
                value += f" +- {mode.eigenvalue.imag:.4g}i"
            numbers = (
                f"{mode.natural_frequency:>11.4g} {mode.damping:>8.3f} {_or_dash(mode.period):>11}"
            )
            times = f"{_or_dash(mode.time_to_half):>12} {_or_dash(mode.time_to_double):>14}"
            most = sorted(mode.participation.items(), key=lambda item: -item[1])[:3]
            shares = ", ".join(f"{state} {share:.0%}" for state, share in most if share > 0.05)
            lines.append(f"{mode.name:<{width}} {value:>22} {numbers} {times}  {shares}".rstrip())
        return "\n".join(lines)

    __repr__ = __str__


def linearise_euler(
    aircraft: AbstractModel,
    t: Float[Numbers, ""] | float,
    x: Float[Numbers, " state"],
    u: Float[Numbers, " input"],
) -> Linearisation:
    """Return the linearisation of a model with Euler angles in place of its quaternion.

        d/dt (phi, pitch, psi) = d euler/de  edot( e(phi, pitch, psi) )

    The quaternion `e0 e1 e2 e3` has a redundant element, whose mode has no meaning. The function is
    pure, like `linearise`.

    Args:
        aircraft: model with the four consecutive states `e0` to `e3`.
        t: time [s].
        x: state, at a pitch other than 90 deg.
        u: input.

    Returns:
        Matrices with `phi`, `pitch` and `psi` [rad] among the states; take the classical eight with
        `reduced(states=CLASSICAL)`, which holds surfaces and engines constant.

    Raises:
        InputError: if the model has no quaternion, or a shape does not match.
    """
    require(
        all(name in aircraft.states for name in QUATERNION),
        f"The model has no quaternion {', '.join(QUATERNION)} among its states: "
        f"{', '.join(aircraft.states)}. Use `linearise`.",
    )
    x = jnp.asarray(x, float)
    require(
        x.shape == (len(aircraft.states),),
        f"x has shape {x.shape}; the model has {len(aircraft.states)} states.",
    )
    # pyright counts equinox's abstract fields as arguments of the constructor
    wrapped = _InEulerAngles(aircraft)  # pyright: ignore[reportCallIssue]
    return linearise(wrapped, t, wrapped.from_model(x), u)


def modes(linearisation: Linearisation) -> Modes:
    """Return the modes of a linearisation, named by their participation and not by their order.

        A v = lambda v,    w' A = lambda w'
        participation of state k: |w_k v_k| / sum over all states

    Participation is independent of the units of the states. A mode is longitudinal or lateral by
    the larger share of its participation. Of two longitudinal oscillations the one with more of w
    and q is the short period, the other the phugoid; a single one between the two is the third
    oscillatory mode of an aircraft without static stability. A lateral oscillation mainly in v and
    r is the dutch roll, one mainly in p and phi the lateral phugoid (roll and spiral coupled, as at
    high alpha); a real mode mainly in p is the roll, one mainly in phi the spiral.

    Args:
        linearisation: linearisation of a single case, at an equilibrium, with states called u w q
            pitch, v p r phi or the wind-axis V alpha gamma beta; from `linearise_euler` for an
            aircraft with a quaternion. Further states (actuators, altitude) are allowed; states on
            which no rate depends, position and heading, are left out.

    Returns:
        The modes, fastest first.

    Raises:
        InputError: for a batch, a matrix that is not finite, or states of a quaternion.
    """
    A = np.asarray(linearisation.A)
    require(
        A.ndim == 2,
        f"A has shape {A.shape}. Take one case out of the batch, as with jax.tree.map(lambda a: "
        "a[0], ...).",
    )
    require(
        bool(np.all(np.isfinite(A))),
        "The linearisation is not finite: the model diverges at this point.",
    )
    require(
        not set(QUATERNION) & set(linearisation.states),
        "With a quaternion the classical modes are not visible. Linearise with `linearise_euler`.",
    )
    states = _coupled_states(A, linearisation.states)
    at = np.array([linearisation.states.index(name) for name in states], int)
    values, right = np.linalg.eig(A[np.ix_(at, at)])
    require(
        bool(np.linalg.cond(right) < MAX_CONDITION),
        "Two modes coincide: A has no full set of eigenvectors. Keep the relevant states with "
        "`reduced(states=...)`, such as jaxid.aircraft.flight.modes.CLASSICAL.",
    )
    left = np.linalg.inv(right)
    share = np.abs(left.T * right)
    share /= np.sum(share, axis=0)
    eigenvalues = [_clean(complex(value)) for value in values]
    order = np.argsort(-np.abs(values), kind="stable")
    kept = [int(i) for i in order if eigenvalues[i].imag >= 0]
    participation = [dict(zip(states, map(float, share[:, i]), strict=True)) for i in kept]
    pairs = list(zip([eigenvalues[i] for i in kept], participation, strict=True))
    return Modes(Mode(name, *pair) for name, pair in zip(_names(pairs), pairs, strict=True))


class _InEulerAngles(AbstractModel):
    """Model with three Euler angles in place of its quaternion."""

    model: AbstractModel

    @property
    def states(self) -> tuple[str, ...]:
        at = self.model.states.index("e0")
        return self.model.states[:at] + EULER_ANGLES + self.model.states[at + 4 :]

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


def _names(pairs) -> list[str]:
    """Return a name for each pair of eigenvalue and participation."""
    longitudinal = [
        i for i, (_, parts) in enumerate(pairs) if _share(parts, LONGITUDINAL_MODE_STATES) > 0.5
    ]
    lateral = [i for i, (_, parts) in enumerate(pairs) if _share(parts, LATERAL_MODE_STATES) > 0.5]
    named = _longitudinal_names(pairs, longitudinal) | _lateral_names(pairs, lateral)
    return [named.get(i, "unnamed") for i in range(len(pairs))]


def _longitudinal_names(pairs, members: list[int]) -> dict[int, str]:
    """Return names of the longitudinal oscillations, by index of the eigenvalue."""
    fast = {
        i: _share(pairs[i][1], SHORT) / _share(pairs[i][1], LONGITUDINAL_MODE_STATES)
        for i in members
    }
    oscillations = sorted(_oscillatory(pairs, members), key=lambda i: -fast[i])
    if not oscillations:
        return {}
    if len(oscillations) > 1:
        return {oscillations[0]: "short period", oscillations[-1]: "phugoid"}
    (single,) = oscillations
    clear = 0.5 if len(members) == 1 else CLEAR_SHARE
    if fast[single] > clear:
        return {single: "short period"}
    return {single: "phugoid" if fast[single] < 1.0 - clear else "third oscillatory"}


def _lateral_names(pairs, members: list[int]) -> dict[int, str]:
    """Return names of the lateral modes, by index of the eigenvalue."""
    yaw = {
        i: _share(pairs[i][1], YAWING) / _share(pairs[i][1], LATERAL_MODE_STATES) for i in members
    }
    oscillations = sorted(_oscillatory(pairs, members), key=lambda i: -yaw[i])
    names = dict.fromkeys(oscillations, "lateral phugoid")
    if oscillations and (len(oscillations) > 1 or yaw[oscillations[0]] > 0.5):
        names[oscillations[0]] = "dutch roll"
    return names | _root_names(pairs, [i for i in members if i not in names])


def _root_names(pairs, roots: list[int]) -> dict[int, str]:
    """Return names of the real lateral eigenvalues, by index: largest roll, then largest bank."""
    names: dict[int, str] = {}
    for name, states in (("roll", ROLLING), ("spiral", BANKING)):
        others = [i for i in roots if i not in names]
        if not others:
            break
        most = max(others, key=lambda i: _share(pairs[i][1], states))
        shares = [_share(pairs[most][1], group) for group in (YAWING, ROLLING, BANKING)]
        if _share(pairs[most][1], states) == max(shares):
            names[most] = name
    return names


def _oscillatory(pairs, members: list[int]) -> list[int]:
    return [i for i in members if pairs[i][0].imag > 0]


def _share(participation, states) -> float:
    """Return the participation of a group of states."""
    return sum(participation.get(state, 0.0) for state in states)


def _coupled_states(A: np.ndarray, states: tuple[str, ...]) -> list[str]:
    """Return the states on which rates of the returned states depend.

    Position and heading are left out.
    """
    zero = 1e-11 * np.max(np.abs(A), initial=0.0)
    kept = list(range(len(states)))
    while True:
        idle = [k for k in kept if np.all(np.abs(A[kept, k]) <= zero)]
        if not idle:
            return [states[k] for k in kept]
        kept = [k for k in kept if k not in idle]


def _clean(value: complex) -> complex:
    """Return the eigenvalue, without an imaginary part that is rounding."""
    return value if abs(value.imag) > REAL_RTOL * abs(value) else complex(value.real, 0.0)


def _or_dash(time: float) -> str:
    return f"{time:.4g}" if math.isfinite(time) else "-"
