"""`case_of`: the arguments of `close_loop` from a study file; every name in the file is checked
against the model.
"""

import dataclasses
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp

from .._foundation.checks import InputError, require, require_known
from ..data.io.named_objects import Product, call, named_object
from ..data.io.study import StudyFile
from ..data.record import Record
from ..data.stack import stack
from ..data.units import convert, to_si
from ..effects.base import Effect
from ..estimation.likelihoods import OutputError
from ..loop.options import LoopOptions
from ..models.base import AbstractModel
from ..models.free import Free, free
from ..models.noise import FixedNoise
from ..models.polynomial import Polynomial
from ..models.replace import with_polynomials
from ..simulation.hold import AbstractHold, BandLimited, Cubic, Linear, ZeroOrder
from ..simulation.steppers import RK4
from ..structure import columns
from .close_loop import candidates
from .identify import identify
from .identify_options import IdentifyOptions

MODEL = Product(AbstractModel, is_collection=False, description="a model")
HOLDS: dict[str, Callable[[], AbstractHold]] = {
    "linear": Linear,
    "zero_order": ZeroOrder,
    "cubic": Cubic,
    "band_limited": BandLimited,
}
EFFECTS = Product(Effect, is_collection=True, description="effects")


class BuiltIn(NamedTuple):
    """A model built from a record, with polynomials whose terms the study file names.

    Attributes:
        make: function of the first training record and the settings; returns a model with
            pseudo-measurements.
        settings: names of the settings.
    """

    make: Callable[..., AbstractModel]
    settings: tuple[str, ...]


class Case(NamedTuple):
    """Arguments of `close_loop`.

    Attributes:
        model, free, likelihood: declared model, its free parameters, and measure of the misfit.
        train, check, test: records, with the model's channels.
        effects: candidates; None for the default library.
        window, options: window of the predictions, and levels and limits of the loop.
    """

    model: AbstractModel
    free: Free
    likelihood: OutputError
    train: tuple[Record, ...]
    check: tuple[Record, ...] | None
    test: dict[str, tuple[Record, ...]] | None
    effects: tuple[Effect, ...] | None
    window: int | None
    options: LoopOptions


def case_of(
    file: StudyFile,
    built_in: Mapping[str, BuiltIn],
    progress: Callable[[str], None] = lambda _: None,
) -> Case:
    """Build the model of a study file, and check the contents of the file against it.

    Args:
        file: result of `read_study`.
        built_in: models that the file may name instead of `module:Class`, by name; the section of
            the settings has the same name.
        progress: function that receives a short text at every step.

    Returns:
        The arguments of `close_loop`.

    Raises:
        InputError: if a module, class, parameter, channel, candidate or option does not exist or
            has the wrong type; the message names the file, the section and the key.
    """
    window, options = _loop(file)
    use = file.model["use"]
    if use not in built_in:
        model = _of_module(file, tuple(built_in))
        likelihood = _likelihood(file, model)
    else:
        blank = _of_record(file, built_in[use])
        likelihood = _likelihood(file, blank)
        _names(file, blank, bounded=False)  # wrong names are refused before the regression
        progress("regression on the chosen terms, and a first estimate")
        model = _regressed(file, blank, likelihood)
    named = _names(file, model)
    return Case(
        model,
        named.free,
        likelihood,
        named.train,
        named.check or None,
        named.test or None,
        named.effects,
        window,
        options,
    )


class _Named(NamedTuple):
    """The parts of a study file that name parameters, channels and candidates of the model.

    Attributes:
        free: free parameters.
        train, check: records with the model's channels.
        test: the same by name of set.
        effects: candidates; None for the default library.
    """

    free: Free
    train: tuple[Record, ...]
    check: tuple[Record, ...]
    test: dict[str, tuple[Record, ...]]
    effects: tuple[Effect, ...] | None


def _names(file: StudyFile, model: AbstractModel, bounded: bool = True) -> _Named:
    """Free parameters, records with the model's channels, and candidates."""
    with file.at("records"):
        train, check = _prepared(model, file.train), _prepared(model, file.check or ())
        tests = {name: _prepared(model, part) for name, part in (file.test or {}).items()}
    chosen = _free(file, model, bounded)
    stacks = [stack(part) for part in (train, check, *tests.values()) if part]
    effects = _library(file, model, chosen, stacks) if file.library else None
    return _Named(chosen, train, check, tests, effects)


def _loop(file: StudyFile) -> tuple[int | None, LoopOptions]:
    """The window and the options of the loop."""
    defaults = {field.name: field.default for field in dataclasses.fields(LoopOptions)}
    defaults.pop("noises")  # a class, which no file can hold
    with file.at("loop"):
        require_known("key", file.loop, ("window", *defaults))
    counts = {"window", *(name for name, default in defaults.items() if isinstance(default, int))}
    values: dict[str, Any] = {name: _loop_value(file, name, name in counts) for name in file.loop}
    window = values.pop("window", None)
    with file.at("loop"):
        return window, LoopOptions(**values)


