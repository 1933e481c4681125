"""Simulated flight in the plane of symmetry with an effect that the declared model lacks.

The aircraft is our choice: mass, inertia and size are rounded from the F-4C of Heffley & Jewell,
Aircraft Handling Qualities Data, NASA CR-2144, 1972; the coefficients are of an F-4's magnitude and
not measured.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.host import to_device
from ..._foundation.types import Array, Float
from ...data.build import record
from ...data.multisine import multisine
from ...data.signals import doublet, linear_sweep, pulses, ramp, three_two_one_one
from ...effects.augmented import Augmented
from ...models.base import AbstractModel
from ...models.free import free, with_values
from ...models.names import parameter_names, read_parameters
from ...models.polynomial import Polynomial
from ...simulation.simulate import simulate
from ...simulation.steppers import RK4
from ..effects.coefficient_term import CoefficientTerm
from .longitudinal import Longitudinal
from .simulated_flight import SimulatedFlight, smoothed

LONGITUDINAL_SPEED = 185.0  # m/s, at about 9 km
FLIGHT_SAMPLE_TIME, SAMPLES = 0.04, 501  # s
NOISE_DEG = {"alpha": 0.05, "q": 0.1, "pitch": 0.05}  # standard deviations, deg and deg/s
NOISE_SI = {"ax": 0.03, "az": 0.08, "V": 0.3}  # standard deviations, m/s^2 and m/s
LONGITUDINAL_TRAIN = ("doublets", "3-2-1-1", "multisine")
LONGITUDINAL_CHECK = ("3-2-1-1, larger", "pulls")
LONGITUDINAL_TEST = ("doublets, slow", "sweep")
DECLARED_ERROR = 0.15  # relative error of the declared coefficients, with alternating sign


def longitudinal_flight(key: Array) -> SimulatedFlight:
    """Simulate seven manoeuvres of 20 s at 25 Hz with an undeclared cubic pitching moment.

        z_i = y(t_i; truth) + e_i,    e_i ~ N(0, diag(noise^2))
        Cm = Cm0 + ... - 8 alpha^3 in the truth only

    The records are simulated by four Runge-Kutta steps between samples, from level trim at 185 m/s,
    with linear interpolation of the elevator between its samples.

    Args:
        key: random key of the measurement noise.

    Returns:
        Declared model, free parameters, records, truth and noise.

    Raises:
        InputError: if JAX is not in 64 bit.
    """
    truth, t, u, y = _fly()
    noise = jnp.array(
        [jnp.radians(NOISE_DEG[c]) if c in NOISE_DEG else NOISE_SI[c] for c in truth.outputs]
    )
    z = np.asarray(y) + np.asarray(noise) * np.asarray(jax.random.normal(key, y.shape))
    units = {
        name: unit for name, unit in truth.units().items() if name in truth.inputs + truth.outputs
    }
    records = {
        name: record(
            t, u[i], z[i], inputs=truth.inputs, outputs=truth.outputs, units=units, name=name
        )
        for i, name in enumerate((*LONGITUDINAL_TRAIN, *LONGITUDINAL_CHECK, *LONGITUDINAL_TEST))
    }
    model = declared(truth)
    chosen = free(model, "CX", "CZ", "Cm", per_record=("initial_state",))
    train, check, test = (
        tuple(records[name] for name in names)
        for names in (LONGITUDINAL_TRAIN, LONGITUDINAL_CHECK, LONGITUDINAL_TEST)
    )
    return SimulatedFlight(
        model, chosen, train, check, test, truth, noise, dict(zip(records, y, strict=True))
    )


def true_aircraft() -> Longitudinal:
    """Return the aircraft of the default flight, not trimmed and without its cubic moment."""
    return Longitudinal(
        CX=Polynomial({"1": -0.02, "alpha^2": -0.6}),
        CZ=Polynomial({"1": -0.15, "alpha": -3.2, "qhat": -5.0, "elevator": -0.45}),
        Cm=Polynomial({"1": 0.01, "alpha": -0.35, "qhat": -6.5, "elevator": -0.55}),
        mass=17700.0,
        Iy=165000.0,
        S=49.2,
        cbar=4.88,
        thrust=26000.0,
        density=0.46,
    )


def planted() -> CoefficientTerm:
    """Return the effect that the declared model lacks, a nose-down moment cubic in alpha."""
    return CoefficientTerm(
        coefficient="Cm", product="alpha^3", affected_states=("q",), gain=jnp.array(-8.0)
    )


def declared(truth: Augmented) -> AbstractModel:
    """Return the aircraft without the planted effect and with wrong coefficients.

    They are alternately 15 % too large and too small.

    Args:
        truth: the model that simulated the records.
    """
    coefficients = [
        name
        for name in parameter_names(truth.model)
        if name.partition(".")[0] in ("CX", "CZ", "Cm")
    ]
    factors = 1.0 + DECLARED_ERROR * np.where(np.arange(len(coefficients)) % 2 == 0, 1.0, -1.0)
    true = np.asarray(read_parameters(truth.model, tuple(coefficients)))
    return with_values(truth.model, coefficients, to_device(factors * true))


class LevelTrim(NamedTuple):
    """Equilibrium of level flight.

    Attributes:
        state: of the model.
        elevator: [rad].
        thrust: [N].
    """

    state: Float[Array, " state"]
    elevator: Float[Array, ""]
    thrust: Float[Array, ""]


def level_trim(
    model: AbstractModel, V: Float[Array, ""] | float, iterations: int = 20
) -> tuple[Float[Array, " state"], Float[Array, ""], Float[Array, ""]]:
    """Return state, elevator and thrust of level flight, by Newton's method.

        udot = wdot = qdot = 0    at    u = V cos(alpha), w = V sin(alpha), q = 0, pitch = alpha

    Args:
        model: model with u, w, q and pitch as its first states, the input elevator and a parameter
            `thrust`, whose value is the initial guess.
        V: speed [m/s].
        iterations: Newton steps.

    Returns:
        The trimmed state, the elevator [rad] and the thrust [N].
    """

    def state(alpha):
        extra = jnp.zeros(len(model.states) - 4)
        return jnp.concatenate(
            [jnp.stack([V * jnp.cos(alpha), V * jnp.sin(alpha), jnp.zeros(()), alpha]), extra]
        )

    def rates(unknown):
        alpha, elevator, thrust = unknown
        trimmed = with_values(model, ("thrust",), thrust[None])
        return trimmed.rhs(jnp.zeros(()), state(alpha), elevator[None])[:3]

    def newton(_, unknown):
        return unknown - jnp.linalg.solve(jax.jacfwd(rates)(unknown), rates(unknown))

    start = jnp.concatenate([jnp.array([0.1, 0.0]), read_parameters(model, ("thrust",))])
    alpha, elevator, thrust = jax.lax.fori_loop(0, iterations, newton, start)
    return LevelTrim(state(alpha), elevator, thrust)


def manoeuvres(t: Float[Array, " time"]) -> dict[str, Float[Array, " time"]]:
    """Return the elevator about its trim by manoeuvre [rad].

    It is smooth enough for linear interpolation between samples.

    Args:
        t: sample times [s].
    """
    two_doublets = doublet(t, 1.0, 1.5, 3.0) - doublet(t, 9.0, 1.2, 3.0)
    random_like = ramp(t, 0.0, 1.0) * multisine(t, 20.0, 0.1, 1.6, amplitude=1.5)[:, 0]
    commanded = {
        "doublets": two_doublets,
        "3-2-1-1": three_two_one_one(t, 1.0, 0.6, -2.5),
        "multisine": random_like,
        "3-2-1-1, larger": three_two_one_one(t, 1.0, 0.7, 3.0),
        "pulls": pulses(t, (1.0, 3.0, 9.0, 12.0), (-2.0, 0.0, -3.0)),
        "doublets, slow": doublet(t, 1.0, 2.0, -2.5) + doublet(t, 11.0, 1.0, 3.0),
        "sweep": ramp(t, 0.0, 1.0) * linear_sweep(t, 20.0, 0.1, 1.2, 2.0),
    }
    return {name: jnp.radians(smoothed(signal)) for name, signal in commanded.items()}


class _Flown(NamedTuple):
    """All manoeuvres, without noise.

    Attributes:
        truth: the trimmed aircraft with the planted effect.
        t: sample times [s].
        u: inputs.
        y: outputs.
    """

    truth: Augmented
    t: Float[Array, " time"]
    u: Float[Array, "manoeuvre time input"]
    y: Float[Array, "manoeuvre time output"]


@eqx.filter_jit
def _fly():
    """Return the trimmed truth, sample times, inputs and noise-free outputs of all manoeuvres."""
    aircraft = true_aircraft()
    trimmed, elevator, thrust = level_trim(Augmented(aircraft, (planted(),)), LONGITUDINAL_SPEED)
    truth = Augmented(eqx.tree_at(lambda model: model.thrust, aircraft, thrust), (planted(),))
    t = FLIGHT_SAMPLE_TIME * jnp.arange(SAMPLES)
    moves = manoeuvres(t)
    u = (
        elevator
        + jnp.stack(
            [moves[name] for name in (*LONGITUDINAL_TRAIN, *LONGITUDINAL_CHECK, *LONGITUDINAL_TEST)]
        )[..., None]
    )
    y = jax.vmap(lambda u: simulate(truth, t, u, trimmed, stepper=RK4(4, unrolled=False)).y)(u)
    return _Flown(truth, t, u, y)
