"""The search for effects: score, refit the best, keep what predicts, drop what has become
insignificant, and again.
"""

import dataclasses
import itertools
from collections.abc import Callable, Mapping

import numpy as np

from ..diagnosis.scores import Scores, critical
from ..loop.heldout_error import mean_log, uncertainty
from ..loop.thresholds import INSEPARABLE
from .fit import Fitted
from .judge import Judge
from .not_finite import refusal
from .pairs import pairs_of
from .rounds import Alternative, Candidate, Decision, Round
from .shortlist import shortlist
from .tried import Tried
from .way import Way

STUCK = 0.25  # of the score: a refit that brings less than that is begun again elsewhere
# times the best score: a larger fall means that the score was far from the solution
FAR_FROM_SOLUTION = 2.0
SECOND = 0.3  # of the winner's fall in the first round: what brings more is worth a second way
Progress = Callable[[str], None]


class Search:
    """Adds effects to a declared model until nothing helps.

    Args:
        judge: says what may be kept; with its workbench and its options.
        progress: told what is going on.
    """

    def __init__(self, judge: Judge, progress: Progress):
        self.judge, self.progress = judge, progress
        self.bench, self.options = judge.bench, judge.options

    def run(self, declared: Fitted) -> tuple[Way, Way | None]:
        """All rounds from the declared model's fit, and the other way where two were gone.

        A search that takes the best effect of each round can be led astray by the first. Where it
        ends with something left, and another effect did not much worse in the first round, the
        search is begun again with that one, and goes on as long as it keeps up: what needs more
        effects to come as far is no better an explanation.
        """
        tried = self.tried(declared, 1)
        first = self.way(tried)
        passed = first.rounds[0].winner
        if (
            passed is None
            or self.options.beam_width < 2
            or self.leaves_noise(first)
            or not self.second_begins(tried, passed)
        ):
            return first, None
        self.progress(f"another way, not beginning with {passed.name}")
        second = self.way(tried, passed.family, first)
        return (second, first) if self.leads_further(second, first) else (first, second)

    def second_begins(self, tried: Tried, winner: Candidate) -> bool:
        """Whether what was not chosen in the first round does not much worse than what was."""
        others = (one for one in tried.candidates if one.acceptable and one.family != winner.family)
        return any(_cost_fall(one) > SECOND * _cost_fall(winner) for one in others)

    def leads_further(self, second: Way, first: Way) -> bool:
        """Whether a second way leaves noise, or predicts the check records better and has more
        credit of all records.
        """
        if set(second.fitted.effects) != set(second.rounds[-1].effects):  # given up
            return False
        if self.leaves_noise(second):
            return True
        judge = self.judge
        predicts = judge.check_error(second.fitted) < judge.check_error(first.fitted)
        return predicts and judge.worth(second.fitted) > judge.worth(first.fitted)

    def is_given_up(self, way: Way, other: Way) -> bool:
        """Whether a way has met one that was gone before, or has fallen behind it and does not
        leave noise.
        """
        return other.holds(way.fitted.effects) or (
            other.is_ahead_of(way.worth) and not self.leaves_noise(way)
        )

    def leaves_noise(self, way: Way) -> bool:
        """Whether what stays at the end of a way looks like noise."""
        return self.judge.looks_like_noise(self.judge.predictable(way.fitted))

    def way(self, tried: Tried, passed_over: str = "", other: Way | None = None) -> Way:
        """All rounds, from the refits of the first.

        Args:
            tried: the refits of the first round.
            passed_over: a family that is not to come in in the first.
            other: a way that was gone before. This one ends where it meets that, or falls behind
                it.
        """
        fitted, rounds, worth = tried.fitted, (), ()
        while True:
            number, begin = tried.number, tried.fitted.effects
            winner, tried, rivals = self.take(tried, passed_over if number == 1 else "")
            added, dropped = winner and winner.name, ()
            if winner is not None:
                finished = self.bench.finish(tried.refits[winner.name])
                better = self.begun_again(finished)  # the next scores are asked at it
                fitted, dropped = self.prune(better)
                dropped = (*(name for name in begin if name not in better.effects), *dropped)
            elif number <= self.options.max_rounds:
                fitted, added, dropped, told = self.exchange(fitted, tried.singles, number)
                tried = tried._replace(
                    candidates=tuple(told.get(one.name, one) for one in tried.candidates)
                )
            errors, predictable = (
                self.judge.errors(tried.fitted),
                self.judge.predictable(tried.fitted),
            )
            threshold = self.judge.threshold(tried.singles)
            rounds += (
                Round(
                    begin, tried.candidates, added, rivals, dropped, errors, predictable, threshold
                ),
            )
            worth += (self.judge.worth(fitted),)
            way = Way(fitted, rounds, worth)
            if fitted.effects == begin or (other and self.is_given_up(way, other)):
                return way
            tried = self.tried(fitted, number + 1)

    def candidates(self, fitted: Fitted, scores: Scores) -> tuple[Candidate, ...]:
        """All effects that are not in, best score first: none of their family is in, unless several
        may be, nor what refines them, and what they refine themselves, if anything, is."""
        arrays = [
            np.asarray(one)
            for one in (
                scores.score,
                scores.significance,
                scores.estimated_gain,
                scores.identifiable_fraction,
            )
        ]
        found, inside = [], [self.bench.effects[name] for name in fitted.effects]
        families_in, refined = (
            {one.card.family for one in inside},
            {one.card.refines for one in inside},
        )
        for name, effect in self.bench.effects.items():
            card = effect.card
            taken = refined if card.repeatable else families_in | refined
            absent = name not in fitted.effects and card.family not in taken
            if absent and (not card.refines or card.refines in families_in):
                score, significance, expected, left = (
                    float(array[self.bench.columns.gains[name]]) for array in arrays
                )
                words = (name, card.family, (card.location,), card.description)
                found.append(Candidate(*words, score, significance, expected, left))
        return tuple(sorted(found, key=lambda one: -one.score))

    def tried(self, fitted: Fitted, number: int) -> Tried:
        """Score all candidates of a round and refit the best, and where none of them may be kept,
        the best pairs.
        """
        self.progress(f"round {number}: scores")
        bench, judge = self.bench, self.judge
        scores = bench.score(fitted)
        candidates, before = self.candidates(fitted, scores), judge.check_prediction(fitted)
        if (
            candidates
            and not fitted.effects
            and all(np.isnan(one.identifiable_fraction) for one in candidates)
        ):
            raise refusal(bench, fitted)
        if number > self.options.max_rounds:
            return Tried(fitted, before, candidates, {}, {}, number)
        threshold, gains = judge.threshold(candidates), bench.columns.gains
        listed = shortlist(
            candidates, scores, bench.effects, gains, bench.measured, threshold, self.options.refits
        )
        asked = [
            one
            for one in candidates
            if not listed.decision_without_refit(one, bench.effects[one.name], 0.0)
        ]
        bench.prepare(
            fitted, [_with(fitted, one.parts, self.refined(fitted, one)) for one in asked]
        )
        refits: dict[str, Fitted] = {}
        told: list[Candidate] = []
        best_fall = 0.0
        for candidate in candidates:
            decision = listed.decision_without_refit(
                candidate, bench.effects[candidate.name], best_fall
            )
            if decision is not None:
                told.append(listed.without_refit(candidate, decision))
                continue
            self.progress(f"round {number}: refit with {candidate.name}")
            refits[candidate.name] = self.refit(fitted, candidate)
            told.append(judge.told(fitted, refits[candidate.name], candidate, before, threshold))
            if told[-1].acceptable:
                best_fall = max(best_fall, _cost_fall(told[-1]))
        if not any(one.acceptable for one in told):
            told += self.refit_pairs(fitted, candidates, scores, before, refits, number)
            told.sort(key=lambda one: -one.score)
        return Tried(fitted, before, tuple(told), refits, listed.twins, number)

    def take(
        self, tried: Tried, passed_over: str = ""
    ) -> tuple[Candidate | None, Tried, tuple[str, ...]]:
        """Choose among the refits of a round.

        Args:
            tried: the refits.
            passed_over: a family that is not to be chosen.

        Returns:
            What is to come in, if anything; the refits, with their final verdicts and those of a
            second look; the rivals.
        """
        told = {
            one.name: _passed_over(one) if one.family == passed_over else one
            for one in tried.candidates
        }
        kept = {name: one for name, one in told.items() if one.acceptable}
        if not kept:
            return None, tried._replace(candidates=tuple(told.values())), ()
        refits = dict(tried.refits)
        winner, rivals = self.choose(kept, refits)
        second = self.second_look(tried, kept[winner], passed_over)
        if second:
            refits |= {name: refit for name, (refit, _) in second.items()}
            told |= {name: one for name, (_, one) in second.items()}
            kept = {name: one for name, one in told.items() if one.acceptable}
            winner, rivals = self.choose(kept, refits)
        rivals += tuple(name for name, same in tried.twins.items() if same == winner)
        decisions = dict.fromkeys(kept, Decision.WORSE) | dict.fromkeys(
            rivals, Decision.ALTERNATIVE
        )
        decisions = {name: decisions[name] for name in kept} | {winner: Decision.ADDED}
        told |= {
            name: dataclasses.replace(told[name], decision=decision)
            for name, decision in decisions.items()
        }
        return told[winner], tried._replace(candidates=tuple(told.values()), refits=refits), rivals

    def second_look(
        self, tried: Tried, winner: Candidate, passed_over: str
    ) -> dict[str, tuple[Fitted, Candidate]]:
        """Refit what, asked at the winner's solution, would do better in its place.

        A score is asked where the declared model was fitted. Where what is missing is large, that
        is far from the truth, and the right effect can score behind others, or its refit end in
        another valley; the winner's solution is nearer.
        """
        if winner.pair or _cost_fall(winner) < FAR_FROM_SOLUTION * tried.candidates[0].score:
            return {}
        at, effects = tried.refits[winner.name], self.bench.effects
        absent = (one for one in tried.singles if one.name not in (winner.name, *tried.twins))
        waiting = [
            one
            for one in absent
            if not effects[one.name].card.refines and one.family != passed_over
        ]
        gains = [self.bench.columns.gains[one.name] for one in waiting]
        falls = np.asarray(self.bench.exchange_falls(at, [winner.parts]))[0, gains]
        threshold, found = self.judge.threshold(tried.singles), {}
        for index in np.argsort(-falls)[: self.options.swap_limit]:
            if falls[index] <= 0.0:
                break
            other = waiting[index]
            self.progress(
                f"round {tried.number}: refit with {other.name}, in the place of {winner.name}"
            )
            again = self.replaced(at, other.parts, winner.parts)
            if other.name not in tried.refits or again.cost < tried.refits[other.name].cost:
                found[other.name] = (
                    again,
                    self.judge.told(tried.fitted, again, other, tried.before, threshold),
                )
        return found

    def refit_pairs(
        self, fitted, candidates, scores, before, refits: dict[str, Fitted], number
    ) -> list[Candidate]:
        """Refit the pairs that score best together, for effects that hide each other: weak alone,
        strong together.

        The joint score of two columns follows from their own and their overlap `rho`, with `b` the
        signed root of a score,

            score = (b_1^2 + b_2^2 - 2 rho b_1 b_2) / (1 - rho^2)

        chi-square with two degrees of freedom.
        """
        pairs = pairs_of(candidates, scores, self.bench.columns.gains, self.options.swap_limit)
        count = len(candidates) * (len(candidates) - 1) // 2
        level = self.options.level / max(count, 1)
        threshold = -2.0 * float(np.log(level))  # exceeded by chance with two degrees of freedom
        told = []
        for pair in pairs:
            if min(pair.score, pair.significance) <= threshold:
                continue
            self.progress(f"round {number}: refit with {pair.name}")
            refits[pair.name] = self.refit(fitted, pair)
            told.append(self.judge.told(fitted, refits[pair.name], pair, before, threshold))
        return told

    def choose(
        self, kept: Mapping[str, Candidate], refits: Mapping[str, Fitted]
    ) -> tuple[str, tuple[str, ...]]:
        """The winner and its rivals.

        Of those that come near the best in evidence, each parameter priced and the colour of the
        residual accounted for, the simplest wins, and of equally simple ones the best. What the
        records show by themselves goes before what only a model can tell: a stop of a sensor hides
        what there is to explain beyond it.
        """
        effects, measured = self.bench.effects, self.bench.measured
        evident = {name for name, effect in effects.items() if effect.evident_in_data(measured)}
        kept = {name: one for name, one in kept.items() if evident.intersection(one.parts)} or kept
        evidence = {name: self.judge.evidence(refits[name]) for name in kept}
        worth = {name: one - self.judge.price(refits[name]) for name, one in evidence.items()}
        top = max(worth, key=worth.__getitem__)
        colour = kept[top].variance_inflation if np.isfinite(kept[top].variance_inflation) else 1.0
        near = [name for name in kept if worth[top] - worth[name] <= INSEPARABLE * colour]
        complexity = {
            name: sum(effects[part].card.complexity for part in kept[name].parts) for name in near
        }
        winner = min(near, key=lambda name: (complexity[name], -worth[name]))
        rivals = [
            name
            for name, one in kept.items()
            if one.family != kept[winner].family and evidence[winner] - evidence[name] < INSEPARABLE
        ]
        return winner, tuple(rivals)

    def refit(self, fitted: Fitted, candidate: Candidate) -> Fitted:
        """All parameters together with one effect more, or a pair; or with one in the place of what
        it refines.
        """
        refined = self.refined(fitted, candidate)
        if refined:
            return self.replaced(fitted, candidate.parts, refined)
        effects, values = _with(fitted, candidate.parts), np.array(fitted.values)
        for name in candidate.parts:
            values[self.bench.columns.gains[name]] = self.bench.effects[name].card.initial_gain
        found = self.bench.fit(effects, values, fitted.fit.parameters.rows)
        if candidate.pair or 2.0 * (fitted.cost - found.cost) > STUCK * candidate.score:
            return found
        # Far from what the score promised: a kink on the way, or a step too long. Once more, from
        # where it said.
        values[self.bench.columns.gains[candidate.name]] = candidate.estimated_gain
        again = self.bench.fit(effects, values, fitted.fit.parameters.rows)
        return again if again.cost < found.cost else found

    def begun_again(self, fitted: Fitted) -> Fitted:
        """A fit, or, where it leaves more than noise, that from the declared model's own values if
        it ends below.

        The declared model by itself may be fitted far from the truth, and what it lacked then comes
        in in another valley.
        """
        if self.judge.looks_like_noise(self.judge.predictable(fitted)):
            return fitted
        self.progress(f"again from the declared values, with {' and '.join(fitted.effects)}")
        values = np.array(fitted.values)
        values[: self.bench.declared_start.size] = self.bench.declared_start
        again = self.bench.fit(fitted.effects, values)
        return again if again.cost < fitted.cost else fitted

    def refined(self, fitted: Fitted, candidate: Candidate) -> tuple[str, ...]:
        """Names of the effects that are in and that a candidate says more closely."""
        families = {self.bench.effects[name].card.refines for name in candidate.parts} - {""}
        return tuple(
            name for name in fitted.effects if self.bench.effects[name].card.family in families
        )

    def prune(self, fitted: Fitted, keep: int = 1) -> tuple[Fitted, tuple[str, ...]]:
        """Take out effects that have become superfluous, but for so many of the latest and what the
        records show.
        """
        dropped: tuple[str, ...] = ()
        threshold = critical(self.options.level / max(len(self.bench.effects), 1))
        for name in self.removable(fitted.effects[: len(fitted.effects) - keep]):
            value, error = self.bench.standard_errors(fitted)[f"{name}.gain"]
            if error > 0 and (value / error) ** 2 > threshold:
                continue
            self.progress(f"trying without {name}")
            values = np.array(fitted.values)
            values[self.bench.columns.gains[name]] = 0.0
            without = self.bench.fit(_with(fitted, (), (name,)), values, fitted.fit.parameters.rows)
            harmless = (
                self.judge.check_error(without) - self.judge.check_error(fitted)
                < self.options.max_check_loss
            )
            if 2.0 * (without.cost - fitted.cost) < threshold and harmless:
                fitted, dropped = without, (*dropped, name)
        return fitted, dropped

    def removable(self, effects: tuple[str, ...]) -> tuple[str, ...]:
        """Those of some effects that may go out: what the records show by themselves is there,
        whatever else explains as much.
        """
        return tuple(
            name
            for name in effects
            if not self.bench.effects[name].evident_in_data(self.bench.measured)
        )

    def exchange(
        self, fitted: Fitted, candidates: tuple[Candidate, ...], number: int
    ) -> tuple[Fitted, str | None, tuple[str, ...], dict[str, Candidate]]:
        """Put one effect in the place of one or two that are in, where it says as much or more; at
        best, once.

        Effects that came in one by one can stand for one that could not be told yet: two late
        sensors for a late input. (Miller, Subset Selection in Regression, 2002, section 3.5.)

        Returns:
            The fit, what came in, what went out, and what was tried in its place, by name; the old
            fit, None and nothing where no exchange is for the better.
        """
        before, found, falls = self.judge.check_error(fitted), (0.0, fitted, None, ()), {}
        by_name = {one.name: one for one in candidates}
        for _, name, out in self.exchanges(fitted, candidates):
            self.progress(f"round {number}: {name} in the place of {' and '.join(out)}")
            refit = self.replaced(fitted, (name,), out)
            gain = fall = 2.0 * (fitted.cost - refit.cost)
            gain += (
                self.judge.price(fitted) - self.judge.price(refit) - INSEPARABLE * (len(out) == 1)
            )
            after = self.judge.check_prediction(refit)
            harmless = mean_log(after) - before < uncertainty(after)
            falls.setdefault(out, {})[name] = dataclasses.replace(
                by_name[name], cost_fall=fall, decision=Decision.WORSE
            )
            if gain > found[0] and harmless:
                found = (gain, refit, name, out)
        _, fitted, added, out = found
        told = falls.get(out, {})
        if added is not None:
            told[added] = dataclasses.replace(told[added], decision=Decision.ADDED)
        return fitted, added, out, told

    def exchanges(
        self, fitted: Fitted, candidates: tuple[Candidate, ...]
    ) -> list[tuple[float, str, tuple[str, ...]]]:
        """What could come in for what, with the fall of chi-square that the linear model expects,
        the best first.
        """
        absent = [one.name for one in candidates]
        removable = self.removable(fitted.effects)
        if len(fitted.effects) < 2 or not absent or not removable:
            return []
        sets = [out for count in (1, 2) for out in itertools.combinations(removable, count)]
        gains = [self.bench.columns.gains[name] for name in absent]
        falls = np.asarray(self.bench.exchange_falls(fitted, sets))[:, gains]
        # what goes out is paid back
        falls += np.log(self.judge.samples) * (np.array([[len(out)] for out in sets]) - 1)
        best = np.argsort(-falls, axis=None)[: self.options.swap_limit]
        return [(falls.flat[i], absent[i % len(absent)], sets[i // len(absent)]) for i in best]

    def replaced(self, fitted: Fitted, come: tuple[str, ...], out: tuple[str, ...]) -> Fitted:
        """All parameters together with some effects in the place of others, whose values they take
        where they refine them.
        """
        values = np.array(fitted.values)
        values[[self.bench.columns.gains[name] for name in out]] = 0.0
        for name in come:
            effect = self.bench.effects[name]
            values[self.bench.columns.gains[name]] = effect.card.initial_gain
            for other in out:
                if self.bench.effects[other].card.family == effect.card.refines:
                    for own, theirs in self.bench.columns.same_named(name, other):
                        values[own] = fitted.values[theirs]
        return self.bench.fit(_with(fitted, come, out), values, fitted.fit.parameters.rows)

    def contenders(
        self, fitted: Fitted, rounds: tuple[Round, ...], margin: float
    ) -> tuple[Alternative, ...]:
        """What fits worse by less than a margin, now that all is in, in the place of what came in
        in a round.
        """
        found = []
        for one in rounds:
            out = one.added_effects
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
                    found.append(
                        Alternative(
                            candidate.name,
                            candidate.description,
                            out,
                            worse,
                            model,
                            free,
                            refit.information,
                        )
                    )
        return tuple(found)


def _with(fitted: Fitted, come: tuple[str, ...], out: tuple[str, ...] = ()) -> tuple[str, ...]:
    """What is in a fit, with some effects in the place of others."""
    return (*(name for name in fitted.effects if name not in out), *come)


def _cost_fall(candidate: Candidate) -> float:
    """The fall of the training cost of a candidate that was refitted."""
    assert candidate.cost_fall is not None
    return candidate.cost_fall


def _passed_over(candidate: Candidate) -> Candidate:
    """A candidate with which another way has begun."""
    kept = candidate.acceptable
    return dataclasses.replace(candidate, decision=Decision.PASSED_OVER) if kept else candidate
