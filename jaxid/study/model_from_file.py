"""The model and the likelihood of a study file."""

import inspect
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp

from .._foundation.checks import InputError, require, require_known
from ..data.io.named_objects import Product, call, named_object
from ..data.io.study import StudyFile
from ..data.units import convert, to_si
from ..estimation.likelihoods import OutputError
from ..models.base import AbstractModel
from ..models.noise import FixedNoise
from ..models.polynomial import Polynomial
from ..models.replace import with_polynomials
from ..simulation.hold import AbstractHold, BandLimited, Cubic, Linear, ZeroOrder
from ..simulation.steppers import RK4
from ..structure import columns
from .terms.regressions import equations_of

MODEL = Product(AbstractModel, is_collection=False, description="a model")
HOLDS: dict[str, Callable[[], AbstractHold]] = {
    "linear": Linear,
    "zero_order": ZeroOrder,
    "cubic": Cubic,
    "band_limited": BandLimited,
}


class BuiltIn(NamedTuple):
    """A model built from a record, with polynomials whose terms the study file names.

    Attributes:
        make: function of the first training record and the settings; returns a model with
            pseudo-measurements.
        settings: names of the settings.
    """

    make: Callable[..., AbstractModel]
    settings: tuple[str, ...]


def model_of_module(file: StudyFile, built_in: tuple[str, ...]) -> AbstractModel:
    """Model from a class, or from a function that returns one, with its parameters."""
    for key in ("aircraft", "terms"):
        with file.at("model", key):
            require(
                key not in file.model,
                f"it belongs to a built-in model (use = {' or '.join(built_in)}). Leave it out.",
            )
    with file.at("model", "use"):
        make = named_object(
            file.model["use"],
            file.path.parent,
            MODEL,
            f" A built-in model is named without a module: {', '.join(built_in)}.",
        )
    given = file.model.get("parameters", {})
    with file.at("model", "parameters"):
        known = inspect.signature(make).parameters.values()
        names = [
            argument.name
            for argument in known
            if argument.kind in (argument.POSITIONAL_OR_KEYWORD, argument.KEYWORD_ONLY)
        ]
        require_known(f"parameter of {file.model['use']}", given, names)
        missing = [
            argument.name
            for argument in known
            if argument.name in names
            and argument.default is argument.empty
            and argument.name not in given
        ]
        require(
            not missing,
            f"{', '.join(missing)} must have a starting value. Give "
            f"{' and '.join(f'{n} = 1.0' for n in missing)}.",
        )
        values = {name: _leaf(value) for name, value in given.items()}
        model = call(file.model["use"], make, **values)
    with file.at("model", "use"):
        require(
            isinstance(model, AbstractModel),
            f"{file.model['use']} gives a {type(model).__name__}, which is no jaxid.AbstractModel. "
            "Make it a subclass.",
        )
    return model


def model_with_terms(file: StudyFile, built_in: BuiltIn) -> AbstractModel:
    """Built-in model with the terms that the file names, with zero coefficients.

    A response without terms is left out: its state takes its measured history.
    """
    model, terms = built_in_model(file, built_in), file.model.get("terms", {})
    with file.at("model", "terms"):
        require(
            bool(terms),
            'it is missing. Name the terms of each coefficient, such as Cm = ["alpha", "qhat"].',
        )
        measured = equations_of(model, weak_radius_of(file))(file.train[0])
        responses = tuple(name for name, _ in measured.candidates)
        require_known("coefficient", terms, responses)
        for products in terms.values():
            # raises an error if a term cannot be parsed or occurs twice
            columns(products, measured.signals)
        blank = {
            name: Polynomial(dict.fromkeys(with_constant(products), 0.0))
            for name, products in terms.items()
        }
        others = tuple(name for name in responses if name not in terms)
        return with_polynomials(model.without(others), blank)


def built_in_model(file: StudyFile, built_in: BuiltIn, **others: Any) -> AbstractModel:
    """Return the built-in model of a study file without terms; `others` are further arguments."""
    use = file.model["use"]
    with file.at("model", "parameters"):
        require(
            "parameters" not in file.model,
            f"{use} takes settings from [model.{use}] and terms from [model.terms].",
        )
    with file.at("model", use):
        settings = file.model.get(use, {})
        require_known("setting", settings, built_in.settings)
        values = {name: _float(value) for name, value in settings.items()}
        return built_in.make(file.train[0], **values, **others)


def with_constant(products: Sequence[str]) -> tuple[str, ...]:
    """Return the terms of a coefficient, the constant first, even if it is not among `products`."""
    return tuple(dict.fromkeys(("1", *products)))


def given_terms(file: StudyFile) -> dict[str, Any]:
    """Return the terms of a study file as options of `identify`: all are kept and estimated."""
    terms = {name: with_constant(products)[1:] for name, products in file.model["terms"].items()}
    return {"terms": terms, "keep": tuple(terms), "share": 0.0}


def weak_radius_of(file: StudyFile) -> float | None:
    """Return the radius of test functions of a study file [s]; None: regression on samples."""
    return file.identify.get("weak_radius")


def likelihood_of(file: StudyFile, model: AbstractModel) -> OutputError:
    """Output error, with known noise if the file states it."""
    stepper, name = RK4(substeps=file.model.get("substeps", 1)), file.model.get("hold", "linear")
    with file.at("model", "hold"):
        require_known("hold of the inputs", [name], HOLDS)
    hold = HOLDS[name]()
    if not file.noise:
        return OutputError(hold=hold, stepper=stepper)
    with file.at("noise"):
        require_known("output", file.noise, model.outputs)
        missing = [name for name in model.outputs if name not in file.noise]
        require(
            not missing,
            f"{', '.join(missing)} has no standard deviation. Give one for every output, "
            "or leave [noise] out.",
        )
        units = dict(zip(file.train[0].outputs, file.train[0].output_units, strict=True))
        deviations = [
            _deviation(file.noise[name], units.get(name, ""), name) for name in model.outputs
        ]
    return OutputError(FixedNoise([deviation**2 for deviation in deviations]), hold, stepper)


def _leaf(value: Any) -> Any:
    """Return a number or a list of numbers as an array; any other value unchanged."""
    if isinstance(value, bool | str | dict):
        return value
    try:
        return jnp.asarray(value, float)
    except (OverflowError, TypeError, ValueError) as error:
        raise InputError(
            f"found {str(value)[:40]!r}, and a number or a list of numbers is wanted. Correct it."
        ) from error


def _float(value: Any) -> Any:
    """Return an integer as a float (TOML files may write 5000 kg without a point)."""
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _deviation(entry: float | str, unit: str, name: str) -> float:
    """Return a standard deviation in SI; in a text the unit follows the number."""
    value = entry
    if isinstance(entry, str):
        number, given = entry.split(maxsplit=1)
        try:
            values = [float(number), 0.0]
            target = unit or to_si(0.0, given, name)[1]
            converted, zero = convert(values, given, target, name)
        except ValueError as error:
            raise InputError(
                f"{name} = {entry!r} is no number with a unit of this channel: {error}"
            ) from error
        value = converted - zero  # a difference of 1 degC is 1 K
    deviation = float(value)
    require(
        deviation > 0 and 0 < deviation * deviation < math.inf,
        f"the standard deviation of {name} is {entry}. Give one that is positive and finite, like "
        "its square.",
    )
    return deviation
