"""Where a residual comes from: calibrated where nothing is missing, right where something is, and
honest about ties.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import binom, chi2

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.data import Record
from jaxid.diagnosis import localise_residual
from jaxid.diagnosis.autoregression import white_noise_variance
from jaxid.diagnosis.free_form import answers, linear_model, linear_models, spline_basis
from jaxid.diagnosis.localise import resolution, search
from jaxid.diagnosis.places import LocalisationResult, Place
from jaxid.diagnosis.thresholds import SAMPLES_PER_DEGREE
from jaxid.effects import InputDelay, InputLag, Location, LocationKind, SensorScale, Term
from jaxid.estimation import estimate
from jaxid.estimation.limits import Limits
from jaxid.estimation.problem import Problem

SIGMA, ROWS, KNOTS = 0.01, 200, 8


class Spring(jaxid.AbstractModel):
    k: jax.Array
    c: jax.Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x", "v")

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - self.c * x[1]])

    def output(self, t, x, u):
        return x


SPRING = Spring(jnp.array(2.0), jnp.array(0.3))
FREE = jaxid.free(SPRING, "k", "c", per_record=("initial_state",))
KNOWN = jaxid.OutputError(noise=jaxid.FixedNoise(SIGMA**2 * jnp.eye(2)))
T = 0.1 * jnp.arange(ROWS)
PLACE, NOTHING = Location(LocationKind.EQUATION, "v"), np.zeros((1, 2))


def force(seed):
    return jnp.repeat(jax.random.normal(jax.random.key(seed), (ROWS // 10, 1)), 10, axis=0)


def record_of(z, u):
    return Record(
        T, u, z, jnp.ones(z.shape, bool), {}, ("force",), ("x", "v"), ("",), ("", ""), ("",)
    )


def measured(effect, seed):
    truth = jaxid.Augmented(SPRING, (effect,)) if effect else SPRING
    y = jaxid.simulate(truth, T, force(seed), jnp.zeros(2)).y
    return record_of(
        y + SIGMA * jax.random.normal(jax.random.key(100 + seed), y.shape), force(seed)
    )


def asked(effect, **options):
    records = [measured(effect, seed) for seed in (1, 2)]
    return localise_residual(
        estimate(SPRING, FREE, records, KNOWN), records, KNOWN, **options
    ), records


def scores_of_noise(draws, likelihood, knots, variance):
    """Scores and degrees of freedom of records of white noise about the model.

    Args:
        draws: number of records.
        likelihood: likelihood of the fit.
        knots: number of splines.
        variance: function of a fit and its stack of records that returns the variance of the noise.
    """
    u = force(0)
    y = jaxid.simulate(SPRING, T, u, jnp.zeros(2)).y

    def one(e):
        record = record_of(y + SIGMA * e, u)
        fit = estimate(SPRING, FREE, record, likelihood)
        stack = jax.tree.map(lambda leaf: leaf[None], record)
        problem = Problem(fit.model, FREE.positions(SPRING), stack, likelihood, Limits.of(FREE, 1))
        linearised = problem.sensitivities(fit.parameters)
        places = (LocationKind.EQUATION, ("v",)), (LocationKind.SENSOR, SPRING.outputs)
        linear = linear_models(problem, fit.parameters, places)
        signals = stack.t, stack.u, stack.mask
        R = jnp.diag(variance(fit, linearised[0], stack.mask))
        result = search(linear, signals, linearised, R, 2, knots, ROWS)
        return result.score, result.dof

    e = jax.random.normal(jax.random.key(9), (draws, ROWS, 2))
    score, dof = map(np.asarray, eqx.filter_jit(jax.vmap(one))(e))
    assert np.all(dof == dof[0])
    return score, dof[0]


def binomial_band(draws, share, places):
    """Shares of the draws that a right test meets with 99.9 % probability over all places."""
    tail = 0.0005 / places
    return (binom.ppf(q, draws, share) / draws for q in (tail, 1 - tail))


def test_scores_are_chi_square_where_nothing_is_missing():
    """2,000 records: the share above the 95 % point of chi-square, place by place."""
    score, dof = scores_of_noise(2000, KNOWN, KNOTS, lambda fit, *_: jnp.diagonal(fit.noise))
    above = np.mean(score > chi2.ppf(0.95, dof), axis=0)
    low, high = binomial_band(2000, 0.05, above.size)
    assert np.all((above >= low) & (above <= high)), above


def test_scores_follow_no_more_than_F_where_the_noise_is_estimated():
    """1,000 records: the share beyond the 99 % point of the F distribution. By chi-square, as if
    the noise were known, there would be more.
    """

    def variance(fit, v, mask):  # as `localise` limits it
        return jnp.minimum(white_noise_variance(v, mask), jnp.diagonal(fit.noise))

    score, dof = scores_of_noise(1000, jaxid.OutputError(), 30, variance)
    degrees = ROWS / SAMPLES_PER_DEGREE
    result = LocalisationResult((), NOTHING, {}, (30, ROWS), 1.0, degrees)
    _, high = binomial_band(1000, 0.01, dof.size)
    for place, values in enumerate(score.T):
        places = [Place(PLACE, value, int(dof[place]), 0.0, NOTHING, NOTHING) for value in values]
        assert np.mean([result.chance(one) < 0.01 for one in places]) <= high
    assert np.max(np.mean(score > chi2.ppf(0.99, dof), axis=0)) > high


@pytest.fixture(scope="module")
def cubic():
    return asked(Term("v", "x^3", gain=jnp.array(-0.1)))


def test_a_missing_force_is_placed_in_its_equation_and_not_told_from_the_input_that_acts_there(
    cubic,
):
    found, _ = cubic
    first = found.near_best()
    assert {one.location for one in first} == {
        Location(LocationKind.EQUATION, "v"),
        Location(LocationKind.INPUT, "force"),
    }
    assert first[0].share > 0.9
    # one and the same columns
    np.testing.assert_allclose(first[0].score, first[1].score, rtol=1e-9)
    # x' = v is exact and is not asked about
    assert {one.location.name for one in found.places} == {"v", "force", "x"}


def test_the_disturbance_is_the_missing_force():
    """Up to what the free parameters can do as well, a force along x and v. Of what these two leave
    of the missing force at the knots, the disturbance takes away 60 %, on four pairs of records: 57
    to 80 % in one pair, as few knots are coarse."""
    effect, taken = Term("v", "x^3", gain=jnp.array(-0.1)), []
    for first in (1, 3, 5, 7):
        records = [measured(effect, seed) for seed in (first, first + 1)]
        found = localise_residual(estimate(SPRING, FREE, records, KNOWN), records, KNOWN, knots=20)
        d = next(
            one for one in found.places if one.location.kind is LocationKind.EQUATION
        ).disturbance.reshape(-1)
        at = [
            [np.interp(found.knots[i], T, one.channel(name)) for name in ("x", "v")]
            for i, one in enumerate(records)
        ]
        x, v = (np.concatenate([one[k] for one in at]) for k in (0, 1))
        left = [_left(x**3, x, v), _left(x**3, x, v, d)]
        taken.append(1.0 - left[1] / left[0])
    assert np.mean(taken) > 0.6, taken


def _left(missing, *columns):
    """Sum of squares that a regression on these leaves."""
    A = np.stack(columns, axis=1)
    return np.sum((missing - A @ np.linalg.lstsq(A, missing, rcond=None)[0]) ** 2)


@pytest.mark.parametrize(
    "likelihood",
    [KNOWN, jaxid.OutputError(KNOWN.noise, stepper=jaxid.RK4(3, unrolled=False))],
    ids=["one", "three"],
)
def test_answers_to_hats_are_derivatives_of_the_simulation(likelihood):
    """Hats that are straight between the samples, as the input is: a push of the input is a change
    of the record's.
    """
    truth = jaxid.Augmented(
        SPRING,
        (Term("v", "x^3", gain=jnp.array(-0.1)), InputLag("force", jnp.array(1.0), jnp.array(0.3))),
    )
    start, u = jnp.array([0.5, 0.0, 0.0]), force(1)
    one = jax.tree.map(lambda leaf: leaf[None], record_of(jnp.zeros((ROWS, 2)), u))
    problem = Problem.of(truth, jaxid.free(truth, per_record=("initial_state",)), one, likelihood)
    case = jax.tree.map(lambda leaf: leaf[0], problem.cases())
    places = (
        (LocationKind.EQUATION, ("v",)),
        (LocationKind.INPUT, truth.inputs),
        (LocationKind.SENSOR, truth.outputs),
    )
    linear = linear_model(problem, start, jnp.zeros(0), case, places)
    splines, _ = spline_basis(T, KNOTS)
    found = answers(linear, splines)

    moving = jaxid.Augmented(Forced(SPRING.k, SPRING.c), truth.effects_in)

    def under(force, push):
        both = u + (splines @ push)[:, None], (splines @ force)[:, None]
        return jaxid.simulate(
            moving, T, jnp.concatenate(both, axis=1), start, stepper=likelihood.stepper
        ).y

    derivatives = jax.jit(jax.jacfwd(under, argnums=(0, 1)))
    of_force, of_push = derivatives(jnp.zeros(KNOTS), jnp.zeros(KNOTS))
    np.testing.assert_allclose(found[:, :, 0], of_force, atol=1e-12)
    # the push goes through the lag, as the input does
    np.testing.assert_allclose(found[:, :, 1], of_push, atol=1e-12)
    np.testing.assert_allclose(
        found[:, :, 2:], jnp.eye(2)[None, :, :, None] * splines[:, None, None], atol=0.0
    )


class Forced(Spring):
    """The spring with one more input, which nothing acts on."""

    inputs = ("force", "more")

    def rhs(self, t, x, u):
        return super().rhs(t, x, u) + jnp.stack([jnp.zeros(()), u[1]])


def test_the_variable_that_the_force_follows_is_told(cubic):
    """The displacement, as state or as output, before the speed and before the force that was
    applied.
    """
    found, _ = cubic
    ranked = found.explained_by(found.places[0])
    assert ranked[0][0] == "x"
    assert ranked[0][1] > 0.5
    assert {name for name, _ in ranked} == {"x", "v", "force"}


def test_a_disturbance_of_nothing_or_that_is_not_known_follows_nothing(cubic):
    cubic, *_ = cubic
    place = cubic.places[0]
    unknown = place._replace(deviation=np.full_like(place.deviation, np.inf))
    for one in (place._replace(disturbance=np.zeros_like(place.disturbance)), unknown):
        assert {share for _, share in cubic.explained_by(one)} == {0.0}
    constant = place._replace(disturbance=np.full_like(place.disturbance, 2.0))
    assert max(share for _, share in cubic.explained_by(constant)) < 1e-9
    exact = place._replace(deviation=np.zeros_like(place.deviation))
    assert 0.0 < cubic.explained_by(exact)[0][1] < 1.0
    most = place.deviation.copy()
    most.flat[: most.size // 2 + 1] = np.inf
    assert 0.0 < cubic.explained_by(place._replace(deviation=most))[0][1] < 1.0


def test_the_hats_are_as_fine_as_the_residual_asks_for():
    """A slow residual gets few hats over the whole record; a fast one sixty over the first part of
    it.
    """
    stack = jax.tree.map(lambda leaf: leaf[None], record_of(jnp.zeros((ROWS, 2)), force(0)))
    slow, fast = (jnp.tile(jnp.sin(w * T)[None, :, None], (1, 1, 2)) for w in (1.0, 25.0))
    assert resolution(stack, slow) == (20, ROWS)
    assert resolution(stack, fast) == (60, 120)  # never fewer rows than two for a hat
    long = jax.tree.map(lambda leaf: leaf[None], jaxid.data.Record(*long_arrays()))
    medium = jnp.tile(jnp.sin(3.0 * long.t)[..., None], (1, 1, 2))
    assert resolution(long, medium) == (60, 1600 // 4)


def long_arrays():
    """A record of 160 s: a residual of 0.48 Hz asks for 192 hats."""
    t = 0.1 * jnp.arange(1600)
    z = jnp.zeros((1600, 2))
    return t, z[:, :1], z, z == 0, {}, ("force",), ("x", "v"), ("",), ("", ""), ("",)


@pytest.mark.parametrize(
    ("effect", "place"),
    [
        (SensorScale("x", gain=jnp.array(0.2)), Location(LocationKind.SENSOR, "x")),
        (InputDelay("force", gain=jnp.array(0.15)), Location(LocationKind.INPUT, "force")),
    ],
)
def test_sensors_and_inputs_are_placed(effect, place):
    found, _ = asked(effect)
    assert place in {one.location for one in found.near_best()}


def test_a_drifting_parameter_is_asked_about_by_name(cubic):
    found, _ = asked(Term("v", "x^3", gain=jnp.array(-0.1)), kinds=(LocationKind.PARAMETER,))
    assert [one.location.kind for one in found.places] == [LocationKind.PARAMETER] * 2
    assert found.places[0].location.name == "k"  # a stiffness that goes with x^2
    assert "parameter k" in str(found)


def test_bad_questions_are_refused(cubic):
    _, records = cubic
    fit = estimate(SPRING, FREE, records, KNOWN)
    for options, words in (
        ({"knots": 1}, "knots"),
        ({"kinds": ()}, "kind"),
        ({"equations": ("w",)}, "'w'"),
    ):
        with pytest.raises(InputError, match=words):
            localise_residual(fit, records, KNOWN, **options)


@pytest.mark.parametrize("likelihood", [jaxid.FilterError({"v": 0.1}), jaxid.InnovationForm()])
def test_fit_of_a_filter_is_refused(likelihood, cubic):
    """A filter predicts each sample from those before it, and its residuals are innovations."""
    records = cubic[1][0]
    fit = estimate(SPRING, jaxid.free(SPRING, "k", "c"), records, likelihood)
    simulated = estimate(SPRING, FREE, records, KNOWN)
    for given in ((fit, records), (fit, records, likelihood), (simulated, records, likelihood)):
        with pytest.raises(InputError, match="fit by OutputError"):
            localise_residual(*given)
