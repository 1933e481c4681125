"""From a study file to what `close_loop` takes: the model is made, and every name in the file is held against it."""

import dataclasses
import importlib
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp

from .._foundation.checks import InputError, require, require_known
from ..data.io_study import StudyFile
from ..data.record import Record
from ..data.stack import stack
from ..data.units import convert, to_si
from ..estimation.likelihoods import OutputError
from ..models.base import AbstractModel
from ..models.effects import Effect
from ..models.free import Free, free
from ..models.noise import FixedNoise
from ..models.polynomial import Polynomial
from ..models.replace import with_polynomials
from ..simulation.steppers import RK4
from ..structure import columns
from .close_loop import candidates
from .identify import identify
from .identify_options import IdentifyOptions
from .options import LoopOptions


class BuiltIn(NamedTuple):
    """A model that is made of a record, with polynomials whose terms the file names.

    Attributes:
        make: takes the first training record and the settings, and gives a model with pseudo-measurements.
        settings: names of the settings.
    """

    make: Callable[..., AbstractModel]
    settings: tuple[str, ...]


class Case(NamedTuple):
    """What `close_loop` takes.

    Attributes:
        model, free, likelihood: what is declared.
        train, check, test: the records, with the model's channels.
        effects: candidates; None for the default library.
        window, options: how the loop decides.
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


def case_of(file: StudyFile, built_in: Mapping[str, BuiltIn], progress: Callable[[str], None] = lambda _: None) -> Case:
    """Make the model that a study file names, and check all that the file says against it.

    Args:
        file: from `read_study`.
        built_in: models that the file may name in the place of `module:Class`, each called as its section of settings.
        progress: is told what is going on.

    Returns:
        What `close_loop` takes.

    Raises:
        InputError: when a module, class, parameter, channel, candidate or option does not exist or is not of its kind; the
            file, its section and its key are named.
    """
    window, options = _loop(file)
    use = file.model["use"]
    if use not in built_in:
        model = _of_module(file, tuple(built_in))
        likelihood = _likelihood(file, model)
    else:
        blank = _of_record(file, built_in[use])
        likelihood = _likelihood(file, blank)
        _names(file, blank, bounded=False)  # refused before the regression rather than after it
        progress("regression on the chosen terms, and a first estimate")
        model = _regressed(file, blank, likelihood)
    chosen, parts, tests, effects = _names(file, model)
    return Case(model, chosen, likelihood, parts[0], parts[1] or None, tests or None, effects, window, options)


def _names(file: StudyFile, model: AbstractModel, bounded: bool = True):
    """What is free, the records with the model's channels, and the candidates."""
    with file.at("records"):
        parts = [_prepared(model, part) for part in (file.train, file.check or ())]
        tests = {name: _prepared(model, part) for name, part in (file.test or {}).items()}
    chosen = _free(file, model, bounded)
    stacks = [stack(part) for part in (*parts, *tests.values()) if part]
    effects = _library(file, model, chosen, stacks) if file.library else None
    return chosen, parts, tests, effects


def _loop(file: StudyFile) -> tuple[int | None, LoopOptions]:
    """The window and the options, whole numbers where these are counts."""
    fields = {field.name: field.default for field in dataclasses.fields(LoopOptions)}
    with file.at("loop"):
        require_known("key", file.loop, ("window", *fields))
    counts = {"window", *(name for name, default in fields.items() if isinstance(default, int))}
    for name in (one for one in file.loop if one in counts):
        with file.at("loop", name):
            value = file.loop[name]
            require(isinstance(value, int) and value >= 0, f"found {value}, and a whole number is wanted.")
    chosen: dict[str, Any] = {name: value if name in counts else float(value) for name, value in file.loop.items()}
    with file.at("loop"):
        options = LoopOptions(**{name: value for name, value in chosen.items() if name != "window"})
    return file.loop.get("window"), options


