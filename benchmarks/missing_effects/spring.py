"""A mass on a spring with a damper: position and acceleration are measured, the force is known."""

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
    DeadBand,
    DryFriction,
    Hysteresis,
    InputDeadZone,
    InputDelay,
    InputLag,
    InputRateLimit,
    LaggedSignal,
    Location,
    LocationKind,
    Placement,
    QuadraticDrag,
    Resonance,
    SensorBias,
    SensorDelay,
    SensorDrift,
    SensorLag,
    SensorSaturation,
    SensorScale,
    Term,
)

STEP, SAMPLES, WINDOW = 0.1, 300, 60  # s
NOISE = {"x": 0.02, "a": 0.05}  # standard deviations [m, m/s^2]
K, C = 1.5, 0.2
FORCE, SENSOR_X, SENSOR_A = (
    (Location(LocationKind.EQUATION, "v"), Location(LocationKind.INPUT, "force")),
    (Location(LocationKind.SENSOR, "x"),),
    (Location(LocationKind.SENSOR, "a"),),
)
CONSTANT = ("1 in v", "bias of x")  # not distinguishable for a spring with a free initial state
# A narrow dead band equals friction, and friction with a free width contains it.
KINK = ("dead band of v in v", "smooth sign(v) in v")


class Spring(AbstractModel):
    """`dv/dt = force - k x - c v - cubic x^3 - drag |v| v`, the last two known; `bias` of the
    accelerometer.
    """

    k: Array
    c: Array
    cubic: Array
    drag: Array
    bias: Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x", "a")

    def rhs(self, t, x, u):
        position, speed = x
        known = self.cubic * position**3 + self.drag * jnp.abs(speed) * speed
        return jnp.stack([speed, u[0] - self.k * position - self.c * speed - known])

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        return jnp.stack([x[0], dx[1] + self.bias])

    def units(self):
        return {"x": "m", "v": "m/s", "a": "m/s^2", "force": "m/s^2", "k": "1/s^2", "c": "1/s"}


def plant(cubic: float, drag: float) -> truth.Plant:
    """Return the equations in NumPy."""

    def rates(s):
        known = cubic * s["x"] ** 3 + drag * np.abs(s["v"]) * s["v"]
        return {"x": s["v"], "v": s["force"] - K * s["x"] - C * s["v"] - known}

    return truth.Plant(
        ("x", "v"), ("force",), ("x", "a"), rates, lambda s, d: {"x": s["x"], "a": d["v"]}
    )


def forced(generator: np.random.Generator, records: int) -> np.ndarray:
    """Return random forces: white noise through a window of eight samples, from rest."""
    white = generator.normal(size=(records, SAMPLES))
    smooth = np.array([np.convolve(one, np.ones(8) / 2.5, "same") for one in white])
    size = 1.5 ** generator.uniform(-1.0, 1.0, size=(records, 1))
    return size * smooth * np.minimum(np.arange(SAMPLES) / 10.0, 1.0)


def fly(wanted: Scenario, seed: int) -> Flown:
    """Seven records of 30 s.

    Settings, in addition to those of `truth.measured`: `weak` scales the force,
    `cubic` and `drag` are known, `released` is an initial position without a force, `one` trains on
    a single record; a `bias` of the accelerometer is declared and free.
    """
    have, generator = wanted.setting, wanted.generator(seed)
    count, t = TRAIN + CHECK + TEST, STEP * np.arange(SAMPLES)
    force = have.get("weak", 1.0) * forced(generator, count)
    start = {"x": np.zeros(count), "v": np.zeros(count)}
    if "released" in have:
        force, start["x"] = 0.0 * force, have["released"] * generator.uniform(0.7, 1.3, count)
    equations = plant(have.get("cubic", 0.0), have.get("drag", 0.0))
    z = truth.measured(
        equations,
        wanted.effects,
        generator,
        have,
        t,
        {"force": force},
        start,
        tuple(NOISE.values()),
    )
    flown = [
        record(t, u[:, None], y, inputs=Spring.inputs, outputs=Spring.outputs, name=f"record {i}")
        for i, (u, y) in enumerate(zip(force, z, strict=True))
    ]
    # Declared with a stiffness that is wrong by a third, and damping by half.
    model = Spring(*map(jnp.array, (1.0, 0.1, have.get("cubic", 0.0), have.get("drag", 0.0), 0.0)))
    chosen = free(
        model, "k", "c", *(("bias",) if "bias" in have else ()), per_record=("initial_state",)
    )
    train = flown[: 1 if "one" in have else TRAIN]
    check, test = flown[TRAIN : TRAIN + CHECK], flown[TRAIN + CHECK :]
    noise = tuple(NOISE.values())
    return Flown(model, chosen, train, check, test, {"k": K, "c": C}, noise)


def system() -> System:
    """The spring with its scenarios; sizes from faint (chi-square about 60) to gross."""
    return System(
        "spring", True, False, WINDOW, (*_singles(), *_doubles(), *_controls(), *_gusts()), fly
    )


