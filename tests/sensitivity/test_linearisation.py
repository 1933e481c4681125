"""Sensitivities by linearised steps equal those by forward mode through the whole simulation."""

import dataclasses
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from compiled_problem import sensitivities
from small_spring import Spring

from jaxid import OutputError, record
from jaxid._foundation.compiler import fast_compile_jit
from jaxid._foundation.dependence import depends_on, returns_argument
from jaxid._foundation.location import LocationKind
from jaxid.effects import Augmented, general_effects
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.likelihoods import forward_sensitivities
from jaxid.estimation.problem import KEPT_BYTES, Problem, kept_bytes
from jaxid.models import Free, Parameters, free
from jaxid.models.free_model import FreeModel
from jaxid.models.names import parameter_names
from jaxid.sensitivity import jacobians, linearisation
from jaxid.simulation import RK4, BandLimited, Cubic, Linear, ZeroOrder

TOLERANCE = 1e-10  # of the largest entry of each column


class TwoSensors(Spring):
    """The spring with an accelerometer, whose output depends on the rate of the state."""

    outputs = ("x", "a")

    def output(self, t, x, u):
        return self.output_given(t, x, u, self.rhs(t, x, u))

    def output_given(self, t, x, u, dx):
        return jnp.stack([x[0], dx[1]])


def a_record(model, samples=150, inputs=("force",)):
    rng = np.random.default_rng(3)
    t = 0.1 * np.arange(samples)
    u = np.convolve(rng.normal(size=samples), np.ones(8) / 2.5, "same")[:samples, None]
    z = rng.normal(size=(samples, len(model.outputs)))
    z[rng.random(z.shape) < 0.2] = np.nan
    return record(t, u, z, inputs=inputs, outputs=model.outputs)


def with_effects(places):
    """The spring with the effects of its library at some kinds of place, all of one gain."""
    spring = TwoSensors(1.5, 0.2)
    effects = [e for e in general_effects(spring, ("v",)) if e.card.location.kind in places]
    scaled = tuple(eqx.tree_at(lambda e: e.gain, effect, jnp.array(0.003)) for effect in effects)
    return Augmented(spring, scaled)


def difference(model, names, likelihood, rec):
    """Largest difference of both sensitivities, relative to the largest entry of each column."""
    chosen = Free(tuple(names), ("initial_state.x", "initial_state.v"))
    problem = Problem.of(model, chosen, as_stack(rec), likelihood)
    flat, case = jax.tree.map(lambda leaf: leaf[0], problem.cases())
    family = FreeModel(problem.model, flat, problem.positions)
    theta = jnp.concatenate([jnp.array([0.3, -0.1]), flat[problem.positions.shared]])

    reference = dataclasses.replace(
        problem.likelihood, stepper=RK4(likelihood.stepper.substeps, linearised=False)
    )

    @fast_compile_jit
    def both(family, theta, case):
        return problem.likelihood.sensitivities(family, theta, case), forward_sensitivities(
            reference, family, theta, case
        )

    (y, S), (expected_y, expected) = both(family, theta, case)
    np.testing.assert_allclose(y, expected_y, rtol=1e-10, atol=1e-10)
    scale = jnp.max(jnp.abs(expected), axis=(0, 1))
    assert jnp.count_nonzero(scale) > 2
    error = jnp.max(jnp.abs(S - expected), axis=(0, 1)) / jnp.where(scale > 0, scale, 1.0)
    return dict(zip((*chosen.per_record, *names), np.asarray(error), strict=True))


HOLDS = {"linear": Linear(), "zero-order": ZeroOrder(), "cubic": Cubic(), "sinc": BandLimited()}
PLACES = {
    "dynamics": (LocationKind.EQUATION, LocationKind.PARAMETER),
    "signals": (LocationKind.INPUT, LocationKind.SENSOR),
}