def _of_module(file: StudyFile, built_in: tuple[str, ...]) -> AbstractModel:
    """The model of a class, or of a function that makes one, with its parameters."""
    for key in ("aircraft", "terms"):
        with file.at("model", key):
            require(
                key not in file.model, f"it belongs to a built-in model (use = {' or '.join(built_in)}). Leave it out."
            )
    with file.at("model", "use"):
        make = _object(file.model["use"], f" A built-in model is named by itself: {', '.join(built_in)}.")
    given = file.model.get("parameters", {})
    with file.at("model", "parameters"):
        known = inspect.signature(make).parameters.values()
        names = [one.name for one in known if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)]
        require_known(f"parameter of {file.model['use']}", given, names)
        lacks = [one.name for one in known if one.name in names and one.default is one.empty and one.name not in given]
        require(
            not lacks,
            f"{', '.join(lacks)} must have a starting value. Give {' and '.join(f'{n} = 1.0' for n in lacks)}.",
        )
        model = make(**{name: _leaf(value) for name, value in given.items()})
    with file.at("model", "use"):
        require(
            isinstance(model, AbstractModel),
            f"{file.model['use']} gives a {type(model).__name__}, which is no jaxid.AbstractModel. Make it a subclass.",
        )
    return model


def _of_record(file: StudyFile, built_in: BuiltIn) -> AbstractModel:
    """A built-in model with the terms that the file names, their coefficients zero.

    A response without any is left out: its state is as measured."""
    use, terms = file.model["use"], file.model.get("terms", {})
    with file.at("model", "parameters"):
        require(
            "parameters" not in file.model, f"{use} takes settings from [model.{use}] and terms from [model.terms]."
        )
    with file.at("model", use):
        settings = file.model.get(use, {})
        require_known("setting", settings, built_in.settings)
        model = built_in.make(file.train[0], **{name: _float(value) for name, value in settings.items()})
    with file.at("model", "terms"):
        require(bool(terms), 'it is missing. Name the terms of each coefficient, such as Cm = ["alpha", "qhat"].')
        measured = model.pseudo_measurements(file.train[0])
        require_known("coefficient", terms, measured.responses)
        for products in terms.values():
            columns(products, measured.signals)  # refuses a term that cannot be read, and one that is there twice
        blank = {name: Polynomial(dict.fromkeys(with_constant(products), 0.0)) for name, products in terms.items()}
        others = tuple(name for name in measured.responses if name not in terms)
        return with_polynomials(model.without(others), blank)


def with_constant(products: Sequence[str]) -> tuple[str, ...]:
    """The terms of a coefficient, the constant first, whether the file names it or not."""
    return tuple(dict.fromkeys(("1", *products)))


def _regressed(file: StudyFile, blank: AbstractModel, likelihood: OutputError) -> AbstractModel:
    """The model with the values of a regression and a first estimate."""
    terms = {name: with_constant(products)[1:] for name, products in file.model["terms"].items()}
    options = IdentifyOptions(terms=terms, keep=tuple(terms), share=0.0)
    with file.at("model", "terms"):
        return identify(blank, file.train, options=options, likelihood=likelihood, per_record=_per_record(file)).model


def _likelihood(file: StudyFile, model: AbstractModel) -> OutputError:
    """Output error, with the noise known where the file knows it."""
    stepper = RK4(substeps=file.model.get("substeps", 1))
    if not file.noise:
        return OutputError(stepper=stepper)
    with file.at("noise"):
        require_known("output", file.noise, model.outputs)
        lacks = [name for name in model.outputs if name not in file.noise]
        require(
            not lacks, f"{', '.join(lacks)} has no standard deviation. Give one for every output, or leave [noise] out."
        )
        units = dict(zip(file.train[0].outputs, file.train[0].output_units, strict=True))
        deviations = [_deviation(file.noise[name], units.get(name, ""), name) for name in model.outputs]
    return OutputError(FixedNoise([deviation**2 for deviation in deviations]), stepper=stepper)