def _loop_value(file: StudyFile, name: str, is_count: bool) -> int | float:
    """Value of one key of the section `loop`; a count must be an integer, at least zero."""
    value = file.loop[name]
    if not is_count:
        return float(value)
    with file.at("loop", name):
        require(
            isinstance(value, int) and value >= 0,
            f"found {value}, and a whole number is wanted.",
        )
    return value


def _of_module(file: StudyFile, built_in: tuple[str, ...]) -> AbstractModel:
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


def _of_record(file: StudyFile, built_in: BuiltIn) -> AbstractModel:
    """Built-in model with the terms that the file names, with zero coefficients.

    A response without terms is left out: its state takes its measured history.
    """
    use, terms = file.model["use"], file.model.get("terms", {})
    with file.at("model", "parameters"):
        require(
            "parameters" not in file.model,
            f"{use} takes settings from [model.{use}] and terms from [model.terms].",
        )
    with file.at("model", use):
        settings = file.model.get(use, {})
        require_known("setting", settings, built_in.settings)
        model = built_in.make(
            file.train[0], **{name: _float(value) for name, value in settings.items()}
        )
    with file.at("model", "terms"):
        require(
            bool(terms),
            'it is missing. Name the terms of each coefficient, such as Cm = ["alpha", "qhat"].',
        )
        measured = model.pseudo_measurements(file.train[0])
        require_known("coefficient", terms, measured.responses)
        for products in terms.values():
            # raises an error if a term cannot be parsed or occurs twice
            columns(products, measured.signals)
        blank = {
            name: Polynomial(dict.fromkeys(with_constant(products), 0.0))
            for name, products in terms.items()
        }
        others = tuple(name for name in measured.responses if name not in terms)
        return with_polynomials(model.without(others), blank)


def with_constant(products: Sequence[str]) -> tuple[str, ...]:
    """Return the terms of a coefficient, the constant first, even if it is not among `products`."""
    return tuple(dict.fromkeys(("1", *products)))


def _regressed(file: StudyFile, blank: AbstractModel, likelihood: OutputError) -> AbstractModel:
    """Model with the values of a regression and a first estimate."""
    terms = {name: with_constant(products)[1:] for name, products in file.model["terms"].items()}
    options = IdentifyOptions(terms=terms, keep=tuple(terms), share=0.0)
    with file.at("model", "terms"):
        return identify(
            blank, file.train, options=options, likelihood=likelihood, per_record=_per_record(file)
        ).model


def _likelihood(file: StudyFile, model: AbstractModel) -> OutputError:
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


def _prepared(model: AbstractModel, records: tuple[Record, ...]) -> tuple[Record, ...]:
    return tuple(model.prepared(record) for record in records)


def _free(file: StudyFile, model: AbstractModel, bounded: bool) -> Free:
    """Free parameters: those that the file names, or by default all coefficients of the terms of a
    built-in model.
    """
    by_coefficient = file.model.get("terms", {}).items()
    terms = (
        f"{name}.{term}" for name, products in by_coefficient for term in with_constant(products)
    )
    names = tuple(file.free.get("parameters", terms))
    bounds = {
        name: (float(low), float(high)) for name, (low, high) in file.free.get("bounds", {}).items()
    }
    with file.at("free"):
        require(
            len(names) > 0,
            "`parameters` is missing or empty. Name the parameters that the data shall determine.",
        )
        chosen = free(
            model, *names, per_record=_per_record(file), bounds=bounds if bounded else None
        )
        require_known("free parameter (in `bounds`)", bounds, chosen.shared + chosen.per_record)
    return chosen


def _per_record(file: StudyFile) -> tuple[str, ...]:
    return tuple(file.free.get("per_record", ("initial_state",)))


def _library(
    file: StudyFile, model: AbstractModel, chosen: Free, records: Sequence[Record]
) -> tuple[Effect, ...]:
    """Default candidates and those of the file, without the candidates that it leaves out."""
    effects = candidates(model, chosen, *records) if file.library.get("general", True) else ()
    for name in file.library.get("effects", ()):
        with file.at("library", "effects"):
            function = named_object(name, file.path.parent, EFFECTS)
            added = call(name, function, model)
            require(
                isinstance(added, Sequence) and all(isinstance(effect, Effect) for effect in added),
                f"{name} returns an object that is not a jaxid.Effect.",
            )
        effects += tuple(added)
    with file.at("library", "leave_out"):
        names = [effect.name for effect in effects]
        known = dict.fromkeys(names + [effect.card.family for effect in effects])
        left_out = file.library.get("leave_out", ())
        require_known("candidate or family", left_out, known)
    effects = tuple(
        effect
        for effect in effects
        if effect.name not in left_out and effect.card.family not in left_out
    )
    with file.at("library"):
        require(
            len(effects) > 0, "no candidate is left. Name some by `effects`, or leave out fewer."
        )
    return effects


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
    require(
        float(value) > 0, f"the standard deviation of {name} is {entry}. Give one that is positive."
    )
    return float(value)
