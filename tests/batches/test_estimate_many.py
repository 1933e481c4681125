"""`estimate_many`: each case equals its single estimate, and a case that fails fails alone."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from many_lags import Hardening, chosen, lag_records, model

from jaxid._foundation.checks import InputError
from jaxid.batches import estimate_many, summary
from jaxid.data import record, stack
from jaxid.estimation import OutputError, estimate
from jaxid.models.free import with_values

CASES = 80
NOT_A_NUMBER, DIVERGING, SILENT = (17, 50, 71), (5, 40), (42, 63, 79)
# Rounding: the two programs add the same numbers in another order. Gauss-Newton ends within 1e-6
# standard errors of the minimum, at a point that this moves by some 1e-12; a case that ran with
# the data or the start of another one would differ by 1e-2.
RTOL = 1e-9


class InMetres(Hardening):
    """The lag with a unit."""

    def units(self):
        return {"x": "m"}


def planted_records(seed):
    """Return records with the planted failures; in silent ones no input shows `b`."""
    records = lag_records(CASES, seed, silent=SILENT)
    for i in NOT_A_NUMBER:
        z = records[i].z.at[7, 0].set(jnp.nan)
        records[i] = dataclasses.replace(records[i], z=z)
    for i in DIVERGING:
        records[i] = dataclasses.replace(records[i], u=1e6 * jnp.ones_like(records[i].u))
    return records


@pytest.fixture(scope="module")
def records():
    return planted_records(seed=3)


@pytest.fixture(scope="module")
def many(records):
    return estimate_many(model(), chosen(), records, OutputError())


@pytest.fixture(scope="module")
def healthy():
    return np.setdiff1d(np.arange(CASES), (*NOT_A_NUMBER, *DIVERGING, *SILENT))


def test_every_healthy_case_equals_its_single_estimate(records, many, healthy):
    """A third of the records is shorter: the batch pads them."""
    assert (many.status[healthy] == "successful").all()
    assert (many.reason[healthy] == "converged").all()
    for i in healthy:
        padded = stack([records[i]], 60)  # so that all single estimates share one program
        alone = estimate(model(), chosen(), padded, OutputError())
        case = {name: values[i] for name, values in many.items()}
        for name in ("values", "standard_errors", "covariance", "own_errors", "noise", "cost"):
            np.testing.assert_allclose(case[name], getattr(alone, name), rtol=RTOL)
        # An initial state is near zero, so that its error counts.
        error = np.abs(case["own"] - alone.own)
        assert (error < RTOL * np.asarray(alone.own_errors)).all()
        assert case["iterations"] == alone.iterations
        np.testing.assert_allclose(case["corrected_errors"], alone.corrected_errors, rtol=RTOL)


def test_each_failed_case_carries_its_reason(many):
    for i in NOT_A_NUMBER:
        assert many.status[i] == "refused"
        assert f"Record 'lag {i}': the output 'x' is nan in row 7" in str(many.reason[i].values)
        assert np.isnan(many["values"][i]).all()
    for i in DIVERGING:
        assert many.status[i] == "start_diverges"
        assert "diverges at the starting values" in str(many.reason[i].values)
    for i in SILENT:
        assert many.status[i] == "undetermined"
        assert "b is not determined" in str(many.reason[i].values)
        assert np.isinf(many.standard_errors.sel(case=i, parameter="b"))


def test_names_units_and_settings_are_in_the_dataset(many):
    assert list(many.parameter.values) == ["p", "b"]
    assert list(many.own_parameter.values) == ["initial_state.x"]
    assert str(many.name[3].values) == "lag 3"
    assert many.attrs["version"]
    assert many.attrs["model"].startswith("Hardening")


def test_second_call_with_new_numbers_compiles_nothing(many, compilations):
    others = planted_records(seed=4)
    starts = {"p": np.linspace(0.8, 1.4, CASES)}
    compilations.clear()
    again = estimate_many(model(), chosen(), others, OutputError(), starts=starts)
    assert compilations == []
    assert not np.allclose(again["values"][0], many["values"][0], rtol=1e-6)
    np.testing.assert_allclose(again.start.sel(parameter="p")[:5], starts["p"][:5])


def test_stack_of_records_equals_sequence(records, many):
    few = [records[i] for i in (0, 1, 2, 3)]
    of_stack = estimate_many(model(), chosen(), stack(few), OutputError())
    np.testing.assert_allclose(of_stack["values"], many["values"][:4], rtol=RTOL)


def test_models_and_starts_per_case_equal_single_estimates(records):
    """The fixed parameter `cubic` differs from case to case, and `p` and `b` start elsewhere."""
    cubics, starts = np.array([0.0, 0.02, 0.08]), np.array([[0.8, 0.6], [1.1, 0.9], [1.3, 1.2]])
    few = [records[i] for i in (0, 1, 3)]
    singles = [Hardening(p=1.0, b=0.7, cubic=float(cubic)) for cubic in cubics]
    batched = Hardening(p=jnp.ones(3), b=0.7 * jnp.ones(3), cubic=jnp.asarray(cubics))
    expected = [
        estimate(with_values(*one), chosen(), one_record, OutputError())
        for *one, one_record in zip(
            singles, [("p", "b")] * 3, jnp.asarray(starts), few, strict=True
        )
    ]
    for models in (singles, batched):
        many = estimate_many(model(), chosen(), few, OutputError(), models=models, starts=starts)
        np.testing.assert_allclose(many["values"], [one.values for one in expected], rtol=RTOL)
        np.testing.assert_array_equal(many.start, starts)
    assert np.ptp(many["values"].values, axis=0).min() > 1e-3


def test_progress_counts_cases_to_the_end(records):
    states = []
    estimate_many(model(), chosen(), records[:20], OutputError(), progress=states.append)
    assert [state.finished for state in states] == sorted(state.finished for state in states)
    assert (states[-1].finished, states[-1].total, states[-1].failed) == (20, 20, 2)
    assert states[-1].remaining == 0.0


def test_bar_leaves_standard_output_and_results_alone(records, many, capfd):
    few = estimate_many(model(), chosen(), records[:4], OutputError(), progress=True)
    assert capfd.readouterr().out == ""
    np.testing.assert_allclose(few["values"], many["values"][:4], rtol=RTOL)


def test_wrong_input_is_refused_in_words(records):
    few = records[:2]

    def refused(match, cases=few, **options):
        with pytest.raises(InputError, match=match):
            estimate_many(model(), chosen(), cases, OutputError(), **options)

    refused("no case", [])
    refused("2 cases and 1 models", models=[model()])
    refused("shape", models=Hardening(p=jnp.ones(3), b=jnp.ones(3), cubic=jnp.ones(3)))
    refused("shape", starts=np.ones((2, 3)))
    refused("no parameter.*'q'", starts={"q": np.ones(2)})
    refused("finite numbers", starts={"p": np.array([1.0, np.nan])})
    refused("`devices` is empty", devices=[])
    t = 0.1 * np.arange(20)
    other = record(t, t, t, inputs=("force",), outputs=("x",))
    refused("Every case was refused.*force", [other, other])


def test_records_in_another_unit_are_refused(records):
    in_radians = dataclasses.replace(records[0], output_units=("rad",))
    with pytest.raises(InputError, match=r"'x' is in \[rad\] in the records and in \[m\]"):
        estimate_many(InMetres(p=1.0, b=0.7, cubic=0.05), chosen(), [in_radians], OutputError())


def test_summary_averages_the_finite_standard_errors(many, healthy):
    """A case on a bound is successful and has no standard error there."""
    one, other = (many.isel(case=healthy[:2]).copy(deep=True) for _ in range(2))
    one.status[0], one.standard_errors[0, 0] = "at_bound", np.nan
    other.standard_errors[:, 0] = np.nan
    error = float(many.standard_errors[healthy[1], 0])
    columns = [summary(table).splitlines()[1].split() for table in (one, other)]
    assert columns[0][3] == f"{error:.5g}"
    assert columns[1][3] == "nan"
