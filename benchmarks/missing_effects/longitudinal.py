"""An aircraft of an F-4's size in its plane of symmetry, with polynomials for coefficients
(`jaxid.aircraft.Longitudinal`).

The truth is integrated by an adaptive method of order five.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.missing_effects.scenarios import (
    CHECK,
    TEST,
    TRAIN,
    Flown,
    Scenario,
    System,
    planted,
    scenario,
)
from benchmarks.missing_effects.truth import noise_of
from benchmarks.missing_effects.truth_effects import recorded
from jaxid import AbstractModel, free, record
from jaxid.aircraft.effects.coefficient_term import CoefficientTerm
from jaxid.aircraft.flight.longitudinal import LONGITUDINAL_AFFECTED_STATES
from jaxid.aircraft.flight.longitudinal_flight import (
    FLIGHT_SAMPLE_TIME,
    LONGITUDINAL_SPEED,
    NOISE_DEG,
    NOISE_SI,
    SAMPLES,
    declared,
    level_trim,
    manoeuvres,
    true_aircraft,
)
from jaxid.effects import (
    Augmented,
    InputDelay,
    InputLag,
    Location,
    LocationKind,
    SensorBias,
    SensorDelay,
    SensorScale,
)
from jaxid.models.names import read_parameters
from jaxid.simulation.simulate import simulate
from jaxid.simulation.steppers import Adaptive

WINDOW = 50
GUST_TIME = 1.0  # s, of the memory of a vertical gust


class Gusty(AbstractModel):
    """The aircraft in vertical gusts, a second input [m/s]: its coefficients feel the air, its vane
    and its pitot tube too.
    """

    model: AbstractModel
    states: tuple[str, ...] = eqx.field(static=True)
    inputs: tuple[str, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    def __init__(self, model: AbstractModel):
        self.model = model
        self.states, self.inputs, self.outputs = (
            model.states,
            (*model.inputs, "gust"),
            model.outputs,
        )

    def rhs(self, t, x, u):
        # The rotation term in moving axes uses the velocity over ground, not the airspeed.
        rates = self.model.rhs(t, x.at[1].add(u[1]), u[:1])
        return rates.at[0].add(x[2] * u[1])

    def output(self, t, x, u):
        ground = self.model.output_given(t, x, u[:1], self.rhs(t, x, u))
        through_air = self.model.output_given(t, x.at[1].add(u[1]), u[:1], self.rhs(t, x, u))
        feels_air = np.array([self.outputs.index(name) for name in ("alpha", "V")])
        return ground.at[feels_air].set(through_air[feels_air])

    def observe(self, t, y):
        return self.model.observe(t, y)

    def input_signal(self, path):
        return self.model.input_signal(path)


def fly(wanted: Scenario, seed: int) -> Flown:
    """Seven manoeuvres of 20 s, each larger or smaller by up to a third, to either side.

    Settings: `memory` colours the noise, `weak` scales the elevator, `thrust` is the share of the
    trimmed one that is left, known, `gaps` is the share of missing samples, and `gust` the size of
    vertical gusts [m/s].
    """
    have, generator = wanted.setting, wanted.generator(seed)
    count = TRAIN + CHECK + TEST
    size = (
        generator.uniform(0.7, 1.3, count)
        * generator.choice([-1.0, 1.0], count)
        * have.get("weak", 1.0)
    )
    gust = have.get("gust", 0.0) * noise_of(
        generator, (count, SAMPLES), np.exp(-FLIGHT_SAMPLE_TIME / GUST_TIME)
    )
    truth, t, u, y = _flown(
        wanted.effects, jnp.asarray(size), jnp.asarray(gust), jnp.array(have.get("thrust", 1.0))
    )
    noise = np.array(
        [np.radians(NOISE_DEG[c]) if c in NOISE_DEG else NOISE_SI[c] for c in truth.outputs]
    )
    z = np.asarray(y) + noise * noise_of(generator, y.shape, have.get("memory", 0.0))
    z = recorded(wanted.effects, z, truth.outputs)
    if "gaps" in have:
        z[generator.uniform(size=z.shape) < have["gaps"]] = np.nan
    return given(truth.model, truth, t, u, z)


def given(aircraft, truth: Augmented, t, u, z) -> Flown:
    """Return the declared aircraft and its records.

    Args:
        aircraft: the true one without the planted effects.
        truth: the true one.
        t: sample times [s].
        u, z: recorded inputs and outputs, shape (manoeuvre, time, channel).
    """
    names = truth.inputs + truth.outputs
    units = {name: unit for name, unit in truth.units().items() if name in names}
    channels = {"inputs": truth.inputs, "outputs": truth.outputs, "units": units}
    flown = [
        record(t, one, readings, **channels, name=f"record {i}")
        for i, (one, readings) in enumerate(zip(np.asarray(u), z, strict=True))
    ]
    model = declared(truth)
    chosen = free(model, "CX", "CZ", "Cm", per_record=("initial_state",))
    values = np.asarray(read_parameters(aircraft, chosen.shared)).tolist()
    true = dict(zip(chosen.shared, values, strict=True))
    parts = flown[:TRAIN], flown[TRAIN : TRAIN + CHECK], flown[TRAIN + CHECK :]
    return Flown(model, chosen, *parts, true)


@eqx.filter_jit
def _flown(effects, size, gust, thrust):
    """The trimmed truth, sample times, inputs and outputs of all manoeuvres."""
    aircraft = true_aircraft()
    steady = tuple(one for one in effects if isinstance(one, CoefficientTerm))
    trimmed, elevator, needed = level_trim(Augmented(aircraft, steady), LONGITUDINAL_SPEED)
    aircraft = eqx.tree_at(lambda model: model.thrust, aircraft, thrust * needed)
    truth = Augmented(aircraft, effects)
    t = FLIGHT_SAMPLE_TIME * jnp.arange(SAMPLES)
    u = elevator + (size[:, None] * jnp.stack(list(manoeuvres(t).values())))[..., None]
    moving = Gusty(truth)
    actuators = jnp.full(len(truth.states) - trimmed.size, elevator)  # lagged states start at rest
    start = jnp.concatenate([trimmed, actuators])

    def one(u, gust):
        return simulate(
            moving, t, jnp.concatenate([u, gust[:, None]], axis=1), start, stepper=Adaptive()
        ).y

    return truth, t, u, jax.vmap(one)(u, gust)


def system() -> System:
    """The aircraft with its scenarios; sizes from faint (chi-square about 60) to gross."""
    return System("longitudinal", True, False, WINDOW, (*_singles(), *_doubles(), *_others()), fly)


def _term(coefficient: str, product: str, gain: float):
    places = {
        "CX": (Location(LocationKind.EQUATION, "u"),),
        "CZ": (Location(LocationKind.EQUATION, "w"),),
        "Cm": (Location(LocationKind.EQUATION, "q"),),
    }[coefficient]
    return planted(
        CoefficientTerm,
        coefficient,
        product,
        LONGITUDINAL_AFFECTED_STATES[coefficient],
        gain=gain,
        places=places,
    )


def _singles() -> tuple[Scenario, ...]:
    elevator = (Location(LocationKind.INPUT, "elevator"), Location(LocationKind.EQUATION, "q"))
    return (
        scenario("cubic moment, faint", _term("Cm", "alpha^3", -0.5)),
        scenario("cubic moment", _term("Cm", "alpha^3", -8.0)),
        scenario("square moment", _term("Cm", "alpha^2", -0.5)),
        scenario("damping grows with alpha", _term("Cm", "alpha qhat", -60.0)),
        scenario("elevator loses effect", _term("Cm", "alpha elevator", 2.0)),
        scenario("lift bends over", _term("CZ", "alpha^2", 3.0)),
        scenario("elevator delay", planted(InputDelay, "elevator", gain=0.03, places=elevator)),
        scenario(
            "elevator actuator", planted(InputLag, "elevator", gain=1.0, time=0.1, places=elevator)
        ),
        scenario(
            "scale of the vane",
            planted(
                SensorScale, "alpha", gain=0.05, places=(Location(LocationKind.SENSOR, "alpha"),)
            ),
        ),
        scenario(
            "late vane",
            planted(
                SensorDelay, "alpha", gain=0.05, places=(Location(LocationKind.SENSOR, "alpha"),)
            ),
        ),
        scenario(
            "bias of the pitch gyro",
            planted(SensorBias, "q", gain=0.001, places=(Location(LocationKind.SENSOR, "q"),)),
        ),
    )


def _doubles() -> tuple[Scenario, ...]:
    actuator = planted(
        InputLag,
        "elevator",
        gain=1.0,
        time=0.1,
        places=(Location(LocationKind.INPUT, "elevator"), Location(LocationKind.EQUATION, "q")),
    )
    gyro = planted(SensorBias, "q", gain=0.001, places=(Location(LocationKind.SENSOR, "q"),))
    return (
        scenario("cubic moment and actuator", _term("Cm", "alpha^3", -8.0), actuator),
        scenario("lift bends over and biased gyro", _term("CZ", "alpha^2", 3.0), gyro),
    )


def _others() -> tuple[Scenario, ...]:
    settings = {
        "plain": {},
        "coloured noise": {"memory": 0.7},
        "weak inputs": {"weak": 0.1},
        "decelerating": {"thrust": 0.2},
        "missing samples": {"gaps": 0.3},
    }
    controls = tuple(Scenario(name, "control", (), setting) for name, setting in settings.items())
    return (*controls, Scenario("vertical gusts", "process", (), {"gust": 1.0}))
