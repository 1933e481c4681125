"""`propagate`: value and standard error of any function of an estimated model."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax.flatten_util import ravel_pytree

from .._foundation.checks import require, require_key, require_level
from .._foundation.notebook import Table
from .._foundation.traced_errors import plain_errors
from .._foundation.types import Array, Float
from ..estimation.coloured_errors import colour_ratio
from ..estimation.filter.backward_pass import square_factor
from ..estimation.result import Estimate
from ..models.names import flatten, parameter_names
from ..sensitivity.information import covariance_of_unknowns
from ..sensitivity.jacobian import value_and_jacobian
from ..sensitivity.spectrum import SHARE
from .fixed_constants import FixedConstants

Function = Callable[[Any], Any]  # of the model


class Propagated(eqx.Module):
    """A function of an estimated model with its uncertainty.

    Attributes:
        value: the function of the estimated model, an array or a dictionary (any tree) of arrays.
        standard_errors: in the same form; infinite where the function depends on a combination of
            parameters that the data do not determine.
        covariance: of all elements of the value, in the order of `names`; its finite part.
        names: name of each element.
        draws: values of the function for random parameters, in the same form with a leading axis;
            None if no draws were requested.
    """

    value: Any
    standard_errors: Any
    covariance: Float[Array, "element element"]
    names: tuple[str, ...] = eqx.field(static=True)
    draws: Any = None

    def interval(self, level: float = 0.95) -> Any:
        """Return the ends of the confidence intervals along a new last axis, in the form of
        `value`.

        They are the quantiles of the draws if there are any, which follow a function that is not
        linear, and else `value -/+ q standard error` with the normal quantile.

        Args:
            level: probability, such as 0.95.

        Raises:
            InputError: when the level is not between 0 and 1.
        """
        require_level(level, 0.95)
        ends = np.array([0.5 * (1.0 - level), 0.5 * (1.0 + level)])
        if self.draws is not None:
            return jax.tree.map(
                lambda leaf: jnp.moveaxis(jnp.quantile(leaf, jnp.asarray(ends), axis=0), 0, -1),
                self.draws,
            )
        q = jnp.asarray(scipy.special.ndtri(ends))
        return jax.tree.map(
            lambda value, error: value[..., None] + jnp.multiply.outer(error, q),
            self.value,
            self.standard_errors,
        )

    def _repr_html_(self) -> str:
        return self._table().html()

    def __str__(self) -> str:
        return "\n".join(self._table().lines())

    def _table(self) -> Table:
        """Return each element with its standard error and 95 % interval in words."""
        ends = np.reshape(_elements(self.interval()), (-1, 2))
        columns = (_elements(self.value), _elements(self.standard_errors), ends)
        rows = (
            (name, f"{value:.6g}", f"{error:.3g}", f"{low:.6g} to {high:.6g}")
            for name, value, error, (low, high) in zip(self.names, *columns, strict=True)
        )
        heads = ("value of", "value", "std. error", "95 % interval")
        return Table(heads, (8, 13, 11), tuple(rows))


def propagate(
    estimate: Estimate,
    function: Function,
    *,
    case: int = 0,
    coloured: bool = False,
    considered: FixedConstants | None = None,
    draws: int = 0,
    key: Array | None = None,
) -> Propagated:
    """Return the value of a function of the estimated model, with covariance and standard errors.

        covariance(f) = J P J',    J = df/dtheta    by forward-mode differentiation

    P is the Cramer-Rao bound. The natural frequency and the damping ratio of a linear model:

        def mode(model):
            frequency = jnp.sqrt(jnp.linalg.det(model.A))
            return {"frequency": frequency, "damping": -jnp.trace(model.A) / (2 * frequency)}

        print(jaxid.propagate(fit, mode))

    A function that is defined once is compiled once. A parameter on its bound is held.

    Args:
        estimate: from `estimate`; under `vmap` one of its cases.
        function: takes the fitted model, returns an array or a dictionary (any tree) of arrays.
        case: record whose own parameters, such as its sensor biases, the model has.
        coloured: use the errors corrected for the colour of the residuals.
        considered: from `consider`: the errors of fixed constants are included, also where the
            function depends on the constants themselves.
        draws: number of random models for which the function is evaluated as well. They show a
            function that is not linear within the errors of the parameters. Weak directions are
            held in them.
        key: random key of the draws.

    Raises:
        InputError: when draws have no key, or there is no record `case`.
    """
    if draws:
        require_key(key)
    count = estimate.own.shape[-2]
    require(0 <= case < count, f"There is no record {case} among {count}: give 0 to {count - 1}.")
    value, errors, covariance, samples = _propagated(
        estimate, considered, key, function, case, coloured, draws
    )
    return Propagated(value, errors, covariance, _labels(value), samples)


class Spread(NamedTuple):
    """Uncertain parameters: those of the record, the shared ones, the fixed constants.

    Attributes:
        mean: their values.
        root: square root of their covariance, without weak directions.
        reaction: change of all of them by that of the shared parameters.
        names: position and name of each quantity; the model has most of them, but not the initial
            states nor the parameters of the noise.
    """

    mean: Float[Array, " quantity"]
    root: Float[Array, "quantity column"]
    reaction: Float[Array, "quantity parameter"]
    names: tuple[tuple[int, str], ...]


@eqx.filter_jit
def _propagated(
    estimate: Estimate,
    considered: FixedConstants | None,
    key: Array | None,
    function: Function,
    case: int,
    coloured: bool,
    draws: int,
):
    """Return value, standard errors, covariance and draws of a function (jitted)."""
    spread = _spread(estimate, considered, case, coloured)
    vector, unflatten = flatten(estimate.model)
    available = parameter_names(estimate.model)
    of_model = [(index, available.index(name)) for index, name in spread.names if name in available]
    chosen, at = np.array(of_model, int).reshape(-1, 2).T

    def evaluate(quantities):
        with plain_errors(f"The function {getattr(function, '__name__', '')!r} of `propagate`"):
            result = function(unflatten(vector.at[at].set(quantities[chosen])))
        return jax.tree.map(lambda leaf: jnp.asarray(leaf, float), result)

    _, unravel = ravel_pytree(evaluate(spread.mean))
    value, J = value_and_jacobian(lambda x: ravel_pytree(evaluate(x))[0], spread.mean)
    half = J @ spread.root
    covariance = half @ half.T
    by_shared = (J @ spread.reaction) * ~estimate.on_bound[None]
    weak = estimate.spectrum.weak_share(by_shared, estimate.threshold) > SHARE
    # An undetermined unknown of the record, and not on its bound
    own = estimate.information.own.undetermined[case] & ~jnp.isnan(estimate.own_errors[case])
    weak = weak | jnp.any((J[:, : own.size] != 0) & own[None], axis=-1)
    errors = jnp.where(weak, jnp.inf, jnp.sqrt(jnp.diagonal(covariance)))
    samples = None
    if key is not None and draws:
        normal = jax.random.normal(key, (draws, spread.root.shape[1]))
        samples = jax.vmap(evaluate)(spread.mean[None] + normal @ spread.root.T)
    return unravel(value), unravel(errors), covariance, samples


def _spread(
    estimate: Estimate, considered: FixedConstants | None, case: int, coloured: bool
) -> Spread:
    """Return the uncertain quantities of one record and the square root of their covariance.

    d_own = inverse (e - coupling d_shared) + own_gain d_constants

    With `coloured`, the covariance of own and shared parameters is the corrected one.
    """
    own = estimate.information.own
    inverse, coupling = own.inverse[case], own.coupling[case]
    half = estimate.spectrum.square_root(estimate.threshold)
    n_own, n_shared = inverse.shape[0], half.shape[0]
    react = -inverse @ coupling
    reaction = jnp.concatenate([react, jnp.eye(n_shared)])
    if coloured:
        half = half * colour_ratio(estimate.standard_errors, estimate.corrected_errors)[:, None]
        corrected = covariance_of_unknowns(estimate.corrected_own[case], half @ half.T)
        columns = [square_factor(corrected)]
    else:
        columns = [reaction @ half, jnp.concatenate([inverse, jnp.zeros((n_shared, n_own))])]
    mean, names = [estimate.own[case], estimate.values], estimate.free.per_record + estimate.names
    if considered is not None:
        n_constants = len(considered.names)
        through = reaction @ considered.gain
        through = through.at[:n_own].add(considered.own_gain[case])
        columns = [jnp.pad(block, ((0, n_constants), (0, 0))) for block in columns]
        reaction = jnp.pad(reaction, ((0, n_constants), (0, 0)))
        last = jnp.concatenate([through, jnp.eye(n_constants)]) * considered.deviations[None]
        columns.append(last)
        mean.append(considered.values)
        names = names + considered.names
    return Spread(
        jnp.concatenate(mean), jnp.concatenate(columns, axis=1), reaction, tuple(enumerate(names))
    )


def _labels(value: Any) -> tuple[str, ...]:
    """Return a name for each element of a tree of arrays."""
    labels = []
    for path, leaf in jax.tree_util.tree_flatten_with_path(value)[0]:
        name = ".".join(str(getattr(part, "key", getattr(part, "idx", part))) for part in path)
        for index in np.ndindex(np.shape(leaf)):
            element = f"[{','.join(map(str, index))}]" if index else ""
            labels.append(f"{name}{element}" or "value")
    return tuple(labels)


def _elements(tree: Any) -> list[float]:
    """Return all elements of a tree of arrays."""
    return [float(x) for leaf in jax.tree.leaves(tree) for x in np.ravel(np.asarray(leaf))]