@pytest.mark.parametrize(
    ("hold", "places"),
    [("linear", "dynamics"), *((hold, "signals") for hold in HOLDS)],
)
def test_library_equals_forward_mode(monkeypatch, hold, places):
    """All parameters of the library are free: the equations are differentiated in reverse, and the
    columns pass the sensors in groups.
    """
    monkeypatch.setattr(linearisation, "COLUMNS_AT_ONCE", 5)
    model = with_effects(PLACES[places])
    errors = difference(
        model, parameter_names(model), OutputError(hold=HOLDS[hold]), a_record(model, 70)
    )
    assert max(errors.values()) < TOLERANCE, max(errors, key=errors.__getitem__)


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize(
    "reverse_from", [(0, 0), (0, 10**6), (10**6, 10**6)], ids=["reverse", "mixed", "forward"]
)
@pytest.mark.parametrize("samples", [10, 96, 130])
def test_modes_substeps_and_blocks_equal_forward_mode(monkeypatch, samples, reverse_from, substeps):
    monkeypatch.setattr(jacobians, "REVERSE_LEAVES_FROM", reverse_from[0])
    monkeypatch.setattr(jacobians, "REVERSE_FROM", reverse_from[1])
    monkeypatch.setattr(linearisation, "ELEMENTS_AT_ONCE", 100 if samples == 130 else 10**6)
    model = TwoSensors(1.5, 0.2)
    rec = a_record(model, samples)
    errors = difference(model, ["k", "c"], OutputError(stepper=RK4(substeps)), rec)
    assert max(errors.values()) < TOLERANCE


def test_positions_beyond_the_model_are_columns_of_zeros():
    """A selection of the same size with a parameter switched off shares the compiled program."""
    model = TwoSensors(1.5, 0.2)
    chosen = free(model, "k", "c")
    problem = Problem.of(model, chosen, as_stack(a_record(model)), OutputError())
    beyond = eqx.tree_at(
        lambda p: p.positions.shared, problem, jnp.array([0, 10**6], problem.positions.shared.dtype)
    )
    at = Parameters(jnp.array([1.5, 0.0]), jnp.zeros((1, 0)))
    _, S = sensitivities(beyond, at)
    whole = Parameters(jnp.array([1.5, 0.2]), jnp.zeros((1, 0)))
    _, complete = sensitivities(problem, whole)
    assert jnp.all(S[..., 1] == 0.0)
    np.testing.assert_allclose(S[..., 0], complete[..., 0], rtol=1e-12)


@pytest.fixture
def cpu(monkeypatch):
    """The sizes of a CPU, whatever device runs the test."""
    device = SimpleNamespace(platform="cpu")
    monkeypatch.setattr("jaxid.estimation.problem.default_device", lambda: device)


def test_a_gpu_keeps_a_share_of_its_memory(cpu, monkeypatch):
    """No GPU is needed: only its description is read."""
    gpu = SimpleNamespace(platform="gpu", memory_stats=lambda: {"bytes_limit": 64_000_000_000})
    assert kept_bytes() == KEPT_BYTES
    monkeypatch.setattr("jaxid.estimation.problem.default_device", lambda: gpu)
    assert kept_bytes() == 1_000_000_000


def test_records_in_batches_give_same_information(cpu, monkeypatch):
    """Sensitivities of a few records at a time are folded into the same triangles."""
    model = TwoSensors(1.5, 0.2)
    records = as_stack([a_record(model) for _ in range(6)])
    problem = Problem.of(model, free(model, "k", "c"), records, OutputError())
    at = Parameters(jnp.array([1.4, 0.25]), jnp.zeros((6, 0)))

    def linearise(problem):
        """Compiled at each call: the batch is a setting of the module and no argument."""

        @eqx.filter_jit
        def run(problem):
            linearised = problem.linearise(at)
            return linearised, problem.score_spectrum(at, linearised, jnp.eye(2)).power

        return run(problem)

    together, power = linearise(problem)
    for name in ("KEPT_BYTES", "BLOCK_BYTES"):
        monkeypatch.setattr(f"jaxid.estimation.problem.{name}", 3 * 150 * 2 * 2 * 8)
    assert problem.batch == 3
    in_batches, power_in_batches = linearise(problem)
    assert in_batches.S is None
    assert together.S is not None
    np.testing.assert_allclose(
        in_batches.information.factor, together.information.factor, rtol=1e-10, atol=1e-10
    )
    np.testing.assert_allclose(power_in_batches, power, rtol=1e-9)


def test_dependence_follows_calls_and_arithmetic():
    def function(a, b, c):
        inner = jax.jit(lambda x, y: (x + 1.0, y * 2.0))
        first, _ = inner(a, b)
        return first, c.shape[0] * 1.0

    arguments = (jnp.ones(2), jnp.ones(2), jnp.ones(2))
    assert depends_on(function, arguments) == (True, False, False)
    assert depends_on(
        lambda a, b: jax.lax.scan(lambda x, y: (x + y, y), a, b)[0], (1.0, jnp.ones(3))
    ) == (True, True)


def test_unchanged_argument_is_recognised():
    assert returns_argument(lambda y: y, jnp.ones(3))
    assert not returns_argument(lambda y: y + 0.0, jnp.ones(3))
