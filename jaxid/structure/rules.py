"""Rules that select one model of a path."""

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
    """Rule for the selection of a model of a path."""

    @abc.abstractmethod
    def pick(self, selection: Selection) -> int:
        """Return the index of the selected model in `selection.models`."""


class FirstMaximumF(AbstractRule):
    """The report's rule: the first maximum of the overall F (B.20) along the path.

    Source: section 3.3.2, Figs 3.3, 3.4.
    """

    def pick(self, selection: Selection) -> int:
        F = _overall_F(selection)
        falls = np.flatnonzero(F[1:] < F[:-1])
        return int(falls[0]) if falls.size else len(F) - 1


class MaximumF(AbstractRule):
    """The first model with the largest overall F (B.20) (section 6.2.2, rule 4)."""

    def pick(self, selection: Selection) -> int:
        return int(np.argmax(_overall_F(selection)))


class Minimum(AbstractRule):
    """The first model with the least value of a criterion.

    Args:
        criterion: name of a criterion of `Step`.
    """

    criterion: Literal["PSE", "PRESS", "AIC", "BIC"] = eqx.field(static=True)

    def pick(self, selection: Selection) -> int:
        known = ("PSE", "PRESS", "AIC", "BIC")
        require(
            self.criterion in known,
            f"There is no criterion {self.criterion!r}. Choose one of {', '.join(known)}.",
        )
        return int(np.argmin([getattr(model, self.criterion) for model in selection.models]))


class LastStep(AbstractRule):
    """The last model of the path, determined by the levels of F."""

    def pick(self, selection: Selection) -> int:
        return len(selection.models) - 1


class CrossValidation(AbstractRule):
    """The first model with the least error of predicting each manoeuvre from all others.

    The terms of each model are taken from the path, which is determined by all manoeuvres; only the
    values are fitted without the predicted manoeuvre.

    Args:
        groups: label of the manoeuvre of each sample, such as an integer, shape (time,).
    """

    groups: np.ndarray = eqx.field(converter=np.asarray)

    def pick(self, selection: Selection) -> int:
        return int(np.argmin(self.errors(selection)))

    def errors(self, selection: Selection) -> Float[np.ndarray, " model"]:
        """Return the weighted mean square prediction error of each model [response^2].

        Raises:
            InputError: if the number of labels is not the number of samples, there are fewer than
                two manoeuvres, or too few samples remain without a manoeuvre.
        """
        problem, labels = selection.problem, np.asarray(self.groups)
        require(
            labels.shape == (problem.samples,),
            f"There are {problem.samples} samples, and the groups have shape {labels.shape}. Give "
            "a label for each sample.",
        )
        each = np.unique(labels)
        require(len(each) >= 2, "There is one manoeuvre. Cross-validation needs at least two.")
        models = [[problem.names.index(name) for name in model.terms] for model in selection.models]
        most = max(map(len, models)) + problem.constant
        weighted = (
            np.column_stack([problem.X / problem.scale, np.ones(problem.samples), problem.y])
            * problem.root[:, None]
        )
        total = np.zeros(len(models))
        for label in each.tolist():
            test = labels == label
            require(
                bool(np.sum(~test) > most),
                f"Without the manoeuvre {label!r} there are {np.sum(~test)} samples, too few for "
                f"{most} values. Give smaller models or more samples.",
            )
            triangle = np.asarray(np.linalg.qr(weighted[~test], mode="r"))
            for k, model in enumerate(models):
                use = [*model, *([len(problem.names)] if problem.constant else [])]
                values = np.linalg.lstsq(triangle[:, use], triangle[:, -1], rcond=None)[0]
                total[k] += np.sum((weighted[test, -1] - weighted[test][:, use] @ values) ** 2)
        return total / problem.samples


def choose(selection: Selection, rule: AbstractRule) -> Regression:
    """Return the regression of the model that the rule selects, fitted to all samples.

    Args:
        selection: result of `stepwise` or `best_subsets`.
        rule: `FirstMaximumF()`, `MaximumF()`, `Minimum("BIC")`, `LastStep()`,
            `CrossValidation(groups)`.
    """
    terms = selection.models[rule.pick(selection)].terms
    return regress(selection.problem, [selection.problem.names.index(name) for name in terms])


def _overall_F(selection: Selection) -> np.ndarray:
    """Return the overall F along the path, zero for a model without a term."""
    return np.nan_to_num([model.overall_F for model in selection.models], nan=0.0, posinf=np.inf)