def _prepared(model: AbstractModel, records: tuple[Record, ...]) -> tuple[Record, ...]:
    return tuple(model.prepared(record) for record in records)


def _free(file: StudyFile, model: AbstractModel, bounded: bool) -> Free:
    """What the data shall determine: what the file names, or of a built-in model all that its terms brought."""
    of_each = file.model.get("terms", {}).items()
    terms = (f"{name}.{term}" for name, products in of_each for term in with_constant(products))
    names = tuple(file.free.get("parameters", terms))
    bounds = {name: (float(low), float(high)) for name, (low, high) in file.free.get("bounds", {}).items()}
    with file.at("free"):
        require(len(names) > 0, "`parameters` is missing or empty. Name the parameters that the data shall determine.")
        chosen = free(model, *names, per_record=_per_record(file), bounds=bounds if bounded else None)
        require_known("free parameter (in `bounds`)", bounds, chosen.shared + chosen.per_record)
    return chosen


def _per_record(file: StudyFile) -> tuple[str, ...]:
    return tuple(file.free.get("per_record", ("initial_state",)))


def _library(file: StudyFile, model: AbstractModel, chosen: Free, records: Sequence[Record]) -> tuple[Effect, ...]:
    """The default candidates and the file's own, without those that it leaves out."""
    effects = candidates(model, chosen, *records) if file.library.get("general", True) else ()
    for name in file.library.get("effects", ()):
        with file.at("library", "effects"):
            found = tuple(_object(name)(model))
            require(all(isinstance(one, Effect) for one in found), f"{name} gives something that is no jaxid.Effect.")
        effects += found
    with file.at("library", "leave_out"):
        known = dict.fromkeys([one.name for one in effects] + [one.family for one in effects])
        left_out = file.library.get("leave_out", ())
        require_known("candidate or family", left_out, known)
    effects = tuple(one for one in effects if one.name not in left_out and one.family not in left_out)
    with file.at("library"):
        require(len(effects) > 0, "no candidate is left. Name some by `effects`, or leave out fewer.")
    return effects


def _object(name: str, else_what: str = "") -> Callable[..., Any]:
    """What `module:name` stands for."""
    module, _, attribute = name.partition(":")
    require(bool(module and attribute), f"found {name!r}, and `module:name` is wanted.{else_what}")
    try:
        found = importlib.import_module(module)
    except ModuleNotFoundError as error:
        wanted = error.name or ""
        require(
            f"{module}.".startswith(f"{wanted}."),
            f"{module}.py imports {wanted!r}, which is not installed. Install it.",
        )
        raise InputError(
            f"there is no module {error.name!r} beside the file, and none is installed. Put {module}.py there.{else_what}"
        ) from error
    require_known(f"name in the module {module!r}:", [attribute], [n for n in vars(found) if not n.startswith("_")])
    require(callable(getattr(found, attribute)), f"{name} is no class and no function. Name one.")
    return getattr(found, attribute)


def _leaf(value: Any) -> Any:
    """A number, or a list of numbers, as an array; anything else as it stands."""
    if isinstance(value, bool | str | dict):
        return value
    return jnp.asarray(value, float)


def _float(value: Any) -> Any:
    """A whole number as any other: TOML writes 5000 kg without a point."""
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _deviation(said: float | str, unit: str, name: str) -> float:
    """A standard deviation in SI; a text has its unit behind the number."""
    value = said
    if isinstance(said, str):
        number, own = said.split(maxsplit=1)
        try:
            wide, zero = convert([float(number), 0.0], own, unit or to_si(0.0, own, name)[1], name)
        except ValueError as error:
            raise InputError(f"{name} = {said!r} is no number with a unit of this channel: {error}") from error
        value = wide - zero  # so that a degree of temperature is one kelvin
    require(float(value) > 0, f"the standard deviation of {name} is {said}. Give one that is positive.")
    return float(value)
