"""The search for effects: score, refit the best, keep what predicts, drop what has become insignificant, and again."""

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np

from ..data.record import Record
from ..diagnosis.predictable import allowance, predictable_share
from ..diagnosis.scores import Scores, critical
from ..diagnosis.validation import Prediction, root_mean_square
from .check import difference_error, mean_log, uncertainty
from .options import LoopOptions
from .pairs import pairs_of
from .rivals import Rival
from .shortlist import has_no_shape, shortlist
from .study import Candidate, Round
from .workbench import Fitted, Workbench

DETERMINED = 2.0  # standard errors that a gain, or a fall of the check's error, must stand off zero to be told at all
STUCK = 0.25  # of the score: a refit that brings less than that is begun again elsewhere
FAR = 2.0  # times the best score: a fall that is larger tells that the scores were asked far from the solution
INSEPARABLE = 6.0  # fits whose chi-squares differ by less are rivals that the data cannot tell apart
Progress = Callable[[str], None]


class Search:
    """Adds effects to a declared model until nothing helps.

    Args:
        bench: fits and scores.
        check: the records that decide; not used for fitting.
        tests: records whose errors are noted in passing, and decide nothing.
        window: samples at the start of check and test records in which the initial state is fitted.
        options: levels and limits.
        progress: told what is going on.
    """

    def __init__(
        self,
        bench: Workbench,
        check: Record,
        tests: dict[str, Record],
        window: int | None,
        options: LoopOptions,
        progress: Progress,
    ):
        self.bench, self.check, self.tests = bench, check, tests
        self.window = window
        self.options, self.progress = options, progress
        self.samples = int(np.sum(np.asarray(bench.records.mask)))

    def run(self, fitted: Fitted) -> tuple[Fitted, tuple[Round, ...]]:
        """All rounds, from the declared model's fit."""
        rounds = []
        for number in range(1, self.options.max_rounds + 2):
            self.progress(f"round {number}: scores")
            scores = self.bench.score(fitted)
            candidates = self.candidates(fitted, scores)
            errors, predictable = self.errors(fitted), self.predictable(fitted)
            added, better, rivals, tried = None, None, (), candidates
            if number <= self.options.max_rounds:
                added, better, rivals, tried = self.best(fitted, candidates, scores, number)
            dropped: tuple[str, ...] = ()
            begin = fitted.effects
            if better is not None:
                fitted, dropped = self.prune(self.bench.finish(better))  # the next scores are asked at it
                dropped = (*(name for name in begin if name not in better.effects), *dropped)
            elif number <= self.options.max_rounds:
                fitted, added, dropped = self.exchange(fitted, candidates, number)
            rounds.append(Round(begin, tried, added, rivals, dropped, errors, predictable, self.threshold(candidates)))
            if fitted.effects == begin:
                break
        return fitted, tuple(rounds)

    def candidates(self, fitted: Fitted, scores: Scores) -> tuple[Candidate, ...]:
        """All effects that are not in, best score first: none of their family is in, nor what refines them, and what they refine
        themselves, if anything, is."""
        arrays = [np.asarray(one) for one in (scores.score, scores.significance, scores.expected, scores.left)]
        found, inside = [], [self.bench.effects[name] for name in fitted.effects]
        families_in, refined = {one.family for one in inside}, {one.refines for one in inside}
        for name, effect in self.bench.effects.items():
            absent = effect.family not in families_in | refined
            if absent and (not effect.refines or effect.refines in families_in):
                score, significance, expected, left = (float(array[self.bench.columns.gains[name]]) for array in arrays)
                words = (name, effect.family, effect.place, effect.sentence)
                found.append(Candidate(*words, score, significance, expected, left))
        return tuple(sorted(found, key=lambda one: -one.score))

    def best(self, fitted: Fitted, candidates: tuple[Candidate, ...], scores: Scores, number: int):
        """Refit the best-scored candidates; the one to keep, its fit, its rivals, and the candidates with their verdicts."""
        threshold = self.threshold(candidates)
        before = self.check_prediction(fitted)
        refits: dict[str, Fitted] = {}
        told: list[Candidate] = []
        bench, best_fall, limit = self.bench, 0.0, self.options.refits
        gains = bench.columns.gains
        listed = shortlist(candidates, scores, bench.effects, gains, bench.measured, threshold, limit)
        asked = [one for one in candidates if not listed.verdict_without_refit(one, bench.effects[one.name], 0.0)]
        bench.prepare(fitted, [_with(fitted, one.parts, self.refined(fitted, one)) for one in asked])
        for candidate in candidates:
            verdict = listed.verdict_without_refit(candidate, bench.effects[candidate.name], best_fall)
            if verdict is not None:
                told.append(dataclasses.replace(candidate, verdict=verdict))
                continue
            self.progress(f"round {number}: refit with {candidate.name}")
            refits[candidate.name] = self.refit(fitted, candidate)
            told.append(self.judge(fitted, refits[candidate.name], candidate, before, threshold))
            if told[-1].verdict == "kept":
                best_fall = max(best_fall, _cost_fall(told[-1]))
        kept = {one.name: one for one in told if one.verdict == "kept"}
        if not kept:
            pairs = self.refit_pairs(fitted, candidates, scores, before, refits, number)
            told = sorted([*told, *pairs], key=lambda one: -one.score)
            kept = {one.name: one for one in pairs if one.verdict == "kept"}
        if not kept:
            return None, None, (), tuple(told)
        winner, rivals = self.choose(kept, refits)
        second = self.second_look(fitted, kept[winner], candidates, tuple(listed.twins), before, refits, number)
        if second:
            told = [second.get(one.name, one) for one in told]
            kept |= {name: one for name, one in second.items() if one.verdict == "kept"}
            winner, rivals = self.choose(kept, refits)
        rivals += tuple(name for name, same in listed.twins.items() if same == winner)
        verdicts = {
            name: "added"
            if name == winner
            else "a rival that the data cannot tell from it"
            if name in rivals
            else "helps less"
            for name in kept
        }
        told = [dataclasses.replace(one, verdict=verdicts.get(one.name, one.verdict)) for one in told]
        return winner, refits[winner], rivals, tuple(told)

    def second_look(
        self, fitted: Fitted, winner: Candidate, candidates, twins, before, refits: dict[str, Fitted], number: int
    ) -> dict[str, Candidate]:
        """Refit what, asked at the winner's solution, would do better in its place.

        A score is asked where the declared model was fitted. Where what is missing is large, that is far from the truth, and the
        right effect can score behind others, or its refit end in another valley; the winner's solution is nearer.
        """
        if winner.pair or _cost_fall(winner) < FAR * candidates[0].score:
            return {}
        at, effects = refits[winner.name], self.bench.effects
        waiting = [one for one in candidates if one.name not in (winner.name, *twins) and not effects[one.name].refines]
        gains = [self.bench.columns.gains[one.name] for one in waiting]
        falls = np.asarray(self.bench.exchange_falls(at, [winner.parts]))[0, gains]
        told = {}
        for index in np.argsort(-falls)[: self.options.pairs]:
            if falls[index] <= 0.0:
                break
            other = waiting[index]
            self.progress(f"round {number}: refit with {other.name}, in the place of {winner.name}")
            again = self.replaced(at, other.parts, winner.parts)
            if other.name not in refits or again.cost < refits[other.name].cost:
                refits[other.name] = again
                told[other.name] = self.judge(fitted, again, other, before, self.threshold(candidates))
        return told

    def refit_pairs(self, fitted, candidates, scores, before, refits: dict[str, Fitted], number) -> list[Candidate]:
        """Refit the pairs that score best together, for effects that hide each other: weak alone, strong together.

        The joint score of two columns follows from their own and their overlap `rho`, with `b` the signed root of a score,

            score = (b_1^2 + b_2^2 - 2 rho b_1 b_2) / (1 - rho^2)    chi-square with two degrees of freedom
        """
        pairs = pairs_of(candidates, scores, self.bench.columns.gains)
        count = len(candidates) * (len(candidates) - 1) // 2
        level = self.options.level / max(count, 1)
        threshold = -2.0 * float(np.log(level))  # exceeded by chance with two degrees of freedom
        told = []
        for pair in pairs[: self.options.pairs]:
            if min(pair.score, pair.significance) <= threshold:
                continue
            self.progress(f"round {number}: refit with {pair.name}")
            refits[pair.name] = self.refit(fitted, pair)
            told.append(self.judge(fitted, refits[pair.name], pair, before, threshold))
        return told

    def choose(self, kept: dict[str, Candidate], refits: dict[str, Fitted]) -> tuple[str, tuple[str, ...]]:
        """The winner and its rivals.

        Training and check records are one body of evidence: twice the log-likelihood of both, less a price for each parameter.
        Of those that come near the best, the colour of the residual accounted for, the simplest wins, and of equally simple
        ones the best. (A check record by itself is short: where a model drifts, its error is a matter of luck.) What the records
        show by themselves goes before what only a model can tell: a stop of a sensor hides what there is to explain beyond it.
        """
        effects, measured = self.bench.effects, self.bench.measured
        kept = {
            name: one for name, one in kept.items() if any(effects[part].shown(measured) for part in one.parts)
        } or kept
        evidence = {name: _cost_fall(one) - 2.0 * self.check_cost(refits[name]) for name, one in kept.items()}
        worth = {name: fall - np.log(self.samples) * len(refits[name].columns) for name, fall in evidence.items()}
        top = max(worth, key=worth.__getitem__)
        near = [name for name in kept if worth[top] - worth[name] <= INSEPARABLE * kept[top].colour]
        complexity = {name: sum(effects[part].complexity for part in kept[name].parts) for name in near}
        winner = min(near, key=lambda name: (complexity[name], -worth[name]))
        rivals = [
            name
            for name, one in kept.items()
            if one.family != kept[winner].family and evidence[winner] - evidence[name] < INSEPARABLE
        ]
        return winner, tuple(rivals)

    def refit(self, fitted: Fitted, candidate: Candidate) -> Fitted:
        """All parameters together with one effect more, or a pair; or with one in the place of what it refines."""
        refined = self.refined(fitted, candidate)
        if refined:
            return self.replaced(fitted, candidate.parts, refined)
        effects, values = _with(fitted, candidate.parts), np.array(fitted.values)
        for name in candidate.parts:
            values[self.bench.columns.gains[name]] = self.bench.effects[name].begin
        found = self.bench.fit(effects, values, fitted.fit.parameters.rows)
        if candidate.pair or 2.0 * (fitted.cost - found.cost) > STUCK * candidate.score:
            return found
        # Far from what the score promised: a kink on the way, or a step too long. Once more, from where it said.
        values[self.bench.columns.gains[candidate.name]] = candidate.expected
        again = self.bench.fit(effects, values, fitted.fit.parameters.rows)
        return again if again.cost < found.cost else found

    def refined(self, fitted: Fitted, candidate: Candidate) -> tuple[str, ...]:
        """Names of the effects that are in and that a candidate says more closely."""
        families = {self.bench.effects[name].refines for name in candidate.parts} - {""}
        return tuple(name for name in fitted.effects if self.bench.effects[name].family in families)

    def judge(
        self, fitted: Fitted, refit: Fitted, candidate: Candidate, before: Prediction, threshold: float
    ) -> Candidate:
        """Whether a refitted candidate may be kept, and why not if not."""
        fall = 2.0 * (fitted.cost - refit.cost)
        after = self.check_prediction(refit)
        check_fall = mean_log(before) - mean_log(after)
        # Of a residual that is still predictable no significance is known; there only a material gain counts, which stands out
        # of the check's scatter: by more where the training records, as far as their colour is known, do not bear it out.
        noise = self.looks_like_noise(self.predictable(refit))
        borne_out = fall / candidate.colour > threshold
        significant = noise and borne_out
        stands_out = check_fall > (1.0 if borne_out else DETERMINED) * difference_error(before, after)
        material = fall > threshold and check_fall > self.options.material and stands_out
        if not np.isfinite(check_fall) or check_fall < -self.options.harm:
            verdict = "predicts the check records worse"
        elif not self.determined(refit, candidate):
            verdict = "its size is not determined"
        elif self.bench.is_void(refit, candidate.parts):
            verdict = "its shape runs out of the records"
        elif not (significant or material):
            verdict = "not significant"
        else:
            verdict = "kept"
        return dataclasses.replace(candidate, cost_fall=fall, check_fall=float(check_fall), verdict=verdict)

    def determined(self, refit: Fitted, candidate: Candidate) -> bool:
        """Whether each gain stands two standard errors off zero, the colour of what is left accounted for.

        Where an effect has a shape beside its gain, the two can be told together only (a faint lag is gain times time), and
        the gain by itself says nothing.
        """
        errors = self.bench.standard_errors(refit)
        alone = (name for name in candidate.parts if has_no_shape(self.bench.effects[name]))
        return all(abs(value) > DETERMINED * error for value, error in (errors[f"{name}.gain"] for name in alone))

    def prune(self, fitted: Fitted, keep: int = 1) -> tuple[Fitted, tuple[str, ...]]:
        """Take out effects that have become superfluous, but for so many of the latest."""
        dropped: tuple[str, ...] = ()
        threshold = critical(self.options.level / len(self.bench.effects))
        errors = self.bench.standard_errors(fitted)
        for name in fitted.effects[: len(fitted.effects) - keep]:
            value, error = errors[f"{name}.gain"]
            if (value / error) ** 2 > threshold if error > 0 else False:
                continue
            self.progress(f"trying without {name}")
            values = np.array(fitted.values)
            values[self.bench.columns.gains[name]] = 0.0
            without = self.bench.fit(_with(fitted, (), (name,)), values, fitted.fit.parameters.rows)
            harmless = self.check_error(without) - self.check_error(fitted) < self.options.harm
            if 2.0 * (without.cost - fitted.cost) < threshold and harmless:
                fitted, dropped = without, (*dropped, name)
        return fitted, dropped

    def exchange(
        self, fitted: Fitted, candidates: tuple[Candidate, ...], number: int
    ) -> tuple[Fitted, str | None, tuple[str, ...]]:
        """Put one effect in the place of one or two that are in, where it says as much or more; at best, once.

        Effects that came in one by one can stand for one that could not be told yet: two late sensors for a late input.
        (Miller, Subset Selection in Regression, 2002, section 3.5.)

        Returns:
            The fit, what came in and what went out; the old fit, None and nothing where no exchange is for the better.
        """
        before, found = self.check_error(fitted), (0.0, fitted, None, ())
        for _, name, out in self.exchanges(fitted, candidates):
            self.progress(f"round {number}: {name} in the place of {' and '.join(out)}")
            refit = self.replaced(fitted, (name,), out)
            gain = 2.0 * (fitted.cost - refit.cost)
            gain += np.log(self.samples) * (len(fitted.columns) - len(refit.columns)) - INSEPARABLE * (len(out) == 1)
            after = self.check_prediction(refit)
            harmless = mean_log(after) - before < uncertainty(after)
            if gain > found[0] and harmless:
                found = (gain, refit, name, out)
        return found[1:]

    def exchanges(self, fitted: Fitted, candidates: tuple[Candidate, ...]) -> list[tuple[float, str, tuple[str, ...]]]:
        """What could come in for what, with the fall of chi-square that the linear model expects, the best first."""
        absent = [one.name for one in candidates]
        if len(fitted.effects) < 2 or not absent:
            return []
        sets = [out for count in (1, 2) for out in itertools.combinations(fitted.effects, count)]
        gains = [self.bench.columns.gains[name] for name in absent]
        falls = np.asarray(self.bench.exchange_falls(fitted, sets))[:, gains]
        falls += np.log(self.samples) * (np.array([[len(out)] for out in sets]) - 1)  # what goes out is paid back
        best = np.argsort(-falls, axis=None)[: self.options.pairs]
        return [(falls.flat[i], absent[i % len(absent)], sets[i // len(absent)]) for i in best]

    def replaced(self, fitted: Fitted, come: tuple[str, ...], out: tuple[str, ...]) -> Fitted:
        """All parameters together with some effects in the place of others, whose values they take where they refine them."""
        values = np.array(fitted.values)
        values[[self.bench.columns.gains[name] for name in out]] = 0.0
        for name in come:
            effect = self.bench.effects[name]
            values[self.bench.columns.gains[name]] = effect.begin
            for other in out:
                if self.bench.effects[other].family == effect.refines:
                    for own, theirs in self.bench.columns.same_named(name, other):
                        values[own] = fitted.values[theirs]
        return self.bench.fit(_with(fitted, come, out), values, fitted.fit.parameters.rows)

    def contenders(self, fitted: Fitted, rounds: tuple[Round, ...], margin: float) -> tuple[Rival, ...]:
        """What fits worse by less than a margin, now that all is in, in the place of what came in in a round."""
        found = []
        for one in rounds:
            out = one.came_in
            if not out or not set(out) <= set(fitted.effects):
                continue
            for candidate in one.contenders(margin):
                if set(candidate.parts) & set(fitted.effects):
                    continue
                self.progress(f"contender {candidate.name}")
                refit = self.replaced(fitted, candidate.parts, out)
                worse = 2.0 * (refit.cost - fitted.cost)
                if worse < margin:
                    model, free = self.bench.model_and_free(refit)
                    found.append(Rival(candidate.name, candidate.sentence, out, worse, model, free))
        return tuple(found)

    def check_prediction(self, fitted: Fitted) -> Prediction:
        """The check records as a fit predicts them."""
        return self.bench.predict(fitted, self.check, self.window)

    def check_cost(self, fitted: Fitted) -> float:
        """Negative log-likelihood of the check records."""
        predicted = self.check_prediction(fitted)
        return float(self.bench.likelihood.noise.cost(predicted.residuals, predicted.scored))

    def check_error(self, fitted: Fitted) -> float:
        """Mean over the channels of the logarithm of the error on the check records."""
        return mean_log(self.check_prediction(fitted))

    def threshold(self, candidates: tuple[Candidate, ...]) -> float:
        """The chi-square that counts as significant, with as many candidates tried (Bonferroni)."""
        return critical(self.options.level / max(len(candidates), 1))

    def errors(self, fitted: Fitted) -> dict[str, dict[str, float]]:
        """Root mean square error by part and channel."""
        names = self.bench.records.outputs
        parts = {
            "train": root_mean_square(fitted.fit.residuals, self.bench.records.mask),
            "check": self.bench.predict(fitted, self.check, self.window).rms,
        }
        for name, test in self.tests.items():
            parts[f"test {name}"] = self.bench.predict(fitted, test, self.window).rms
        return {part: dict(zip(names, map(float, rms), strict=True)) for part, rms in parts.items()}

    def looks_like_noise(self, predictable: dict[str, float]) -> bool:
        """Whether no channel's past predicts more of it than is allowed, the scatter of short records included."""
        return max(predictable.values()) <= self.predictable_by_chance()

    def predictable_by_chance(self) -> float:
        """The share of a channel's residual that its past may predict, and it still counts as noise."""
        fewest = int(np.min(np.sum(np.asarray(self.bench.records.mask), axis=(0, 1))))
        return self.options.predictable + allowance(fewest)

    def predictable(self, fitted: Fitted) -> dict[str, float]:
        """Share of the training residual that its own past predicts, per channel."""
        share = predictable_share(fitted.fit.residuals, self.bench.records.mask)
        return dict(zip(self.bench.records.outputs, map(float, share), strict=True))


def _with(fitted: Fitted, come: tuple[str, ...], out: tuple[str, ...] = ()) -> tuple[str, ...]:
    """What is in a fit, with some effects in the place of others."""
    return (*(name for name in fitted.effects if name not in out), *come)


def _cost_fall(candidate: Candidate) -> float:
    """The fall of the training cost of a candidate that was refitted."""
    assert candidate.cost_fall is not None
    return candidate.cost_fall