def _singles() -> tuple[Scenario, ...]:
    x_of_force = (*FORCE, *SENSOR_X)
    in_v = Placement.equation("v")
    return (
        scenario("cubic spring, faint", planted(Term, "v", "x^3", gain=-0.0017, places=FORCE)),
        scenario("cubic spring", planted(Term, "v", "x^3", gain=-0.3, places=FORCE)),
        scenario("cubic spring, gross", planted(Term, "v", "x^3", gain=-2.0, places=FORCE)),
        scenario("square spring", planted(Term, "v", "x^2", gain=0.1, places=FORCE)),
        scenario("van der Pol damping", planted(Term, "v", "x^2 v", gain=-0.1, places=FORCE)),
        scenario("cubic damping", planted(Term, "v", "v^3", gain=-0.05, places=FORCE)),
        scenario(
            "dry friction, faint",
            planted(DryFriction, "v", "v", gain=-0.008, width=0.01, places=FORCE, also=KINK),
        ),
        scenario(
            "dry friction",
            planted(DryFriction, "v", "v", gain=-0.2, width=0.01, places=FORCE, also=KINK),
        ),
        scenario("quadratic drag", planted(QuadraticDrag, "v", "v", gain=-0.2, places=FORCE)),
        scenario(
            "constant force", planted(Term, "v", "1", gain=0.05, places=x_of_force, also=CONSTANT)
        ),
        scenario(
            "play in the spring", planted(DeadBand, in_v, "x", gain=-1.0, width=0.5, places=FORCE)
        ),
        scenario(
            "lagged damping", planted(LaggedSignal, in_v, "v", gain=-0.5, time=1.0, places=FORCE)
        ),
        scenario(
            "hysteresis of the spring",
            planted(Hysteresis, in_v, "x", gain=-0.3, width=0.3, places=FORCE),
        ),
        scenario(
            "load that swings",
            planted(Resonance, in_v, "force", gain=0.3, frequency=3.0, damping=0.05, places=FORCE),
        ),
        scenario("input delay, faint", planted(InputDelay, "force", gain=0.003, places=FORCE)),
        scenario("input delay", planted(InputDelay, "force", gain=0.15, places=FORCE)),
        scenario("actuator lag", planted(InputLag, "force", gain=1.0, time=0.3, places=FORCE)),
        scenario(
            "actuator's rate limit",
            planted(InputRateLimit, "force", gain=1.0, limit=1.5, places=FORCE),
        ),
        scenario(
            "actuator's dead zone",
            planted(InputDeadZone, "force", gain=1.0, width=0.2, places=FORCE),
        ),
        scenario(
            "scale of the accelerometer", planted(SensorScale, "a", gain=0.1, places=SENSOR_A)
        ),
        scenario("delay of the position", planted(SensorDelay, "x", gain=0.1, places=SENSOR_X)),
        scenario("lag of the accelerometer", planted(SensorLag, "a", gain=0.15, places=SENSOR_A)),
        scenario("bias of the accelerometer", planted(SensorBias, "a", gain=0.05, places=SENSOR_A)),
        scenario("drift of the position", planted(SensorDrift, "x", gain=0.002, places=SENSOR_X)),
        scenario(
            "stop of the position",
            planted(SensorSaturation, "x", gain=1.0, level=1.0, places=SENSOR_X),
        ),
    )


def _doubles() -> tuple[Scenario, ...]:
    cubic, bias = (
        planted(Term, "v", "x^3", gain=-0.3, places=FORCE),
        planted(SensorBias, "a", gain=0.05, places=SENSOR_A),
    )
    friction = planted(DryFriction, "v", "v", gain=-0.2, width=0.01, places=FORCE, also=KINK)
    drag, late = (
        planted(QuadraticDrag, "v", "v", gain=-0.2, places=FORCE),
        planted(InputDelay, "force", gain=0.1, places=FORCE),
    )
    return (
        scenario("cubic spring and biased accelerometer", cubic, bias),
        scenario("friction and input delay", friction, late),
        scenario("cubic spring and quadratic drag", cubic, drag),
    )


def _controls() -> tuple[Scenario, ...]:
    settings = {
        "plain": {},
        "coloured noise": {"memory": 0.8},
        "weak inputs": {"weak": 0.05},
        "strong nonlinearity, declared": {"cubic": 2.0, "drag": 0.3},
        "running down": {"released": 3.0, "drag": 0.3},
        "missing samples": {"gaps": 0.3},
        "one record": {"one": True},
        "unknown bias, declared": {"bias": {"a": 0.2}},
    }
    return tuple(Scenario(name, "control", (), setting) for name, setting in settings.items())


def _gusts() -> tuple[Scenario, ...]:
    return (
        Scenario("gusts, slow", "process", (), {"gust": {"v": 0.3}, "gust_time": 1.0}),
        Scenario("gusts, fast", "process", (), {"gust": {"v": 0.3}, "gust_time": 0.1}),
    )
