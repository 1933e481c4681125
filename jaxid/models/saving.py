"""`save` and `load`: a model's parameters, the selection of the free ones and their errors, as a
JSON file.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from .._foundation.checks import InputError, require
from ..data.io.document import names_of, number, read_document, write_document
from .base import AbstractModel, as_float, canonical
from .errors import EstimateErrors, errors_of
from .free import Free, all_names, with_values
from .free import free as free_parameters
from .innovation import InnovationModel
from .names import flat_vector, parameter_names
from .stochastic import StochasticModel

DOCUMENT, FORMAT_VERSION = "jaxid model", 1
CHANNEL_KINDS = ("states", "inputs", "outputs")


class Saved(NamedTuple):
    """Content of a file of `save`.

    Attributes:
        model: the model with the values of the file.
        free: the selection of free parameters, None if the file has none.
        errors: values with standard errors and covariance, None if the file has none.
    """

    model: AbstractModel
    free: Free | None
    errors: EstimateErrors | None = None


@runtime_checkable
class Fitted(Protocol):
    """The result of a fit that `save` writes, such as an `Estimate`."""

    model: AbstractModel
    free: Free

    @property
    def errors(self) -> EstimateErrors: ...


def save(path: str | Path, model: AbstractModel | Fitted, free: Free | None = None) -> Path:
    """Write an estimate, or the parameters of a model, to a new JSON file.

        jaxid.save("spring.json", fit)

    The file holds numbers by name, channels and units, and no code: `load` needs a model of the
    same structure. Values are read back bit for bit. An estimate is written with its free
    parameters, standard errors, covariance and R; residuals and records are not. Of one by
    `FilterError` or `InnovationForm` the model without its noises or gains is written, which stand
    among the errors.

    Args:
        path: path of the new file, in an existing folder.
        model: an estimate, or a model.
        free: for a model, its free parameters with their bounds, scales and priors.

    Returns:
        The path.

    Raises:
        InputError: when the file exists, the folder does not, `model` is neither, the free
            parameters belong to another model, or they are given for an estimate.
    """
    declared, free, errors = _parts(model, free)
    content = _content(canonical(declared), free)
    content["errors"] = None if errors is None else errors.to_dict()
    return write_document(path, content, kind=DOCUMENT, version=FORMAT_VERSION)


def _content(model: AbstractModel, free: Free | None) -> dict[str, Any]:
    """Return a model and its free parameters in the form of the file."""
    values = np.asarray(flat_vector(model))
    content: dict[str, Any] = {
        "model": type(model).__name__,
        **{kind: list(getattr(model, kind)) for kind in CHANNEL_KINDS},
        "parameters": dict(zip(parameter_names(model), values.tolist(), strict=True)),
        "units": dict(model.units()),
        "free": None,
    }
    if free is not None:
        free.positions(model)  # refuses names that the model does not have
        content["free"] = {
            "shared": list(free.shared),
            "per_record": list(free.per_record),
            "lower": _floats(free.lower),
            "upper": _floats(free.upper),
            "scale": _floats(free.scale),
            "prior": {name: [float(x) for x in pair] for name, pair in free.prior.items()},
        }
    return content


def _parts(
    given: AbstractModel | Fitted, free: Free | None
) -> tuple[AbstractModel, Free | None, EstimateErrors | None]:
    """Return model, free parameters and errors of an estimate, or of a model without errors."""
    if isinstance(given, AbstractModel):
        return given, free, None
    if not isinstance(given, Fitted):
        raise InputError(
            f"`save` writes an estimate or a model, and this is a {type(given).__name__}. Give "
            "`save(path, fit)`, of a study `save(path, study.after.estimate)`."
        )
    require(free is None, "An estimate has its free parameters. Leave `free` out.")
    model, free = given.model, given.free
    if isinstance(model, StochasticModel | InnovationModel):
        model = model.model
        free = free.only(all_names(model))
    return model, free if free.shared or free.per_record else None, given.errors


def load(path: str | Path, like: AbstractModel) -> Saved:
    """Return the model, the free parameters and the errors of a file of `save`.

        saved = jaxid.load("spring.json", like=Spring(mass=1.0, k=1.0, c=0.1))
        saved.model, saved.free, saved.errors.covariance

    Args:
        path: the file.
        like: a model of the same class and structure; its values are replaced. A model with effects
            is built as before, by `Augmented`.

    Raises:
        InputError: when the file is not one of `save`, is of a newer version, or does not fit the
            model: another class, other channels, or parameters that only one of both has.
    """
    require(
        isinstance(like, AbstractModel),
        f"`like` is {like!r}. Give a model: the class with values, such as Spring(k=1.0, c=0.1).",
    )
    content = read_document(path, kind=DOCUMENT, version=FORMAT_VERSION)
    name, like = Path(path).name, canonical(like)
    _require_fit(content, like, name)
    parameters = _mapping(content, "parameters", name)
    names = parameter_names(like)
    missing = [parameter for parameter in names if parameter not in parameters]
    unknown = [parameter for parameter in parameters if parameter not in names]
    require(
        not missing and not unknown,
        f"{name} does not fit the model. "
        + (f"The file lacks {', '.join(missing)}. " if missing else "")
        + (f"The model lacks {', '.join(unknown)}. " if unknown else "")
        + "Give a model of the structure that was saved, with the same effects and terms.",
    )
    values = [number(parameters[parameter], f"{name}: {parameter!r}") for parameter in names]
    model = with_values(like, names, as_float(values))
    errors = errors_of(content.get("errors"), name)
    return Saved(model, _free_of(content.get("free"), model, name), errors)


def _require_fit(content: Mapping[str, Any], like: AbstractModel, name: str) -> None:
    """Refuse a file of another class of models or with other channels."""
    require(
        content.get("model") == type(like).__name__,
        f"{name} holds a model of the class {content.get('model')!r}, and `like` is a "
        f"{type(like).__name__!r}. Give a model of the class that was saved.",
    )
    for kind in CHANNEL_KINDS:
        written, own = content.get(kind), list(getattr(like, kind))
        require(
            written == own,
            f"{name}: the {kind} are {written}, and those of the model {own}. Give a model with "
            "the same channels.",
        )


def _free_of(content: Any, model: AbstractModel, name: str) -> Free | None:
    """Return the free parameters of a file, after the checks of `free`."""
    if content is None:
        return None
    require(isinstance(content, dict), f"{name}: 'free' is no object. Write the file again.")
    shared, per_record = (names_of(content, key, name) for key in ("shared", "per_record"))
    lower, upper, scale = (_numbers(content, key, name) for key in ("lower", "upper", "scale"))
    prior = {}
    for parameter, pair in _mapping(content, "prior", name).items():
        require(
            isinstance(pair, list) and len(pair) == 2,
            f"{name}: the prior of {parameter!r} is {pair!r}; it is a mean and a standard "
            "deviation.",
        )
        mean, deviation = (number(x, f"{name}: prior of {parameter!r}") for x in pair)
        prior[parameter] = (mean, deviation)
    bounds = {key: (lower.get(key), upper.get(key)) for key in (*lower, *upper)}
    try:
        return free_parameters(
            model, *shared, per_record=per_record, bounds=bounds, scale=scale, prior=prior
        )
    except InputError as error:
        raise InputError(f"{name}: {error}") from error


def _floats(numbers: Mapping[str, Any]) -> dict[str, float]:
    return {name: float(value) for name, value in numbers.items()}


def _mapping(content: Mapping[str, Any], key: str, name: str) -> dict[str, Any]:
    """Return an object of the file."""
    value = content.get(key)
    require(isinstance(value, dict), f"{name}: {key!r} is missing or no object. Write it again.")
    return value if isinstance(value, dict) else {}


def _numbers(content: Mapping[str, Any], key: str, name: str) -> dict[str, float]:
    """Return an object of numbers of the file."""
    values = _mapping(content, key, name)
    return {entry: number(value, f"{name}: {key} of {entry!r}") for entry, value in values.items()}
