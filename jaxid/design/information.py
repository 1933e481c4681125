"""Information of planned and measured inputs, at the declared values, before any estimate.

M = S' R^-1 S,    S = dy/dtheta at the declared values of the parameters    (section 5.3.2)
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._foundation.checks import InputError, require, require_float64
from .._foundation.compiler import fast_compile_jit
from .._foundation.notebook import Table
from .._foundation.types import Array, Float, Numbers
from ..data.record import Record
from ..estimation.estimate import as_stack, check_channels
from ..estimation.likelihoods import AbstractLikelihood
from ..estimation.spectrum_policy import SPREAD
from ..models.base import AbstractModel, as_float, canonical
from ..models.free import Free, Positions, flat_vectors
from ..models.free_model import FreeModel
from ..models.noise import whiten
from ..sensitivity.information import gather, record_triangles
from ..sensitivity.spectrum import spectrum, weak_directions
from ..simulation.simulate import explain_divergence, simulate
from .measures import AbstractMeasure
from .signals import InputSignal

# Relative standard errors up to which a parameter is called well or roughly determined (chosen).
WELL, ROUGHLY = 0.1, 0.5


class PlannedInformation(eqx.Module):
    """Predicted knowledge of the free parameters from one input.

    Attributes:
        name: name of the input.
        names, units: of the shared parameters.
        values: declared values.
        factor: square-root information on the shared parameters, the parameters of the record
            eliminated; earlier flights and priors included.
        standard_errors: predicted (Cramer-Rao), infinite for an undetermined parameter.
        weak_directions: undetermined combinations, in words.
    """

    name: str = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    values: Float[np.ndarray, " parameter"]
    factor: Float[np.ndarray, "row parameter"]
    standard_errors: Float[np.ndarray, " parameter"]
    weak_directions: tuple[str, ...] = eqx.field(static=True)

    def measure(self, measure: AbstractMeasure) -> float:
        """Return the cost of a measure, infinite where a parameter is undetermined."""
        cost = float(measure.cost(self.factor))
        return cost if np.isfinite(cost) else np.inf

    @property
    def relative_errors(self) -> Float[np.ndarray, " parameter"]:
        """Standard errors over the absolute values, infinite for a value of zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.standard_errors / np.abs(self.values)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters with an infinite standard error."""
        infinite = ~np.isfinite(self.standard_errors)
        return tuple(name for name, bad in zip(self.names, infinite, strict=True) if bad)

    def __str__(self) -> str:
        return "\n".join([*self._table().lines(), *self._weak_lines()])

    def _repr_html_(self) -> str:
        return self._table().html(below=self._weak_lines())

    def _table(self) -> Table:
        rows = zip(self.names, self.values, self.standard_errors, self.relative_errors, strict=True)
        return Table(
            ("parameter", "value", "std. error", "will be determined"),
            (9, 12, 12),
            tuple(
                (name, f"{value:.5g}", f"{error:.3g}", _in_words(error, relative))
                for name, value, error, relative in rows
            ),
        )

    def _weak_lines(self) -> list[str]:
        return [f"weak: {sentence}" for sentence in self.weak_directions]


def planned_record(
    model: AbstractModel,
    signal: InputSignal,
    likelihood: AbstractLikelihood,
    *,
    trim_input: Float[Numbers, " input"] | None = None,
    initial_state: Float[Numbers, " state"] | None = None,
) -> Record:
    """Return the noise-free record that the declared model expects of an input.

    Args:
        model: the model with declared values.
        signal: deviations of all inputs of the model from trim.
        likelihood: the likelihood of the later estimate, with its hold and stepper.
        trim_input: inputs at trim; zero by default.
        initial_state: state at the first sample; zero by default.

    Raises:
        InputError: when the signal has other inputs than the model, or the simulation diverges.
    """
    require(
        signal.inputs == model.inputs,
        f"The signal moves ({', '.join(signal.inputs)}), and the model has the inputs "
        f"({', '.join(model.inputs)}). Build the signal with the inputs of the model.",
    )
    start = start_of(model, initial_state)
    trim = jnp.zeros(len(model.inputs)) if trim_input is None else jnp.asarray(trim_input)
    u = signal.u + trim[None]
    options = {
        "hold": getattr(likelihood, "hold", None),
        "stepper": getattr(likelihood, "stepper", None),
    }
    solution = simulate(model, signal.t, u, start, **options)
    if not bool(solution.finite):
        raise explain_divergence(solution, model, f"the planned input {signal.name!r}")
    units = model.units()
    return Record(
        signal.t,
        u,
        solution.y,
        jnp.ones(solution.y.shape, bool),
        {},
        model.inputs,
        model.outputs,
        tuple(units.get(channel, "") for channel in model.inputs),
        tuple(units.get(channel, "") for channel in model.outputs),
        (signal.name,),
    )


def stack_of_one(record: Record) -> Record:
    """Return a record as a stack of one case; several records are refused."""
    records = as_stack(record)
    require(
        records.n_cases == 1,
        f"Information is planned for one record, and these are {records.n_cases}. Take `stack[i]`, "
        "and give the information of one as `earlier` for the next.",
    )
    return records


def information_of(
    model: AbstractModel,
    free: Free,
    record: Record,
    likelihood: AbstractLikelihood,
    *,
    initial_state: Float[Numbers, " state"] | None = None,
    earlier: Float[Numbers, "row parameter"] | None = None,
) -> PlannedInformation:
    """Return the information of a planned or measured record at the declared values.

    Args:
        model: the model with declared values.
        free: the parameters of the later estimate, with priors.
        record: one record, planned by `planned_record` or measured.
        likelihood: the likelihood with known noise, such as `OutputError(FixedNoise(R))`.
        initial_state: state at the first sample; by default the model's, from the record.
        earlier: factor of the information of records already flown, in place of the priors, which
            that of a fit contains (`fit.information.triangle`).

    Raises:
        InputError: when channels differ, the noise is unknown, or JAX is in 32 bit.
    """
    require_float64()
    records = stack_of_one(record)
    check_channels(model, records)
    require_known_noise(likelihood)
    likelihood.check(model, records)
    model, free = canonical(model), canonical(free)
    flat = flat_vector_of(model, records, initial_state)
    factor, values = _factor(
        model, free.positions(model), flat, records.anonymous(), canonical(likelihood)
    )
    known = prior_rows(free) if earlier is None else np.asarray(earlier, float)
    rows = np.concatenate([np.asarray(factor), known])
    return planned_information(model, free, np.asarray(values), rows, records.names[0])


def flat_vector_of(model: AbstractModel, records: Record, initial_state) -> Float[Array, " flat"]:
    """Return the flat vector of a model and the first record, with the initial state if given."""
    flat = flat_vectors(model, records)[0]
    if initial_state is None:
        return flat
    state = start_of(model, initial_state)
    return flat.at[flat.size - state.size :].set(state)


def start_of(model: AbstractModel, state) -> Float[Array, " state"]:
    """Return the state at the first sample; states beyond the given ones are zero."""
    given = jnp.zeros(0) if state is None else as_float(state)
    require(
        given.size <= len(model.states),
        f"`initial_state` has {given.size} values, and the model has {len(model.states)} states "
        f"({', '.join(model.states)}).",
    )
    return jnp.pad(given, (0, len(model.states) - given.size))


def planned_information(
    model: AbstractModel, free: Free, values: np.ndarray, factor: np.ndarray, name: str
) -> PlannedInformation:
    """Return predicted standard errors and weak directions of square-root information.

    Args:
        model: the model, for its units.
        free: the free parameters.
        values: their declared values.
        factor: rows of the information on the shared parameters.
        name: name of the input.
    """
    require(
        bool(np.all(np.isfinite(factor))),
        f"The sensitivities under the input {name!r} are not finite. Lower its amplitude, or plan "
        "with values for which the model is stable.",
    )
    triangle = np.asarray(np.linalg.qr(np.pad(factor, ((0, factor.shape[1]), (0, 0))), mode="r"))
    decomposition = spectrum(triangle, np.zeros(triangle.shape[0]))
    covariance = np.asarray(decomposition.covariance(SPREAD))
    units = model.units()
    return PlannedInformation(
        name,
        free.shared,
        tuple(units.get(parameter, "") for parameter in free.shared),
        values,
        triangle,
        np.sqrt(np.diagonal(covariance)),
        weak_directions(free.shared, values, decomposition, SPREAD),
    )


def prior_rows(free: Free) -> np.ndarray:
    """Return the Gaussian priors of the shared parameters as rows of information."""
    deviation = [float(free.prior[n][1]) if n in free.prior else np.inf for n in free.shared]
    return np.diag(1.0 / np.array(deviation))


@fast_compile_jit
def _factor(model, positions: Positions, flat, records: Record, likelihood):
    """Return the triangle of the shared parameters, and their values."""
    own, shared = whitened_sensitivities(model, positions, flat, records, likelihood)
    n_rows, n_shared = positions.rows.size, positions.shared.size
    triangles = record_triangles(own, shared, jnp.zeros(own.shape[:-1]))
    information = gather(
        triangles,
        jnp.zeros((0, n_shared + 1)),
        jnp.zeros((1, n_rows), bool),
        jnp.zeros(n_shared, bool),
    )
    return information.triangle, flat[positions.shared]


def whitened_sensitivities(
    model: AbstractModel,
    positions: Positions,
    flat: Float[Array, " flat"],
    records: Record,
    likelihood: AbstractLikelihood,
) -> tuple[Float[Array, "case time output own"], Float[Array, "case time output parameter"]]:
    """Return the whitened sensitivities of one record to its own and to the shared parameters.

    Args:
        model: the model.
        positions: positions of the free parameters.
        flat: values of all parameters and the initial state.
        records: a stack of one record.
        likelihood: the likelihood with known noise.
    """
    family = FreeModel(model, flat, positions)
    theta = flat[jnp.concatenate([positions.rows, positions.shared])]
    case = jax.tree.map(lambda leaf: leaf[0], records)
    _, S = likelihood.sensitivities(family, theta, case)
    L = likelihood.noise.cholesky(jnp.zeros(records.z.shape), records.mask)
    white = whiten(L, S[None], records.mask)
    count = positions.rows.size
    return white[..., :count], white[..., count:]


def compare_inputs(
    inputs: list[PlannedInformation] | tuple[PlannedInformation, ...],
    measure: AbstractMeasure | None = None,
) -> str:
    """Return a table of the predicted standard errors of several inputs side by side.

    Args:
        inputs: the inputs, with the same free parameters.
        measure: its cost is the last row; none by default.

    Raises:
        InputError: when the inputs have different parameters.
    """
    for other in inputs[1:]:
        if other.names != inputs[0].names:
            raise InputError(
                f"The inputs {inputs[0].name!r} and {other.name!r} have different free parameters. "
                "Evaluate both with the same ones."
            )
    names = inputs[0].names
    left = max(len(name) for name in (*names, "standard error"))
    widths = [max(len(each.name), 11) + 2 for each in inputs]
    titles = [f"{each.name:>{width}}" for each, width in zip(inputs, widths, strict=True)]
    lines = [f"{'standard error':<{left}}" + "".join(titles)]
    for row, name in enumerate(names):
        cells = [
            f"{each.standard_errors[row]:>{width}.3g}"
            for each, width in zip(inputs, widths, strict=True)
        ]
        lines.append(f"{name:<{left}}" + "".join(cells))
    if measure is not None:
        cells = [
            f"{each.measure(measure):>{width}.4g}"
            for each, width in zip(inputs, widths, strict=True)
        ]
        lines.append(f"{'measure':<{left}}" + "".join(cells))
    return "\n".join(lines)


def require_known_noise(likelihood: AbstractLikelihood) -> None:
    """Refuse a likelihood whose noise is estimated."""
    require(
        likelihood.noise.is_known,
        "The noise covariance is unknown, and a planned record has no residual from which to "
        "estimate it. Give the instruments' noise: OutputError(FixedNoise(R)).",
    )


def require_shown(model: AbstractModel, free: Free, rows: Float[np.ndarray, "row parameter"]):
    """Refuse parameters that no random input shows, even all of them together.

    Args:
        model, free: the model and its free parameters.
        rows: rows of the information of all random inputs.
    """
    shown = planned_information(model, free, np.zeros(len(free.shared)), rows, "random inputs")
    if shown.undetermined:
        weak = "; ".join(shown.weak_directions) or "their sensitivity is zero"
        raise InputError(
            f"No input of these axes shows {', '.join(shown.undetermined)}: {weak}. Fix a "
            "parameter, give a prior, or move another axis."
        )


def _in_words(error: float, relative: float) -> str:
    if not np.isfinite(error):
        return "not"
    if not np.isfinite(relative):
        return "its value is zero"
    percent = f"to {100 * relative:.2g} %"
    if relative <= WELL:
        return f"well, {percent}"
    return f"roughly, {percent}" if relative <= ROUGHLY else f"hardly, {percent}"
