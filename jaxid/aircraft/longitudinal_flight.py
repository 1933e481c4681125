"""A simulated flight with something in it that the declared model lacks, in the plane of symmetry.

The aircraft is our choice: mass, inertia and size are rounded from the F-4C of Heffley & Jewell, Aircraft Handling
Qualities Data, NASA CR-2144, 1972; the coefficients are of an F-4's magnitude and not measured.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.types import Array, Float
from ..data.build import record
from ..data.multisine import multisine
from ..data.signals import doublet, linear_sweep, pulses, ramp, three_two_one_one
from ..models.augmented import Augmented
from ..models.base import AbstractModel
from ..models.free import free, with_values
from ..models.names import parameter_names, read
from ..models.polynomial import Polynomial
from ..simulation.simulate import simulate
from ..simulation.steppers import Adaptive
from .effects import CoefficientTerm
from .longitudinal import Longitudinal
from .simulated_flight import SimulatedFlight, smoothed

SPEED = 185.0  # m/s, at about 9 km
SAMPLE_TIME, SAMPLES = 0.04, 501  # s
NOISE_DEG = {"alpha": 0.05, "q": 0.1, "pitch": 0.05}  # standard deviations, deg and deg/s
NOISE_SI = {"ax": 0.03, "az": 0.08, "V": 0.3}  # standard deviations, m/s^2 and m/s
TRAIN = ("doublets", "3-2-1-1", "multisine")
CHECK = ("3-2-1-1, larger", "pulls")
TEST = ("doublets, slow", "sweep")
STARTS_OFF = 0.15  # by how much the declared coefficients are wrong, with alternating sign


def longitudinal_flight(key: Array) -> SimulatedFlight:
    """Simulate seven manoeuvres of 20 s at 25 Hz around level flight, with a cubic pitching moment undeclared.

        z_i = y(t_i; truth) + e_i,    e_i ~ N(0, diag(noise^2)),    Cm = Cm0 + ... - 8 alpha^3 in the truth only

    The records are made by an adaptive Runge-Kutta method of order five, from level trim at 185 m/s, the elevator in
    straight lines between its samples.

    Args:
        key: of the measurement noise.

    Returns:
        Declared model, free parameters, records, truth and noise.

    Raises:
        InputError: when JAX is not in 64 bit.
    """
    truth, t, u, y = _fly()
    noise = jnp.array([jnp.radians(NOISE_DEG[c]) if c in NOISE_DEG else NOISE_SI[c] for c in truth.outputs])
    z = np.asarray(y) + np.asarray(noise) * np.asarray(jax.random.normal(key, y.shape))
    units = {name: unit for name, unit in truth.units().items() if name in truth.inputs + truth.outputs}
    flown = {
        name: record(t, u[i], z[i], inputs=truth.inputs, outputs=truth.outputs, units=units, name=name)
        for i, name in enumerate((*TRAIN, *CHECK, *TEST))
    }
    model = declared(truth)
    chosen = free(model, "CX", "CZ", "Cm", per_record=("initial_state",))
    train, check, test = (tuple(flown[name] for name in names) for names in (TRAIN, CHECK, TEST))
    return SimulatedFlight(model, chosen, train, check, test, truth, noise, dict(zip(flown, y, strict=True)))


def true_aircraft() -> Longitudinal:
    """The aircraft of the default flight, its thrust not trimmed and its cubic moment left out."""
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
    """What the declared model lacks: a nose-down moment that grows with the cube of the angle of attack."""
    return CoefficientTerm(coefficient="Cm", product="alpha^3", moved=("q",), gain=jnp.array(-8.0))


def declared(truth: Augmented) -> AbstractModel:
    """The aircraft without the planted effect, its coefficients wrong by 15 %, in turn too large and too small."""
    coefficients = [name for name in parameter_names(truth.model) if name.partition(".")[0] in ("CX", "CZ", "Cm")]
    off = 1.0 + STARTS_OFF * jnp.where(jnp.arange(len(coefficients)) % 2 == 0, 1.0, -1.0)
    return with_values(truth.model, coefficients, off * read(truth.model, tuple(coefficients)))


def level_trim(
    model: AbstractModel, V: Float[Array, ""] | float, iterations: int = 20
) -> tuple[Float[Array, " state"], Float[Array, ""], Float[Array, ""]]:
    """Angle of attack, elevator and thrust for level flight, by Newton's method.

        udot = wdot = qdot = 0    at    u = V cos(alpha), w = V sin(alpha), q = 0, pitch = alpha

    Args:
        model: has the states u, w, q and pitch first, the input elevator and a parameter `thrust`, which is the start.
        V: speed [m/s].
        iterations: Newton steps.

    Returns:
        The trimmed state, the elevator [rad] and the thrust [N].
    """

    def state(alpha):
        extra = jnp.zeros(len(model.states) - 4)
        return jnp.concatenate([jnp.stack([V * jnp.cos(alpha), V * jnp.sin(alpha), jnp.zeros(()), alpha]), extra])

    def rates(unknown):
        alpha, elevator, thrust = unknown
        trimmed = with_values(model, ("thrust",), thrust[None])
        return trimmed.rhs(jnp.zeros(()), state(alpha), elevator[None])[:3]

    def newton(_, unknown):
        return unknown - jnp.linalg.solve(jax.jacfwd(rates)(unknown), rates(unknown))

    start = jnp.concatenate([jnp.array([0.1, 0.0]), read(model, ("thrust",))])
    alpha, elevator, thrust = jax.lax.fori_loop(0, iterations, newton, start)
    return state(alpha), elevator, thrust


def manoeuvres(t: Float[Array, " time"]) -> dict[str, Float[Array, " time"]]:
    """The elevator about its trim in each manoeuvre, smooth enough for straight lines between samples [rad].

    Args:
        t: sample times [s].
    """
    there_and_back = doublet(t, 1.0, 1.5, 3.0) - doublet(t, 9.0, 1.2, 3.0)
    random_like = ramp(t, 0.0, 1.0) * multisine(t, 20.0, 0.1, 1.6, amplitude=1.5)[:, 0]
    commanded = {
        "doublets": there_and_back,
        "3-2-1-1": three_two_one_one(t, 1.0, 0.6, -2.5),
        "multisine": random_like,
        "3-2-1-1, larger": three_two_one_one(t, 1.0, 0.7, 3.0),
        "pulls": pulses(t, (1.0, 3.0, 9.0, 12.0), (-2.0, 0.0, -3.0)),
        "doublets, slow": doublet(t, 1.0, 2.0, -2.5) + doublet(t, 11.0, 1.0, 3.0),
        "sweep": ramp(t, 0.0, 1.0) * linear_sweep(t, 20.0, 0.1, 1.2, 2.0),
    }
    return {name: jnp.radians(smoothed(signal)) for name, signal in commanded.items()}


@eqx.filter_jit
def _fly():
    """The trimmed truth, the sample times, and the inputs and outputs of all manoeuvres, free of noise."""
    aircraft = true_aircraft()
    trimmed, elevator, thrust = level_trim(Augmented(aircraft, (planted(),)), SPEED)
    truth = Augmented(eqx.tree_at(lambda model: model.thrust, aircraft, thrust), (planted(),))
    t = SAMPLE_TIME * jnp.arange(SAMPLES)
    moves = manoeuvres(t)
    u = elevator + jnp.stack([moves[name] for name in (*TRAIN, *CHECK, *TEST)])[..., None]
    y = jax.vmap(lambda u: simulate(truth, t, u, trimmed, stepper=Adaptive()).y)(u)
    return truth, t, u, y
