"""Programs on disk: the same numbers without a trace, and none for classes that may differ."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import Spring

from jaxid import Augmented, OutputError, free
from jaxid._foundation import configuration, stored_programs
from jaxid._foundation.evicting_jit import EvictingJit
from jaxid.data import record
from jaxid.diagnosis.free_form import linear_models
from jaxid.effects import LocationKind
from jaxid.effects.equation import Term
from jaxid.estimation.estimate import as_stack
from jaxid.estimation.model_programs import FlatProblem, outputs, sensitivities
from jaxid.estimation.problem import Problem
from jaxid.models import LinearModel, Parameters
from jaxid.models.base import canonical
from jaxid.models.free import flat_vectors

LINEAR = LinearModel(
    *(jnp.array([[0.0, 1.0], [-2.0, -0.3]]), jnp.array([[0.0], [1.0]])),
    *(jnp.array([[1.0, 0.0]]), jnp.zeros((1, 1))),
    states=("x", "v"),
    inputs=("force",),
    outputs=("x",),
)


@pytest.fixture
def folder(tmp_path):
    stored_programs.store_programs(tmp_path)
    yield tmp_path / stored_programs.SUBFOLDER
    stored_programs.store_programs(None)


@pytest.fixture
def no_trace(monkeypatch):
    """Function after whose call nothing can be exported."""

    def refuse(*_, **__):
        raise AssertionError("traced again")

    return lambda: monkeypatch.setattr(jax.export, "export", refuse)


def problem_of(model):
    t = 0.1 * jnp.arange(40)
    measured = record(
        t, jnp.sin(t)[:, None], jnp.cos(t)[:, None], inputs=("force",), outputs=("x",)
    )
    own = ("initial_state.x", "initial_state.v")
    chosen = free(model, *[name for name in ("A", "k") if hasattr(model, name)], per_record=own)
    return Problem.of(canonical(model), chosen, as_stack(measured), OutputError())


def programs_of(model):
    """Return the programs of a model with their arguments, new ones at each call."""
    problem = problem_of(model)
    shared = problem.positions.shared.size
    at = Parameters(jnp.linspace(0.1, 0.4, shared), jnp.array([[0.2, -0.1]]))
    case = FlatProblem.of(problem)
    places = ((LocationKind.EQUATION, problem.model.states),)
    return [
        (EvictingJit(outputs), case.outputs_arguments(at)),
        (EvictingJit(sensitivities), case.sensitivities_arguments(at)),
        (EvictingJit(linear_models.function), (problem, at, places)),
    ]


def files_of(folder):
    """Files of a folder, with those of programs by which `programs_of` reads the model."""
    return set(folder.iterdir()) if folder.exists() else set()


def test_stored_programs_give_the_same_numbers_without_a_trace(folder, no_trace):
    """The terms of an absent effect are in the programs, behind a branch."""
    model = Augmented(LINEAR, (Term("v", "x^3"),)).with_present(())
    stored_programs.store_programs(None)
    expected = [program(*arguments) for program, arguments in programs_of(model)]
    stored_programs.store_programs(folder.parent)
    programs = programs_of(model)
    before = files_of(folder)
    first = [program(*arguments) for program, arguments in programs]
    assert len(files_of(folder) - before) == 3
    no_trace()
    later = [program(*arguments) for program, arguments in programs_of(model)]
    for values in (first, later):
        assert jax.tree.structure(values) == jax.tree.structure(expected)
        jax.tree.map(np.testing.assert_array_equal, values, expected)
        assert not any(array.committed for array in jax.tree.leaves(values))


def test_a_program_runs_under_another_jit(folder):
    """Its arguments are known there, and its results are traced."""
    problem = problem_of(LINEAR)
    known = flat_vectors(problem.model, problem.records)
    traced = jax.jit(lambda shift: shift + flat_vectors(problem.model, problem.records))(1.0)
    np.testing.assert_array_equal(traced, known + 1.0)


def test_a_class_of_another_package_is_not_stored(folder):
    model = Spring(jnp.array(1.5), jnp.array(0.2))
    for program, arguments in programs_of(model):
        assert jax.tree.leaves(program(*arguments))
    assert not folder.exists()


def test_a_damaged_file_is_replaced(folder):
    (program, arguments), *_ = programs_of(LINEAR)
    before = files_of(folder)
    _, expected = program(*arguments)
    (file,) = files_of(folder) - before
    file.write_bytes(file.read_bytes()[:-1])
    (program, arguments), *_ = programs_of(LINEAR)
    np.testing.assert_array_equal(program(*arguments)[1], expected)
    assert stored_programs._read(file) is not None


def test_a_folder_that_cannot_be_written_to_costs_the_trace_alone(tmp_path):
    file = tmp_path / "file"
    file.touch()
    stored_programs.store_programs(file)
    try:
        (program, arguments), *_ = programs_of(LINEAR)
        assert np.all(np.isfinite(program(*arguments)[1]))
    finally:
        stored_programs.store_programs(None)


def test_a_program_that_jax_cannot_write_is_traced(folder, monkeypatch):
    """Without flatbuffers the export of a program ends in an ImportError."""

    def absent(_):
        raise ImportError("Please install 'flatbuffers'")

    monkeypatch.setattr(jax.export.Exported, "serialize", absent)
    (program, arguments), *_ = programs_of(LINEAR)
    before = files_of(folder)
    assert np.all(np.isfinite(program(*arguments)[1]))
    assert files_of(folder) == before


def test_a_full_disk_leaves_no_part_of_a_file(folder, monkeypatch):
    def refuse(*_):
        raise OSError("No space left on device")

    monkeypatch.setattr(type(folder), "replace", refuse)
    stored_programs._write(folder / "key", b"program")
    assert not list(folder.iterdir())


def test_source_that_has_changed_since_its_import_is_not_stored(folder, monkeypatch):
    stored_programs._code.cache_clear()
    monkeypatch.setattr(stored_programs, "IMPORTED", 0.0)
    (program, arguments), *_ = programs_of(LINEAR)
    assert np.all(np.isfinite(program(*arguments)[1]))
    assert not files_of(folder)


def test_settings_of_equinox_are_in_the_key(monkeypatch):
    key = key_of(2)
    monkeypatch.setenv("EQX_ON_ERROR", "nan")
    stored_programs._code.cache_clear()
    assert key != key_of(2)
    stored_programs._code.cache_clear()


def test_a_program_belongs_to_the_settings_of_jax_in_a_context(folder):
    stored_programs.store_programs(folder.parent, configuration._settings_of_jax)
    (program, arguments), *_ = programs_of(LINEAR)
    before = files_of(folder)
    program(*arguments)
    assert len(files_of(folder) - before) == 1
    with jax.default_matmul_precision("bfloat16"):
        program(*arguments)
    assert len(files_of(folder) - before) == 2


def test_a_derivative_passes_through_a_stored_program(folder):
    (program, arguments), *_ = programs_of(LINEAR)
    model, flat, *others = arguments

    def outputs_at(flat):
        return program(model, flat, *others)[1]

    ahead = outputs_at(flat + 1e-6) - outputs_at(flat - 1e-6)
    _, slope = jax.jvp(outputs_at, (flat,), (jnp.ones_like(flat),))
    np.testing.assert_allclose(slope, ahead / 2e-6, atol=1e-7)


def key_of(value):
    """Key of a program with one argument, whose arrays of JAX are traced."""
    arrays = [leaf for leaf in jax.tree.leaves(value) if isinstance(leaf, jax.Array)]
    return stored_programs._key(outputs, value, arrays)


LONG = np.arange(5000.0)
CHANGES = {
    "number": (2, 3),
    "type": (2, 2.0),
    "truth": (True, 1),
    "text": ("a,b", "a, b"),
    "grouping": ((("a", "b"), ("c",)), (("a",), ("b", "c"))),
    "middle of a long array": (LONG, np.where(LONG == 2500.0, -1.0, LONG)),
    "type of an array": (jnp.zeros(2), jnp.zeros(2, int)),
    "weak type": (jnp.asarray(2.0), jnp.zeros(())),
    "static field": (Term("v", "x^3"), Term("v", "x^2")),
    "function": (outputs, sensitivities),
}


@pytest.mark.parametrize("change", CHANGES)
def test_key_depends_on_what_a_trace_may_use(change):
    one, other = (key_of(value) for value in CHANGES[change])
    assert one != other


def test_key_depends_on_settings_of_jax_and_not_on_values_of_arrays(folder):
    stored_programs.store_programs(folder, configuration._settings_of_jax)
    key = key_of(jnp.zeros(2))
    assert key == key_of(jnp.ones(2))
    jax.config.update("jax_debug_nans", True)
    try:
        assert key != key_of(jnp.zeros(2))
    finally:
        jax.config.update("jax_debug_nans", False)


def local_class():
    class Local(eqx.Module):
        """Not at the top level of a module."""

    Local.__module__ = Term.__module__
    return Local


@pytest.mark.parametrize(
    "value",
    [lambda x: x, object(), np.array([None]), Spring, local_class()],
    ids=["lambda", "object", "array of objects", "class of a test", "local class"],
)
def test_value_with_unknown_effect_on_a_trace_has_no_key(value):
    with pytest.raises(stored_programs._NotDescribedError):
        key_of(value)
