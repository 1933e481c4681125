"""Gusts so strong that output error takes other derivatives for them: the filter finds the gusts
and the derivatives.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxid
from jaxid.effects import InputDelay, Term
from jaxid.loop.outcome import Outcome

SPEED, STEP, SAMPLES, GRAVITY = 150.0, 0.05, 300, 9.81  # m/s, s, m/s^2
GUST, MEMORY = 3.0, 1.0  # standard deviation [m/s] and correlation time [s] of the lateral gusts
TRUE = {"Yv": -0.2, "Lv": -0.06, "Lp": -2.0, "La": -8.0, "Nv": 0.02, "Nr": -0.4, "Nd": -2.0}
KNOWN = (
    # A free force on v would be nearly collinear with the gust, which acts in the same equation.
    "Yv"
)
FREE = tuple(f"derivatives.{name}" for name in TRUE if name != KNOWN)
NOISE = np.array([0.001, 0.002, 0.002, 0.003, 0.05])  # rad, rad/s, rad/s, rad, m/s^2


def rates(d, x, aileron, rudder, gust, sin):
    """Of lateral velocity, roll rate, yaw rate and roll angle."""
    v, p, r, phi = x
    through_air = v - gust
    return [
        d["Yv"] * through_air - SPEED * r + GRAVITY * sin(phi),
        d["Lv"] * through_air + d["Lp"] * p + d["La"] * aileron,
        d["Nv"] * through_air + d["Nr"] * r + d["Nd"] * rudder,
        p,
    ]


def sensors(d, x, gust):
    return [(x[0] - gust) / SPEED, x[1], x[2], x[3], d["Yv"] * (x[0] - gust)]


class Lateral(jaxid.AbstractModel):
    """Each sensor has a bias, and no start is known: a steady wind is another start, and hard to
    see.
    """

    derivatives: dict[str, jax.Array]
    bias: jax.Array
    gusts: tuple[str, ...] = eqx.field(static=True, default=())
    states, outputs = ("v", "p", "r", "phi"), ("beta", "p", "r", "phi", "ay")

    @property
    def inputs(self):
        return ("aileron", "rudder", *self.gusts)

    def rhs(self, t, x, u):
        return jnp.stack(rates(self.derivatives, x, u[0], u[1], jnp.sum(u[2:]), jnp.sin))

    def output(self, t, x, u):
        return jnp.stack(sensors(self.derivatives, x, jnp.sum(u[2:]))) + self.bias

    def with_disturbance_inputs(self):
        return Lateral(self.derivatives, self.bias, gusts=("gust_v",))


def flown(seed):
    """A record in gusts that nobody records, with twenty steps between samples, in NumPy; and the
    gusts.
    """
    rng = np.random.default_rng(seed)
    u = 0.02 * np.stack(
        [np.convolve(rng.normal(size=SAMPLES), np.ones(8) / 2.5, "same") for _ in range(2)], axis=1
    )
    keep, gust = np.exp(-STEP / MEMORY), [GUST * rng.normal()]
    for _ in range(SAMPLES):
        gust.append(keep * gust[-1] + np.sqrt(1 - keep**2) * GUST * rng.normal())
    part, x, y = STEP / 20, np.zeros(4), []
    for i in range(SAMPLES):
        y.append(sensors(TRUE, x, gust[i]))
        for k in range(20):
            now = u[i] + k / 20 * (u[min(i + 1, SAMPLES - 1)] - u[i])
            x = x + part * np.array(
                rates(TRUE, x, *now, gust[i] + k / 20 * (gust[i + 1] - gust[i]), np.sin)
            )
    z, t = np.array(y) + NOISE * rng.normal(size=(SAMPLES, 5)), STEP * np.arange(SAMPLES)
    return jaxid.record(
        t, u, z, inputs=("aileron", "rudder"), outputs=Lateral.outputs, name=f"record {seed}"
    ), gust[:-1]


def declared(first, count=3):
    """Records, the gusts in them, and the model with its free parameters."""
    records, gusts = zip(*(flown(first + k) for k in range(count)), strict=True)
    begin = {name: value if name == KNOWN else 0.8 * value for name, value in TRUE.items()}
    model = Lateral(jax.tree.map(jnp.array, begin), jnp.zeros(5))
    return (
        records,
        np.array(gusts),
        model,
        jaxid.free(model, *FREE, "bias", per_record=("initial_state",)),
    )


def test_loop_restarts_filter_from_declared_values():
    """Here output error takes the gusts for no yaw damping at all, from where the filter finds a
    wind that wanders.
    """
    records, gusts, model, free = declared(400, count=5)
    study = jaxid.close_loop(
        model,
        free,
        jaxid.OutputError(),
        train=records[:3],
        check=records[3],
        test=records[4],
        effects=(Term("r", "v r"), InputDelay("rudder")),
        window=50,
    )
    assert study.outcome is Outcome.PROCESS_NOISE
    assert abs(study.before.estimate.value("derivatives.Nr") / TRUE["Nr"] - 1.0) > 0.3
    estimate = study.after.estimate
    assert float(estimate.value("process.gust_v")) == pytest.approx(np.std(gusts[:3]), rel=0.21)
    assert float(estimate.value("correlation_time.gust_v")) == pytest.approx(MEMORY, rel=0.42)
    for name in FREE:
        assert float(estimate.value(name)) == pytest.approx(
            TRUE[name.removeprefix("derivatives.")], rel=0.045
        )
