"""Regression of `identify` in weak form: rows, errors against known truth, gaps, and refusals."""

import jax.numpy as jnp
import numpy as np
import pytest
from written_flight import MASS, SIZE, flight

import jaxid
from jaxid import identify
from jaxid._foundation.checks import InputError
from jaxid.aircraft import Instruments, model_of
from jaxid.data.smoothing import Fourier
from jaxid.models import AbstractModel, Polynomial
from jaxid.models.pseudo_measurements import PseudoMeasurements, WeakMeasurements
from jaxid.structure import least_squares
from jaxid.study import IdentifyOptions
from jaxid.study.terms.regressions import regressions
from jaxid.study.terms.weak_rows import WeakRecords, weak_rows

TRUE = {"x": -2.0, "force": 1.0, "x^3": -0.5}
CANDIDATES = (("stiffness", ("x", "force", "x^2", "x^3")),)
SIGMA, STEP, RADIUS = 0.01, 0.05, 1.5
GIVEN = IdentifyOptions(terms={"stiffness": tuple(TRUE)}, weak_radius=RADIUS)


class Spring(AbstractModel):
    """x' = v, v' = stiffness(x, force), with the position as the only measurement."""

    stiffness: Polynomial
    states, inputs, outputs = ("x", "v"), ("force",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], self.stiffness({"x": x[0], "force": u[0]})])

    def output(self, t, x, u):
        return x[:1]

    def pseudo_measurements(self, record):
        t, x = np.asarray(record.t), np.asarray(record.channel("x"))
        first = Fourier()(t, x).derivative
        second = Fourier()(t, first).derivative
        signals, valid = self._signals(record)
        return PseudoMeasurements(
            record.t, {"stiffness": jnp.asarray(second)}, signals, valid, CANDIDATES
        )

    def weak_measurements(self, record):
        x = record.channel("x")
        signals, valid = self._signals(record)
        parts = {"stiffness": (0.0 * x, 0.0 * x, x)}
        return WeakMeasurements(
            record.t, {"stiffness": 0.0 * x + 1.0}, parts, signals, valid, CANDIDATES
        )

    def _signals(self, record):
        return {name: record.channel(name) for name in ("x", "force")}, record.mask[:, 0]

    def without(self, responses):
        return self


class Pointwise(AbstractModel):
    """A model without equations in weak form."""

    stiffness: Polynomial
    states, inputs, outputs = ("x",), ("force",), ("x",)

    def rhs(self, t, x, u):
        return -x + u


TRUTH, EMPTY = Spring(Polynomial(TRUE)), Spring(Polynomial({}))


def measured(seed, sigma=SIGMA, rows=600, gap=slice(0, 0)):
    t = STEP * np.arange(rows)
    force = 1.5 * np.sin(t) + np.sin(2.3 * t)
    x = np.array(jaxid.simulate(TRUTH, t, force[:, None], np.array([0.3, 0.0])).y)
    x += sigma * np.random.default_rng(seed).normal(size=x.shape)
    x[gap] = np.nan
    return jaxid.record(t, force, x, inputs=("force",), outputs=("x",))


def regressed(record, options=GIVEN):
    weak = options.weak_radius is not None
    equations = EMPTY.weak_measurements if weak else EMPTY.pseudo_measurements
    return regressions([equations(record)], options)[0]["stiffness"].regression


