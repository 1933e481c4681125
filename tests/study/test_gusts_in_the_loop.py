"""Turbulence acts on an aircraft's vane and wing; it is reported as such if the model has gusts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import AbstractModel, OutputError, close_loop, free, record
from jaxid.effects import InputDelay, SensorBias, Term
from jaxid.loop.outcome import Outcome

SPEED, STEP, SAMPLES, WINDOW = 150.0, 0.05, 300, 50  # m/s, s
GUST, MEMORY = 1.0, 1.0  # standard deviation [m/s] and correlation time [s] of the vertical gusts
TRUE = {"Zw": -1.0, "Mw": -0.03, "Mq": -1.5, "Md": -8.0}
NOISE = np.array([0.001, 0.002, 0.1])


class ShortPeriod(AbstractModel):
    """Vertical velocity and pitch rate at constant speed; the wing and the vane feel the velocity
    through the air.
    """

    Zw: jax.Array
    Mw: jax.Array
    Mq: jax.Array
    Md: jax.Array
    gusts: tuple[str, ...] = eqx.field(static=True, default=())
    states, outputs = ("w", "q"), ("alpha", "q", "az")

    @property
    def inputs(self):
        return ("elevator", *self.gusts)

    def rhs(self, t, x, u):
        through_air = x[0] - jnp.sum(u[1:])
        pitching = self.Mw * through_air + self.Mq * x[1] + self.Md * u[0]
        return jnp.stack([self.Zw * through_air + SPEED * x[1], pitching])

    def output(self, t, x, u):
        through_air = x[0] - jnp.sum(u[1:])
        return jnp.stack([through_air / SPEED, x[1], self.Zw * through_air])

    def with_disturbance_inputs(self):
        return ShortPeriod(self.Zw, self.Mw, self.Mq, self.Md, gusts=("gust_w",))


def flown(seed):
    """A record in gusts that nobody records, with twenty steps between samples, in NumPy; and the
    gusts.
    """
    rng = np.random.default_rng(seed)
    elevator = 0.02 * np.convolve(rng.normal(size=SAMPLES), np.ones(8) / 2.5, "same")
    part, x, gust, y = STEP / 20, np.zeros(2), GUST * rng.normal(), []
    gusts = []
    keep = np.exp(-part / MEMORY)
    for i in range(SAMPLES):
        gusts.append(gust)
        y.append([(x[0] - gust) / SPEED, x[1], TRUE["Zw"] * (x[0] - gust)])
        for k in range(20):
            moved = elevator[i] + k / 20 * (elevator[min(i + 1, SAMPLES - 1)] - elevator[i])
            air = x[0] - gust
            x = x + part * np.array(
                [
                    TRUE["Zw"] * air + SPEED * x[1],
                    TRUE["Mw"] * air + TRUE["Mq"] * x[1] + TRUE["Md"] * moved,
                ]
            )
            gust = keep * gust + np.sqrt(1 - keep**2) * GUST * rng.normal()
    z, outputs = np.array(y) + NOISE * rng.normal(size=(SAMPLES, 3)), ShortPeriod.outputs
    t = STEP * np.arange(SAMPLES)
    return record(
        t, elevator[:, None], z, inputs=("elevator",), outputs=outputs, name=f"{seed}"
    ), gusts


def test_turbulence_is_reported_although_it_acts_on_vane(seed):
    records, gusts = zip(*(flown(seed + k) for k in range(5)), strict=True)
    model = ShortPeriod(**{name: jnp.array(0.9 * value) for name, value in TRUE.items()})
    library = (
        *(Term("q", product) for product in ("w^2", "w^3", "w q")),
        SensorBias("alpha"),
        InputDelay("elevator"),
    )
    result = close_loop(
        model,
        free(model, *TRUE, per_record=("initial_state",)),
        OutputError(),
        train=records[:3],
        check=records[3],
        test=records[4],
        effects=library,
        window=WINDOW,
    )
    assert (result.outcome, result.effects) == (Outcome.PROCESS_NOISE, ())
    assert result.noise_model.air == ("gust_w",)
    # 45 s of records are 45 correlation times; the standard error of a standard deviation is then
    # 1/sqrt(2 * 45) = 10 %. The limit is two standard errors.
    assert float(result.after.estimate.value("process.gust_w")) == pytest.approx(
        np.std(gusts[:3]), rel=0.21
    )
    assert "random forces in gust_w" in result.verdict
