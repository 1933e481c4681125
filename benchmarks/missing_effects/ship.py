"""A ship that manoeuvres at constant speed: sway, yaw and roll, with the rudder known.

Our own choice of numbers, of a container ship's magnitude: 175 m long, 8 m/s, a roll period of 14
s.
"""

import jax.numpy as jnp
import numpy as np

from benchmarks.missing_effects import truth
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
from jaxid import AbstractModel, free, record
from jaxid._foundation.types import Array
from jaxid.effects import (
    InputDelay,
    InputLag,
    InputRateLimit,
    Location,
    LocationKind,
    QuadraticDrag,
    SensorBias,
    SensorCrossTalk,
    SensorDelay,
    SensorLag,
    SensorScale,
    Term,
)

STEP, SAMPLES, WINDOW = 0.5, 400, 60  # s
# standard deviations [m/s, rad/s, rad/s, rad]
NOISE = {"v": 0.05, "r": 0.0005, "p": 0.002, "phi": 0.002}
TRUE = {
    **{"Yv": -0.03, "Yr": -3.0, "Yd": -0.05, "Nv": -0.0003, "Nr": -0.06, "Nd": 0.008},
    **{"Kv": 0.01, "Kd": -0.06, "stiffness": 0.2, "damping": 0.05},
}
# Relative errors of the declared values, in turn too large and too small; chosen.
STATES, OFF = ("v", "r", "p", "phi"), 0.2
SWAY, YAW, ROLL, RUDDER = (
    (Location(LocationKind.EQUATION, "v"),),
    (Location(LocationKind.EQUATION, "r"),),
    (Location(LocationKind.EQUATION, "p"),),
    (Location(LocationKind.INPUT, "rudder"),),
)


class Ship(AbstractModel):
    """`dv/dt = Yv v + Yr r + Yd rudder`, `dr/dt = Nv v + Nr r + Nd rudder`, and roll that both
    drive.

    dp/dt = Kv v + Kd rudder - stiffness phi - damping p - quadratic |p| p,    dphi/dt = p

    `quadratic` is known, `bias` is that of the inclinometer.
    """

    Yv: Array
    Yr: Array
    Yd: Array
    Nv: Array
    Nr: Array
    Nd: Array
    Kv: Array
    Kd: Array
    stiffness: Array
    damping: Array
    quadratic: Array
    bias: Array
    states, inputs, outputs = STATES, ("rudder",), STATES

    def rhs(self, t, x, u):
        v, r, p, phi = x
        rudder = u[0]
        sway = self.Yv * v + self.Yr * r + self.Yd * rudder
        yaw = self.Nv * v + self.Nr * r + self.Nd * rudder
        roll = self.Kv * v + self.Kd * rudder - self.stiffness * phi - self.damping * p
        return jnp.stack([sway, yaw, roll - self.quadratic * jnp.abs(p) * p, p])

    def output(self, t, x, u):
        return jnp.stack([x[0], x[1], x[2], x[3] + self.bias])

    def units(self):
        return {"v": "m/s", "r": "rad/s", "p": "rad/s", "phi": "rad", "rudder": "rad"}


def plant(quadratic: float) -> truth.Plant:
    """Return the equations in NumPy."""

    def rates(s):
        k = TRUE
        sway = k["Yv"] * s["v"] + k["Yr"] * s["r"] + k["Yd"] * s["rudder"]
        yaw = k["Nv"] * s["v"] + k["Nr"] * s["r"] + k["Nd"] * s["rudder"]
        roll = (
            k["Kv"] * s["v"]
            + k["Kd"] * s["rudder"]
            - k["stiffness"] * s["phi"]
            - k["damping"] * s["p"]
        )
        return {"v": sway, "r": yaw, "p": roll - quadratic * np.abs(s["p"]) * s["p"], "phi": s["p"]}

    return truth.Plant(
        STATES, ("rudder",), STATES, rates, lambda s, _: {name: s[name] for name in STATES}
    )


def steered(generator: np.random.Generator, records: int) -> np.ndarray:
    """Return rudder angles with random steps [rad].

    Steps come every 5 to 25 s, reach up to 15 deg, and are smoothed over 3 s.
    """
    rudder = np.zeros((records, SAMPLES))
    for one in rudder:
        at = 10
        while at < SAMPLES:
            length = int(generator.uniform(5.0, 25.0) / STEP)
            one[at : at + length] = np.radians(generator.uniform(-15.0, 15.0))
            at += length
    return np.array(
        [np.convolve(np.pad(one, 3, "edge"), np.ones(7) / 7, "valid") for one in rudder]
    )


