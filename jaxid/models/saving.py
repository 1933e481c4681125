"""`save` and `load`: a model's parameters and the selection of the free ones, as a JSON file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .._foundation.checks import InputError, require
from ..data.io.document import number, read_document, write_document
from .base import AbstractModel, as_float, canonical
from .free import Free, with_values
from .free import free as free_parameters
from .names import flat_vector, parameter_names

DOCUMENT, FORMAT_VERSION = "jaxid model", 1
CHANNEL_KINDS = ("states", "inputs", "outputs")


class Saved(NamedTuple):
    """Content of a file of `save`.

    Attributes:
        model: the model with the values of the file.
        free: the selection of free parameters, None if the file has none.
    """

    model: AbstractModel
    free: Free | None


def save(path: str | Path, model: AbstractModel, free: Free | None = None) -> Path:
    """Write the parameters of a model, and which of them are free, to a new JSON file.

    The file holds numbers by name, channels and units, and no code: `load` needs a model of the
    same structure. Values are read back bit for bit. For a fit:

        jaxid.save("spring.json", fit.model, fit.free)

    (For one by `FilterError`, `fit.model.model` is the model without its noises.)

    Args:
        path: path of the new file, in an existing folder.
        model: the model.
        free: free parameters with their bounds, scales and priors.

    Returns:
        The path.

    Raises:
        InputError: when the file exists, the folder does not, `model` is not a model, or the free
            parameters are those of another model.
    """
    require(
        isinstance(model, AbstractModel),
        f"`save` writes a model, and this is a {type(model).__name__}. Give "
        "`save(path, fit.model, fit.free)`; `fit.to_dict()` holds the standard errors.",
    )
    model = canonical(model)
    values = np.asarray(flat_vector(model))
    content = {
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
    return write_document(path, content, kind=DOCUMENT, version=FORMAT_VERSION)


def load(path: str | Path, like: AbstractModel) -> Saved:
    """Return the model and the free parameters of a file of `save`.

        fitted, free = jaxid.load("spring.json", like=Spring(mass=1.0, k=1.0, c=0.1))

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
    return Saved(model, _free_of(content.get("free"), model, name))


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
    shared, per_record = (_texts(content, key, name) for key in ("shared", "per_record"))
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


def _texts(content: Mapping[str, Any], key: str, name: str) -> tuple[str, ...]:
    """Return a list of names of the file."""
    value = content.get(key)
    texts: Sequence[Any] = value if isinstance(value, list) else [None]
    require(
        all(isinstance(text, str) for text in texts),
        f"{name}: {key!r} is missing or no list of names. Write it again.",
    )
    return tuple(texts)
