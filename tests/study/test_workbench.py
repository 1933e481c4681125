"""A set of effects is fitted in a model with the whole library or in one of its own: the fit is the same."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring, fly

from jaxid import AbstractModel, OutputError, free
from jaxid.estimation.estimate import as_stack
from jaxid.models.augmented import Augmented
from jaxid.models.effects_equation import StateLimit, Term
from jaxid.models.effects_input import InputLag
from jaxid.models.effects_sensor import SensorBias
from jaxid.study import workbench
from jaxid.study.close_loop import SOLVER
from jaxid.study.programs import operations, pays_to_compile
from jaxid.study.workbench import Workbench, worth_going_on

LIBRARY = (Term("v", "x^3"), InputLag("force"), SensorBias("x"), StateLimit("x", "v"))
CUBIC = Term("v", "x^3", jnp.array(-0.3))


def _bench(monkeypatch, by_itself: bool, solver=SOLVER) -> Workbench:
    monkeypatch.setattr(workbench, "pays_to_compile", lambda model, samples: by_itself)
    model = Spring(jnp.array(1.5), jnp.array(0.2))
    own = free(
        model,
        "k",
        "c",
        per_record=["initial_state"],
        bounds={"c": (0.0, None), "initial_state.v": (-5.0, 5.0)},
        prior={"k": (1.2, 0.5)},
    )
    records = as_stack([fly(70 + seed, CUBIC)[0] for seed in range(2)])
    return Workbench(model, own, LIBRARY, OutputError(), records, solver)


def _both(monkeypatch, named):
    """For each of two starts, the workbench and its fit with the whole library, and those in a model of its own."""
    found = []
    for by_itself in (False, True):
        bench = _bench(monkeypatch, by_itself)
        declared = bench.set_shapes(bench.base())
        bench.score(declared)  # so that the sensitivities there are known to the fit
        values = np.array(declared.values)
        values[[bench.columns.gains[name] for name in named]] = 0.05
        starts = (declared.values, values)
        found.append([(bench, bench.fit(named, start, declared.fit.parameters.rows)) for start in starts])
    return zip(*found, strict=True)


@pytest.mark.parametrize("named", [(), ("x^3 in v",), ("lag of input force", "bias of x")])
def test_a_fit_in_a_model_of_its_own_is_the_same_fit(monkeypatch, named):
    for (whole, carried), (alone, fitted) in _both(monkeypatch, named):
        assert carried.columns == fitted.columns
        assert fitted.fit.parameters.shared.size == len(fitted.columns)
        np.testing.assert_allclose(fitted.cost, carried.cost, rtol=1e-9)
        known = whole.standard_errors(carried)
        for name, (value, error) in alone.standard_errors(fitted).items():
            # The same steps but for rounding, which an ill-determined direction magnifies: told in standard errors.
            assert abs(value - known[name][0]) < 1e-6 * known[name][1]
            np.testing.assert_allclose(error, known[name][1], rtol=1e-5)
        rows = carried.fit.parameters.rows
        np.testing.assert_allclose(fitted.fit.parameters.rows, rows, rtol=1e-6, atol=1e-9)


def test_at_a_corner_both_fits_end_alike(monkeypatch):
    """Which steps are refused at a corner hangs on rounding: from its two starts one and the same program ends 0.01 of the cost
    apart. A search goes on for `LITTLE`, of which a tenth is asked."""
    for (_, carried), (_, fitted) in _both(monkeypatch, (LIBRARY[3].name,)):
        assert abs(fitted.cost - carried.cost) < 0.1 * workbench.LITTLE


def test_a_fit_that_its_iteration_limit_ends_is_gone_on_with(monkeypatch):
    """So that a search compares what the effects bring, and not how far their fits have come."""
    whole, brief = (_bench(monkeypatch, False, dataclasses.replace(SOLVER, max_steps=most)) for most in (100, 4))
    start = whole.base().values
    done = whole.fit(["x^3 in v"], start).cost
    assert abs(brief.fit(["x^3 in v"], start).cost - done) < SOLVER.least_fall
    monkeypatch.setattr(workbench, "GO_ON", 0)
    assert brief.fit(["x^3 in v"], start).cost > done + 10.0


@pytest.mark.parametrize(
    ("costs", "creeping", "goes_on"),
    [
        ([50.0], 0.1, True),  # no fall is known yet
        ([50.0, 20.0], 0.1, True),
        ([50.0, 20.0, 18.0], 0.1, False),
        ([50.0, 20.0, 18.0], 0.0, True),
        ([50.0, 49.7], 0.0, False),
        ([50.0 - one for one in range(20)], 0.0, False),  # it has gone on often enough
    ],
)
def test_a_fit_that_creeps_is_not_gone_on_with_but_to_be_finished(costs, creeping, goes_on):
    assert worth_going_on(costs, creeping) is goes_on


def test_a_program_of_its_own_pays_for_a_small_model_on_long_records():
    small = Augmented(Spring(jnp.array(1.5), jnp.array(0.2)), LIBRARY)
    assert not pays_to_compile(small, 300)
    assert pays_to_compile(small, 20_000)
    assert not pays_to_compile(small.only(()), 20_000)  # as it carries nothing


class Nested(AbstractModel):
    """A comparison, a product and a selection, which is a function of its own."""

    states, inputs, outputs = ("x",), ("u",), ("x",)

    def rhs(self, t, x, u):
        return jnp.where(x > u, x * u, u)

    def output(self, t, x, u):
        return x


def test_operations_are_those_of_the_equations_however_they_are_nested():
    assert operations(Nested()) == 3
