"""A-priori values, wind-tunnel tables as the baseline, and lower powers forced in."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxid
from jaxid import OutputError, identify
from jaxid._foundation.checks import InputError
from jaxid.models import AbstractModel, Polynomial
from jaxid.models.pseudo_measurements import PseudoMeasurements
from jaxid.structure import least_squares
from jaxid.study import IdentifyOptions
from jaxid.study.terms.lower_powers import is_lower_power, with_lower_powers

TRUE = {"x": -2.0, "v": -0.3, "force": 1.0, "x^3": -1.5}
SIGMA = {"x": 0.004, "v": 0.01, "vdot": 0.02}
NOISE = jaxid.models.FixedNoise([SIGMA["x"] ** 2, SIGMA["v"] ** 2])


class Spring(AbstractModel):
    """x' = v, v' = table x + stiffness(x, v, force): a part of the force that is known."""

    stiffness: Polynomial
    table: jax.Array
    states, inputs, outputs = ("x", "v"), ("force",), ("x", "v")

    def rhs(self, t, x, u):
        now = {"x": x[0], "v": x[1], "force": u[0]}
        return jnp.stack([x[1], self.table * x[0] + self.stiffness(now)])

    def output(self, t, x, u):
        return x

    def pseudo_measurements(self, record):
        z = {name: record.channel(name) for name in (*record.inputs, *record.outputs)}
        return PseudoMeasurements(
            t=record.t,
            responses={"stiffness": z["vdot"]},
            signals={name: z[name] for name in ("x", "v", "force")},
            valid=jnp.all(record.mask, axis=-1),
            candidates=(("stiffness", ("x", "v", "force", "x^2", "x^3")),),
            known={"stiffness": self.table * z["x"]},
        )

    def without(self, responses):
        return self


def measured(size, seed=3, rows=400):
    rng = np.random.default_rng(seed)
    t = 0.05 * np.arange(rows)
    force = size * np.repeat(rng.normal(size=(rows // 20, 1)), 20, axis=0)
    truth = Spring(Polynomial(TRUE), jnp.array(0.0))
    solution = jaxid.simulate(
        truth, t, force, np.array([0.1, 0.0]), stepper=jaxid.RK4(4, unrolled=False)
    )
    rates = jax.vmap(truth.rhs)(solution.t, solution.x, jnp.asarray(force))[:, 1:]
    clean = np.column_stack([solution.y, rates])
    z = clean + rng.normal(size=clean.shape) * np.array([*SIGMA.values()])
    return jaxid.record(t, force, z, inputs=("force",), outputs=tuple(SIGMA))


@pytest.fixture(scope="module")
def record():
    return measured(1.0)


def blank(table=0.0):
    return Spring(Polynomial({}), jnp.array(table))


ALL = IdentifyOptions(terms={"stiffness": tuple(TRUE)}, share=0.0)


def test_terms_are_increments_to_the_known_part(record):
    """The regression without a table finds the sum of table and increment, term by term."""
    plain = identify(blank(), record, options=ALL).equations["stiffness"].regression
    result = identify(blank(-1.5), record, options=ALL)
    regression = result.equations["stiffness"].regression
    shifts = [1.5 if name == "x" else 0.0 for name in regression.names]
    np.testing.assert_allclose(regression.values, plain.values + shifts, rtol=1e-10)
    assert result.estimate.value("stiffness.x") == pytest.approx(-0.5, abs=0.02)


def test_prior_is_that_of_the_estimate(record):
    """The estimate equals `estimate` with the same terms and prior."""
    prior = {"stiffness.x": (-1.9, 0.01), "stiffness.x^2": (0.3, 0.02)}
    result = identify(
        blank(), record, options=IdentifyOptions(prior=prior), likelihood=OutputError(NOISE)
    )
    names = result.estimate.names
    assert "stiffness.x^2" in names
    model = Spring(
        Polynomial(dict.fromkeys((name.partition(".")[2] for name in names), 0.0) | TRUE),
        jnp.array(0.0),
    )
    free = jaxid.free(model, *names, per_record=("initial_state",), prior=prior)
    alone = jaxid.estimate(model, free, model.prepared(record), OutputError(NOISE))
    for name in names:
        assert result.estimate.value(name) == pytest.approx(alone.value(name), abs=1e-6), name


def test_prior_keeps_an_equation_that_the_record_hardly_determines():
    """Little motion: the regression explains nothing, and the a-priori values remain."""
    quiet = measured(0.001)
    with pytest.raises(InputError, match="No equation is left"):
        identify(blank(), quiet, options=IdentifyOptions(least_F=1e6))
    prior = {f"stiffness.{name}": (value, 0.1) for name, value in TRUE.items()}
    options = IdentifyOptions(least_F=1e6, prior=prior)
    result = identify(blank(), quiet, options=options, likelihood=OutputError(NOISE))
    assert "kept by its a-priori values" in result.equations["stiffness"].reason
    error = float(result.estimate.standard_error("stiffness.force"))
    assert error == pytest.approx(0.1, rel=0.05)
    assert result.estimate.value("stiffness.force") == pytest.approx(1.0, abs=0.05)


def test_start_of_an_unselected_term_is_its_prior_mean(record):
    options = IdentifyOptions(prior={"stiffness.x^2": (0.3, 0.02)})
    result = identify(blank(), record, options=options)
    assert "x^2" not in result.equations["stiffness"].regression.names
    at = result.start.names.index("stiffness.x^2")
    assert result.start.values[at] == 0.3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"prior": {"stiffness.x^9": (0.0, 1.0)}}, "candidate term of stiffness"),
        ({"prior": {"damping.x": (0.0, 1.0)}}, "response .in `options`. 'damping'"),
        ({"prior": {"stiffness.x": (0.0, 0.0)}}, "positive standard deviation"),
        ({"prior": {"stiffness": (0.0, 1.0)}}, "Name a term"),
        ({"prior": {"stiffness.x": (0.0, np.inf)}}, "positive standard deviation"),
        ({"prior": {"stiffness.x": (0.0, 1.0)}, "leave_out": ("stiffness",)}, "`leave_out` or"),
        ({"prior": {"stiffness.x": (0.0, 1.0)}, "adapt": True}, "Leave `adapt` or `prior` out"),
    ],
)
def test_impossible_priors_are_refused(record, options, words):
    with pytest.raises(InputError, match=words):
        identify(blank(), record, options=IdentifyOptions(**options))


# Lower powers -------------------------------------------------------------------------------------


def test_lower_power_of_a_term():
    assert is_lower_power("alpha", "alpha^2 beta")
    assert is_lower_power("rudder", "alpha rudder")
    assert not is_lower_power("alpha", "alpha")
    assert not is_lower_power("alpha rudder", "alpha^2 beta")


def test_high_power_that_stands_for_a_low_one_leaves(seed):
    """A regression has selected x^3 for a response that is linear in x, beneath noise."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1.0, 1.0, size=400)
    y = x + rng.normal(scale=0.5, size=400)
    table = {f"x^{n}" if n > 1 else "x": x**n for n in range(1, 6)}

    def fit(terms):
        return least_squares(np.stack([table[term] for term in terms], axis=1), y, terms)

    result = with_lower_powers(fit(("x^3",)), tuple(table), fit, 10.8)
    assert result.names == ("x",)  # F of 10.8: one in a thousand noises keeps the cubic term
    exact = with_lower_powers(fit(("x",)), tuple(table), fit, 10.8)
    assert exact.names == ("x",)


def test_lower_powers_stay_below_a_high_one(record):
    """The force has x^3, whose lower power x^2 is absent: it leaves, x stays."""
    result = identify(blank(), record, options=IdentifyOptions(lower_powers=True))
    names = set(result.equations["stiffness"].regression.names)
    assert {"x", "v", "force", "x^3"} <= names


class WithRanges(Spring):
    """A spring whose usual stiffness is known."""

    def usual_ranges(self):
        return {"stiffness.x": (-1.0, 0.0), "stiffness.v": (-1.0, 0.0)}


def test_estimate_outside_its_usual_range_has_a_caveat(record):
    result = identify(WithRanges(Polynomial({}), jnp.array(0.0)), record, options=ALL)
    (caveat,) = result.caveats
    assert caveat.startswith("stiffness.x is -2")
    assert "jaxid.consistency" in caveat
    assert "jaxid.close_loop" in caveat
    assert f"caveat: {caveat}" in str(result)
    assert result.to_dict()["caveats"] == [caveat]
    assert identify(blank(), record, options=ALL).caveats == ()