def test_fitted_constant_equals_constant_as_a_column(seed):
    """The reflected rows with a constant have the values of the rows as they are, with the
    integral of one as a column.
    """
    weak = EMPTY.weak_measurements(measured(seed))
    x, force = (np.asarray(weak.signals[name]) for name in ("x", "force"))
    table = {"x": x, "force": force, "x^3": x**3}
    rows, y = weak_rows(WeakRecords([weak], "stiffness", RADIUS), table, None)
    reflected = least_squares(np.stack(list(rows.values()), axis=1), y, list(rows))
    form = jaxid.structure.weak_form(np.asarray(weak.t), RADIUS, [(0.0, 0.0, 1.0)])
    X = form(np.stack([np.ones_like(x), *table.values()], axis=1))
    plain = least_squares(X, form(x, 2), ("1", *table), constant=False)
    np.testing.assert_allclose(reflected.constant, plain.values[0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(reflected.values, plain.values[1:], rtol=1e-8)
    np.testing.assert_allclose(reflected.standard_errors, plain.standard_errors[1:], rtol=1e-8)


def test_errors_are_smaller_than_with_second_derivatives():
    """Root mean square errors over 20 draws; equal methods would give ratios about one."""
    truth = np.array(list(TRUE.values()))
    errors = {
        radius: np.sqrt(
            np.mean(
                [(regressed(measured(seed), options).values - truth) ** 2 for seed in range(20)],
                axis=0,
            )
        )
        for radius, options in (
            (RADIUS, GIVEN),
            (None, IdentifyOptions(terms={"stiffness": tuple(TRUE)})),
        )
    }
    assert np.all(errors[RADIUS] < 0.5 * errors[None])


def test_standard_errors_are_the_scatter():
    """The ratio of 40 deviations to their expectation lies within 0.6 and 1.5 with 99.9 %."""
    draws = [regressed(measured(seed)) for seed in range(40)]
    values = np.array([draw.values for draw in draws])
    ratio = np.std(values, axis=0, ddof=1) / np.mean([one.standard_errors for one in draws], axis=0)
    np.testing.assert_array_less(ratio, 1.5)
    np.testing.assert_array_less(0.6, ratio)


def test_structure_and_values_are_identified():
    result = identify(EMPTY, measured(3), options=IdentifyOptions(weak_radius=RADIUS))
    assert set(TRUE) <= set(result.equations["stiffness"].regression.names)
    fit = result.estimate
    assert bool(fit.successful)
    for name, value, error in zip(fit.names, fit.values, fit.standard_errors, strict=True):
        assert abs(float(value) - TRUE.get(name.partition(".")[2], 0.0)) < 4 * float(error), name


def test_runs_between_gaps_are_regressed_together():
    """Without noise, two runs determine the values that one run does, to the trapezoidal rule."""
    values = [regressed(measured(0, 0.0, gap=gap)).values for gap in (slice(0, 0), slice(280, 320))]
    np.testing.assert_allclose(values[1], list(TRUE.values()), rtol=1e-3)
    np.testing.assert_allclose(values[1], values[0], rtol=1e-3)


def test_moments_and_off_centre_forces_are_linear_in_angular_acceleration():
    """`multiplier C = parts[0] + A omegadot`, with `parts[1] = A omega` and one constant A."""
    channels = flight(seconds=4.0, seed=1)
    inputs = ("stabilator", "aileron", "rudder", "thrust")
    outputs = tuple(name for name in channels if name not in ("t", "qbar", *inputs))
    record = jaxid.record(
        channels["t"],
        np.stack([channels[name] for name in inputs], axis=1),
        np.stack([channels[name] for name in outputs], axis=1),
        inputs=inputs,
        outputs=outputs,
    )
    position = {"az": (2.0, 0.3, -0.1), "ay": (0.5, 0.0, 0.2)}
    model = model_of(record, **MASS, **SIZE, instruments=Instruments(position=position))
    weak, pointwise = model.weak_measurements(record), model.pseudo_measurements(record)
    omega, omegadot = (
        np.stack([np.asarray(record.channel(name)) for name in names], axis=1)
        for names in ("pqr", ("pdot", "qdot", "rdot"))
    )
    for name, response in pointwise.responses.items():
        static, momentum = map(np.asarray, weak.parts[name])
        A, *_ = np.linalg.lstsq(omega, momentum, rcond=None)
        np.testing.assert_allclose(omega @ A, momentum, atol=1e-9 * (1 + np.abs(momentum).max()))
        expected = np.asarray(weak.multipliers[name]) * np.asarray(response)
        np.testing.assert_allclose(static + omegadot @ A, expected, atol=1e-9 * np.ptp(expected))


@pytest.mark.parametrize(
    ("model", "radius", "words"),
    [
        (EMPTY, 40.0, "longest run of valid samples has 29.95 s"),
        (EMPTY, 13.5, r"leaves \d rows, and stiffness has 4 terms"),
        (Pointwise(Polynomial({})), 1.0, "Pointwise has no equations in weak form"),
    ],
)
def test_impossible_weak_form_is_refused(model, radius, words):
    with pytest.raises(InputError, match=words):
        identify(model, measured(0), options=IdentifyOptions(weak_radius=radius))


def test_radius_is_positive():
    with pytest.raises(InputError, match="weak_radius is -1"):
        IdentifyOptions(weak_radius=-1.0)