def fly(wanted: Scenario, seed: int) -> Flown:
    """Seven records of 200 s.

    Settings, in addition to those of `truth.measured`: `weak` scales the rudder,
    `quadratic` damping is known; a `bias` of the inclinometer is declared and free.
    """
    have, generator = wanted.setting, wanted.generator(seed)
    count, t = TRAIN + CHECK + TEST, STEP * np.arange(SAMPLES)
    rudder = have.get("weak", 1.0) * steered(generator, count)
    start = {name: np.zeros(count) for name in STATES}
    equations = plant(have.get("quadratic", 0.0))
    z = truth.measured(
        equations,
        wanted.effects,
        generator,
        have,
        t,
        {"rudder": rudder},
        start,
        tuple(NOISE.values()),
    )
    flown = [
        record(t, u[:, None], y, inputs=Ship.inputs, outputs=Ship.outputs, name=f"record {i}")
        for i, (u, y) in enumerate(zip(rudder, z, strict=True))
    ]
    off = {
        name: jnp.array(value * (1.0 + OFF * (-1) ** i))
        for i, (name, value) in enumerate(TRUE.items())
    }
    model = Ship(**off, quadratic=jnp.array(have.get("quadratic", 0.0)), bias=jnp.array(0.0))
    chosen = free(
        model, *TRUE, *(("bias",) if "bias" in have else ()), per_record=("initial_state",)
    )
    parts = flown[:TRAIN], flown[TRAIN : TRAIN + CHECK], flown[TRAIN + CHECK :]
    return Flown(model, chosen, *parts, TRUE, tuple(NOISE.values()))


def system() -> System:
    """The ship with its scenarios; sizes from faint (chi-square about 60) to gross."""
    return System(
        "ship", False, False, WINDOW, (*_singles(), *_doubles(), *_controls(), *_waves()), fly
    )


def _singles() -> tuple[Scenario, ...]:
    constant = (*ROLL, Location(LocationKind.SENSOR, "phi"))
    return (
        scenario(
            "cross-flow drag, faint", planted(QuadraticDrag, "v", "v", gain=-0.0009, places=SWAY)
        ),
        scenario("cross-flow drag", planted(QuadraticDrag, "v", "v", gain=-0.01, places=SWAY)),
        scenario(
            "quadratic roll damping, faint",
            planted(QuadraticDrag, "p", "p", gain=-0.1, places=ROLL),
        ),
        scenario(
            "quadratic roll damping", planted(QuadraticDrag, "p", "p", gain=-1.0, places=ROLL)
        ),
        scenario("cubic righting moment", planted(Term, "p", "phi^3", gain=-3.0, places=ROLL)),
        scenario("Norrbin's cubic", planted(Term, "r", "r^3", gain=-50.0, places=YAW)),
        scenario("rudder stall", planted(Term, "r", "rudder^3", gain=-0.02, places=YAW)),
        scenario("yaw from heel in sway", planted(Term, "r", "v phi", gain=0.002, places=YAW)),
        scenario("rudder delay", planted(InputDelay, "rudder", gain=0.5, places=RUDDER)),
        scenario(
            "steering gear's lag", planted(InputLag, "rudder", gain=1.0, time=2.0, places=RUDDER)
        ),
        scenario(
            "steering gear's rate limit",
            planted(InputRateLimit, "rudder", gain=1.0, limit=0.04, places=RUDDER),
        ),
        scenario(
            "scale of the yaw gyro",
            planted(SensorScale, "r", gain=0.05, places=(Location(LocationKind.SENSOR, "r"),)),
        ),
        scenario(
            "bias of the inclinometer",
            planted(SensorBias, "phi", gain=0.002, places=constant, also=("bias of phi", "1 in p")),
        ),
        scenario(
            "delay of the log",
            planted(SensorDelay, "v", gain=1.0, places=(Location(LocationKind.SENSOR, "v"),)),
        ),
        scenario(
            "lag of the inclinometer",
            planted(SensorLag, "phi", gain=0.3, places=(Location(LocationKind.SENSOR, "phi"),)),
        ),
        scenario(
            "cross-talk of the gyros",
            planted(
                SensorCrossTalk, "r", "p", gain=0.05, places=(Location(LocationKind.SENSOR, "r"),)
            ),
        ),
    )


def _doubles() -> tuple[Scenario, ...]:
    damping = planted(QuadraticDrag, "p", "p", gain=-1.0, places=ROLL)
    lag = planted(InputLag, "rudder", gain=1.0, time=2.0, places=RUDDER)
    drag = planted(QuadraticDrag, "v", "v", gain=-0.01, places=SWAY)
    gyro = planted(SensorScale, "r", gain=0.05, places=(Location(LocationKind.SENSOR, "r"),))
    return (
        scenario("roll damping and steering gear's lag", damping, lag),
        scenario("cross-flow drag and yaw gyro's scale", drag, gyro),
    )


def _controls() -> tuple[Scenario, ...]:
    settings = {
        "plain": {},
        "coloured noise": {"memory": 0.7},
        "weak inputs": {"weak": 0.1},
        "strong nonlinearity, declared": {"quadratic": 3.0},
        "missing samples": {"gaps": 0.3},
        "unknown bias, declared": {"bias": {"phi": 0.02}},
    }
    return tuple(Scenario(name, "control", (), setting) for name, setting in settings.items())


def _waves() -> tuple[Scenario, ...]:
    return (
        Scenario("waves in roll", "process", (), {"gust": {"p": 0.003}, "gust_time": 2.0}),
        Scenario("gusts in sway", "process", (), {"gust": {"v": 0.01}, "gust_time": 5.0}),
    )
