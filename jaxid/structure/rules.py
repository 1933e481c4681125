"""Rules that pick one model of a selection's path."""

import abc
from typing import Literal

import equinox as eqx
import numpy as np

from .._foundation.checks import require
from .._foundation.types import Float
from .least_squares import regress
from .regression import Regression
from .selection import Selection


class AbstractRule(eqx.Module):
    """Which model of a path is taken."""

    @abc.abstractmethod
    def pick(self, selection: Selection) -> int:
        """Number of the model among `selection.models`."""


class FirstMaximumF(AbstractRule):
    """The report's: the first model of the path after which the overall F (B.20) falls (section 3.3.2, Figs 3.3, 3.4)."""

    def pick(self, selection: Selection) -> int:
        F = _overall_F(selection)
        falls = np.flatnonzero(F[1:] < F[:-1])
        return int(falls[0]) if falls.size else len(F) - 1


class MaximumF(AbstractRule):
    """The model of the largest overall F (B.20), the first of several (section 6.2.2, rule 4)."""

    def pick(self, selection: Selection) -> int:
        return int(np.argmax(_overall_F(selection)))


class Minimum(AbstractRule):
    """The model for which a criterion is least, the first of several.

    Args:
        criterion: one of those that a step has.
    """

    criterion: Literal["PSE", "PRESS", "AIC", "BIC"] = eqx.field(static=True)

    def pick(self, selection: Selection) -> int:
        known = ("PSE", "PRESS", "AIC", "BIC")
        require(self.criterion in known, f"There is no criterion {self.criterion!r}. Choose one of {', '.join(known)}.")
        return int(np.argmin([getattr(model, self.criterion) for model in selection.models]))


class LastStep(AbstractRule):
    """The model with which the path stopped: what the levels of F leave."""

    def pick(self, selection: Selection) -> int:
        return len(selection.models) - 1


class CrossValidation(AbstractRule):
    """The model that predicts whole manoeuvres best, each from a fit to all others; the first of several.

    The models are those of the path, which all manoeuvres led; only their values are fitted anew.

    Args:
        groups: label of the manoeuvre of each sample, such as whole numbers, shape (time,).
    """

    groups: np.ndarray = eqx.field(converter=np.asarray)

    def pick(self, selection: Selection) -> int:
        return int(np.argmin(self.errors(selection)))

    def errors(self, selection: Selection) -> Float[np.ndarray, " model"]:
        """Weighted mean square of the error of prediction of each model [response^2].

        Raises:
            InputError: when there are not as many labels as samples, fewer than two manoeuvres, or one whose absence leaves too
                few samples.
        """
        problem, labels = selection.problem, np.asarray(self.groups)
        require(
            labels.shape == (problem.samples,),
            f"There are {problem.samples} samples, and the groups have shape {labels.shape}. Give a label for each sample.",
        )
        each = np.unique(labels)
        require(len(each) >= 2, "There is one manoeuvre; cross-validation needs two at least.")
        models = [[problem.names.index(name) for name in model.terms] for model in selection.models]
        most = max(map(len, models)) + problem.constant
        whole = (
            np.column_stack([problem.X / problem.scale, np.ones(problem.samples), problem.y]) * problem.root[:, None]
        )
        total = np.zeros(len(models))
        for label in each.tolist():
            held = labels == label
            require(
                bool(np.sum(~held) > most),
                f"Without the manoeuvre {label!r} there are {np.sum(~held)} samples, too few for {most} values.",
            )
            triangle = np.asarray(np.linalg.qr(whole[~held], mode="r"))
            for k, model in enumerate(models):
                use = [*model, *([len(problem.names)] if problem.constant else [])]
                values = np.linalg.lstsq(triangle[:, use], triangle[:, -1], rcond=None)[0]
                total[k] += np.sum((whole[held, -1] - whole[held][:, use] @ values) ** 2)
        return total / problem.samples


def choose(selection: Selection, rule: AbstractRule) -> Regression:
    """The model of the path that the rule picks, fitted to all samples.

    Args:
        selection: from `stepwise` or `best_subsets`.
        rule: `FirstMaximumF()`, `MaximumF()`, `Minimum("BIC")`, `LastStep()`, `CrossValidation(groups)`.
    """
    terms = selection.models[rule.pick(selection)].terms
    return regress(selection.problem, [selection.problem.names.index(name) for name in terms])


def _overall_F(selection: Selection) -> np.ndarray:
    """Overall F along the path, zero where there is no term."""
    return np.nan_to_num([model.overall_F for model in selection.models], nan=0.0, posinf=np.inf)
