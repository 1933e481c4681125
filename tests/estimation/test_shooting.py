"""Multiple shooting: unstable and unequal records from far starts, and refusals."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import least_squares

import jaxid
from jaxid import InputError, OutputError
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.shooting import cut
from jaxid.models import LinearModel

TRUTH = {"A[0,0]": -1.0, "A[1,0]": 2.9, "A[1,1]": -1.0, "B[1,0]": -8.0}
FREE = tuple(TRUTH)
NOISE = 0.002


def model(factor=1.0):
    a, c, d, e = (factor * TRUTH[name] for name in FREE)
    return LinearModel(
        [[a, 1.0], [c, d]],
        [[0.0], [e]],
        np.eye(2),
        np.zeros((2, 1)),
        states=("alpha", "q"),
        inputs=("elevator",),
        outputs=("alpha", "q"),
    )


def flight(count, seed):
    """A motion that doubles in one second, held by a feedback; exact for held elevators."""
    rng, t = np.random.default_rng(seed), 0.05 * np.arange(count)
    block = np.zeros((3, 3))
    block[:2] = np.column_stack([[-1.0, 2.9], [1.0, -1.0], [0.0, -8.0]])
    Phi = expm(0.05 * block)
    x, u, z = np.array([0.02, 0.0]), np.zeros(count), np.zeros((count, 2))
    for i in range(count):
        z[i] = x + NOISE * rng.normal(size=2)
        u[i] = 0.04 * np.sign(np.sin(1.3 * t[i])) + z[i] @ [0.8, 0.3]
        x = Phi[:2, :2] @ x + Phi[:2, 2] * u[i]
    return jaxid.record(t, u, z, inputs=("elevator",), outputs=("alpha", "q"))


def fitted(records, start, **options):
    noise = jaxid.FixedNoise([NOISE**2, NOISE**2])
    stepper = jaxid.RK4(4, unrolled=False)
    likelihood = OutputError(noise, jaxid.hold.ZeroOrder(), stepper, **options)
    chosen = jaxid.free(start, *FREE, per_record=("initial_state",))
    return jaxid.estimate(start, chosen, records, likelihood)


def by_scipy(records):
    """Least squares from the truth, with exact transitions."""

    def misfit(values):
        a, c, d, e = values[:4]
        block = np.zeros((3, 3))
        block[:2] = [[a, 1.0, 0.0], [c, d, e]]
        Phi = expm(0.05 * block)
        rows = []
        for record, x in zip(records, values[4:].reshape(-1, 2), strict=True):
            for z, u in zip(np.asarray(record.z), np.asarray(record.u)[:, 0], strict=True):
                rows.append((z - x) / NOISE)
                x = Phi[:2, :2] @ x + Phi[:2, 2] * u
        return np.ravel(rows)

    begin = np.array([*(TRUTH[name] for name in FREE), *[0.02, 0.0] * len(records)])
    solution = least_squares(misfit, begin, xtol=1e-14, ftol=1e-14, gtol=1e-14, x_scale="jac")
    return solution.x, np.sqrt(np.diag(np.linalg.inv(solution.jac.T @ solution.jac)))


@pytest.mark.parametrize("factor", [0.5, 1.5])
def test_unstable_record_is_fitted_from_far_start_by_pieces_alone(factor):
    records = [flight(400, 1), flight(290, 2)]
    assert not bool(fitted(records, model(factor)).successful)
    fit = fitted(records, model(factor), shooting=20)
    assert bool(fit.successful), fit.status
    expected, errors = by_scipy(records)
    found = np.concatenate([fit.values, np.ravel(fit.own)])
    np.testing.assert_allclose((found - expected) / errors, 0.0, atol=1e-2)
    np.testing.assert_allclose(fit.standard_errors, errors[:4], rtol=1e-3)


def test_pieces_hold_every_sample_once():
    records = as_stack([flight(31, 1), flight(20, 2)])
    pieces = cut(records, 8)
    assert pieces.t.shape == (8, 8)
    np.testing.assert_array_equal(
        np.asarray(pieces.z)[np.asarray(pieces.mask)],
        np.asarray(records.z)[np.asarray(records.mask)],
    )
    assert np.all(np.diff(pieces.t, axis=1) >= 0.0)


def test_known_initial_state_stays_known():
    start, records = model(0.7), flight(200, 3)
    fit = jaxid.estimate(start, jaxid.free(start, *FREE), records, OutputError(shooting=10))
    near = jaxid.estimate(fit.model, jaxid.free(start, *FREE), records, OutputError())
    assert bool(fit.successful)
    assert fit.own.shape == (1, 0)
    np.testing.assert_allclose(fit.values, near.values, rtol=1e-5)


def test_bounds_of_the_initial_state_are_not_those_of_its_pieces():
    records, start = [flight(200, 3)], model(0.9)
    narrow = {"initial_state.alpha": (-0.03, 0.03), "initial_state.q": (-0.03, 0.03)}
    chosen = jaxid.free(start, *FREE, per_record=("initial_state",), bounds=narrow)
    noise = jaxid.FixedNoise([NOISE**2, NOISE**2])
    likelihood = OutputError(noise, jaxid.hold.ZeroOrder(), jaxid.RK4(4, unrolled=False))
    pieces = dataclasses.replace(likelihood, shooting=20)
    fit = jaxid.estimate(start, chosen, records, pieces)
    near = jaxid.estimate(fit.model, chosen, records, likelihood)
    assert bool(fit.successful)
    np.testing.assert_allclose(fit.values, near.values, rtol=1e-5)


def test_wrong_pieces_and_other_functions_are_refused():
    start, records = model(), flight(40, 3)
    chosen = jaxid.free(start, *FREE, per_record=("initial_state",))
    with pytest.raises(InputError, match="`shooting` is 1; give the number of pieces"):
        OutputError(shooting=1)
    with pytest.raises(InputError, match="40 samples, too few for 30 pieces of 2"):
        jaxid.estimate(start, chosen, records, OutputError(shooting=30))
    shared = jaxid.free(start, *FREE, "initial_state.q")
    with pytest.raises(InputError, match=r"initial_state\.q is one value for all records"):
        jaxid.estimate(start, shared, records, OutputError(shooting=4))
    with pytest.raises(InputError, match="`estimate_many` simulates each record as a whole"):
        jaxid.estimate_many(start, chosen, [records], OutputError(shooting=4))
    with pytest.raises(InputError, match="`multi_start` simulates each record as a whole"):
        jaxid.multi_start(start, chosen, records, OutputError(shooting=4))
    with pytest.raises(InputError, match="`close_loop` simulates each record as a whole"):
        jaxid.close_loop(
            start,
            chosen,
            OutputError(shooting=4),
            train=records,
            check=flight(40, 5),
            test=flight(40, 6),
        )


def test_shooting_works_under_jit():
    start, records = model(0.8), flight(200, 4)
    chosen = jaxid.free(start, *FREE, per_record=("initial_state",))
    likelihood = OutputError(hold=jaxid.hold.ZeroOrder(), shooting=10)

    def values(record):
        return jaxid.estimate(start, chosen, record, likelihood).values

    np.testing.assert_allclose(jax.jit(values)(records), values(records), rtol=1e-6)
    assert jnp.isfinite(values(records)).all()
