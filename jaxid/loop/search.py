"""`search`: beam search over hypotheses, from the declared model."""

import dataclasses
import time
from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from .._foundation.grid import typical_step
from ..effects.library import initialise_shapes
from ..effects.shape_initialisation import RESIDUAL, SIMULATED
from ..estimation.estimate import divergence
from ..estimation.likelihoods import OutputError
from .compilation import compile_programs, compiled_ahead
from .dependence import followed_signals
from .evidence import (
    INSEPARABLE,
    SETTLED,
    Decision,
    best_of_families,
    compare,
    inflation,
    is_noise_like,
    worth,
)
from .fit import LoopFit, check_finite, fit, within_reach
from .hypothesis import Hypothesis, White
from .moves import Move, MoveKind, Proposals, localise_fit
from .noise import noise_moves, without_slow
from .options import LoopOptions
from .problem import LoopProblem
from .search_tree import SearchTree, Step

# Chosen: share of the expected fall; a refit that brings less starts again from the estimated gain.
STALLED = 0.25
# Chosen: share of the expected fall of an accepted move; an addition without a shape that should
# bring less waits for the next round.
HOPELESS_SHARE = 0.3
# Chosen: rise of the cost above its parent's, and above the lowest of the moves that compete with
# it, beyond which a refit is not continued; no change of hypothesis is made at such a rise.
NEAR_LOWEST = 25.0
Progress = Callable[[str], None]
Branch = tuple[LoopFit, list[Step]]  # a fit, and the steps from the declared model to it
# The fit from whose values a refit starts, None for the declared ones, and other values by name.
Start = tuple[LoopFit | None, Mapping[str, float]]


def search(problem: LoopProblem, options: LoopOptions, progress: Progress) -> SearchTree:
    """Return the search tree of a problem.

    From each hypothesis of the beam the moves are refitted in stages: removals; additions, groups
    and profitable swaps; pairs, also of the best refused addition; swaps where there are two
    effects; noise models; the next best random forces. The first stage with an accepted move ends
    the expansion, and the best `beam_width` results of all expansions are the next beam. When no
    move is accepted, exchanges that may be nearly as good as the best hypothesis are refitted.
    Ctrl-C ends the search with the best hypothesis so far.
    """
    progress("compilation of the model with its candidates")
    compile_programs(problem)
    progress("estimate of the declared model")
    declared = fit(problem, Hypothesis())
    if not np.isfinite(declared.cost):
        raise divergence(problem.model, problem.free, problem.train, problem.likelihood)
    declared = with_shapes(declared)
    check_finite(declared)
    tree = SearchTree(declared, declared)
    try:
        _grow(tree, options, progress)
        _refit_alternatives(tree, options, progress)
    except KeyboardInterrupt:
        tree.interrupted = True
        _keep_accepted(tree)
    return tree


def _keep_accepted(tree: SearchTree) -> None:
    """Take the best accepted refit from the best hypothesis, whose stage was not finished."""
    accepted = [s for s in tree.steps if s.parent is tree.best and s.comparison.accepted]
    if accepted:
        first = _ordered(accepted)[0]
        tree.best, tree.path = first.fit, [*tree.path, first]


def with_shapes(declared: LoopFit) -> LoopFit:
    """Return the declared fit with the initial shapes of the candidates set from it."""
    problem, train = declared.problem, declared.problem.train
    signals = dict(declared.motion.signals)
    mask, z = np.asarray(train.mask), np.asarray(train.z)
    left = np.where(mask, np.asarray(declared.solution.residuals), 0.0)
    for i, name in enumerate(train.outputs):
        signals[RESIDUAL + name] = left[..., i]
        signals[SIMULATED + name] = np.where(mask[..., i], z[..., i] - left[..., i], 0.0)
    samples = {name: signal[problem.recorded] for name, signal in signals.items()}
    step = float(typical_step(train.t))
    library = initialise_shapes(problem.library, samples, problem.measured, step)
    return dataclasses.replace(declared, problem=dataclasses.replace(problem, library=library))


def _grow(tree: SearchTree, options: LoopOptions, progress: Progress) -> None:
    """Expand the beam until no move is accepted."""
    beam: list[Branch] = [(tree.declared, [])]
    expanded: set = set()
    depth = 2 * options.max_rounds  # removals count as well
    for _ in range(depth):
        children = _children(tree, beam, expanded, options, progress)
        if not children:
            return
        if len(beam) > 1:
            children.sort(key=lambda child: (not _is_evident(child[1][-1]), child[0].price))
        beam = children[: options.beam_width]
        best, path = beam[0]
        ancestors = [tree.declared, *(step.fit for step in path)]
        if tree.best in ancestors or best.price < tree.best.price:
            tree.best, tree.path = best, path


def _children(tree, beam: list[Branch], expanded: set, options, progress) -> list[Branch]:
    """Return the accepted results of the moves from a beam, each hypothesis once with its lowest
    cost, without those expanded before.
    """
    lowest: dict[tuple, Branch] = {}
    for parent, path in beam:
        expanded.add(parent.hypothesis.key)
        for step in _expand(tree, parent, path, options, progress):
            key, known = step.fit.hypothesis.key, lowest.get(step.fit.hypothesis.key)
            if key not in expanded and (known is None or step.fit.cost < known[0].cost):
                lowest[key] = step.fit, [*path, step]
    return [*lowest.values()]


def _is_evident(step: Step) -> bool:
    """Return True if the records show an added effect without a model."""
    return any(map(step.fit.problem.is_evident, step.move.into))


def _expand(tree, parent: LoopFit, path, options: LoopOptions, progress) -> list[Step]:
    """Return the accepted steps of the first stage that has any, the best first.

    Random forces, and other noises with a likelihood of their own, are not expanded: effects
    together with them are never the cause.
    """
    if not isinstance(parent.estimation.problem.likelihood, OutputError):
        return []
    rounds = sum(step.move.kind is not MoveKind.DROP for step in path)

    def report(text: str) -> None:
        progress(f"round {rounds + 1}: {text}")

    for moves, count in _stages(tree, Proposals(parent, options), rounds, progress):
        steps = _refits(tree, parent, _new(tree, parent, moves), count, options, report)
        best = best_of_families([step.fit for step in steps])
        accepted = [step for step in steps if step.comparison.accepted and step.fit in best]
        if accepted:
            return _ordered(accepted)
    return []


def _new(tree: SearchTree, parent: LoopFit, moves: Iterable[Move]) -> list[Move]:
    """Return the moves that no earlier stage from a fit has refitted, each hypothesis once: of two
    moves to one hypothesis the last, which starts closer to it.
    """
    known = {step.move.hypothesis.key for step in tree.steps if step.parent is parent}
    by_key = {move.hypothesis.key: move for move in moves}
    return [move for key, move in by_key.items() if key not in known]


def _stages(
    tree: SearchTree, proposals: Proposals, rounds: int, progress: Progress
) -> Iterator[tuple[list[Move], int]]:
    """Yield the moves of each stage, with the number of candidates among which they are selected.

    After the last round only removals remain.
    """
    options, count = proposals.options, len(proposals.candidates)
    yield proposals.drops()[:1], count
    if rounds >= options.max_rounds:
        return
    swaps = proposals.swaps(0.0)[: options.swap_limit]
    yield [*proposals.additions(), *proposals.groups(), *swaps], count
    second = second_steps(tree, proposals.fit, options)
    yield [*proposals.pairs(), *second], count * (count - 1) // 2
    if len(proposals.fit.effects) > 1:
        yield proposals.swaps(np.inf)[: options.swap_limit], count
    for moves in _noises(tree, proposals.fit, options, progress):
        yield moves, 1


def second_steps(tree: SearchTree, parent: LoopFit, options: LoopOptions) -> list[Move]:
    """Return pairs of the best refused addition, if it has evidence, with a further effect.

    While several effects are missing, the residual after each one is so coloured by the others that
    none of them may be significant alone.
    """
    refused = [s for s in tree.steps if s.parent is parent and s.move.kind is MoveKind.ADD]
    first = max(refused, key=lambda step: worth(step.fit), default=None)
    if first is None or not worth(first.fit) > worth(parent):
        return []
    known = {name: value for name, (value, _) in first.fit.estimates.items()}
    additions = sorted(Proposals(first.fit, options).additions(), key=lambda move: -move.expected)
    return [
        dataclasses.replace(
            move,
            kind=MoveKind.PAIR,
            into=tuple(n for n in move.hypothesis.effects if n not in parent.effects),
            expected=first.comparison.fall + move.expected,
            start=known | dict(move.start),
        )
        for move in additions[: options.swap_limit]
    ]


def _noises(tree: SearchTree, parent: LoopFit, options, progress) -> Iterator[list[Move]]:
    """Yield noise models in stages; random forces only if the residual is not white."""
    if not isinstance(parent.hypothesis.noise, White):
        return
    where = None
    if not is_noise_like(parent, options) and tree.problem.equations:
        progress("location of the residual")
        where = tree.where if parent is tree.declared else localise_fit(parent, tree.where.splines)
    for moves, followed in noise_moves(parent, tree.declared, where, options):
        tree.note_followed(followed)
        yield moves


def _refits(tree: SearchTree, parent, moves, count: int, options, progress) -> list[Step]:
    """Return the refits of moves, without those that cannot compete with an accepted one."""
    steps: list[Step] = []
    best, lowest, begin = 0.0, parent.cost, time.monotonic()
    ordered = sorted(moves, key=lambda move: -move.expected)
    with compiled_ahead(tree.problem, [move.hypothesis for move in ordered]) as wait_for:
        for number, move in enumerate(ordered):
            addition = move.kind in (MoveKind.ADD, MoveKind.GROUP)
            simple = addition and not _has_shape(tree.problem, move)
            if simple and move.expected < HOPELESS_SHARE * best:
                continue
            place = _place(number, len(ordered), time.monotonic() - begin)
            progress(f"refit with {move.hypothesis} ({place})")
            wait_for(move.hypothesis)
            step = _step(tree, parent, move, count, options, lowest + NEAR_LOWEST)
            steps.append(step)
            tree.steps.append(step)
            if step.comparison.accepted:
                best = max(best, move.expected)
                lowest = min(lowest, step.fit.cost)
    return steps


def _place(number: int, count: int, seconds: float) -> str:
    """Return the place of a refit among the refits of its stage, and how long the rest may take.

    Args:
        number: number of the refits before it, with those left out.
        count: number of all refits.
        seconds: time of those before it [s].
    """
    place = f"{number + 1}/{count}"
    return f"{place}, about {seconds / number * (count - number):.0f} s left" if number else place


def _has_shape(problem: LoopProblem, move: Move) -> bool:
    """Return True if a move adds an effect with parameters besides its gain."""
    return any(map(problem.has_shape, move.into))


def _step(
    tree: SearchTree, parent: LoopFit, move: Move, count: int, options, target: float
) -> Step:
    """Return the step of a move, refused if its noise depends on a signal. Random forces that are
    refused as a drift are refitted without the slow ones.
    """
    new = refit(parent, move, target)
    step = Step(parent, move, new, compare(parent, new, options, count))
    faster = without_slow(parent, new) if step.comparison.decision is Decision.DRIFT else None
    if faster is not None:
        tree.steps.append(step)
        return _step(tree, parent, faster, count, options, target)
    is_noise = move.kind is MoveKind.NOISE and step.comparison.accepted
    followed = followed_signals(new, options.level) if is_noise else ()
    if followed:
        tree.note_followed(followed)
        refused = dataclasses.replace(step.comparison, decision=Decision.FOLLOWS)
        step = dataclasses.replace(step, comparison=refused)
    return step


def refit(parent: LoopFit, move: Move, target: float = np.inf) -> LoopFit:
    """Return the fit of a move: from the parent's values, and if it stalls from others.

    A refit that cannot reach its target, a cost, with as much fall in each further run is neither
    continued nor repeated.
    """
    first = fit(parent.problem, move.hypothesis, parent, move.start, target)
    starts = _other_starts(parent, move, first, target)
    fits = [first, *(fit(parent.problem, move.hypothesis, *start, target) for start in starts)]
    return min(fits, key=lambda fitted: fitted.cost)


def _other_starts(parent: LoopFit, move: Move, first: LoopFit, target: float) -> list[Start]:
    """Return from where a refit is repeated after its first fit.

    One that brings much less than the linear model predicts is repeated from the gain that this
    model predicts, unless it has no shape, as its first step then went there; and from the declared
    values if it did not converge.
    """
    if move.kind is MoveKind.DROP:
        return []
    if move.kind is MoveKind.NOISE:  # forces start at their most probable values
        return [] if move.start and first.converged else [(None, move.start)]
    predicted: Start = parent, {**move.start, **move.estimated}
    everywhere: list[Start] = [predicted, (None, move.start)]
    if not np.isfinite(first.cost):
        return everywhere
    fall, expected = parent.cost - first.cost, move.expected / 2.0  # of the cost
    in_reach = within_reach(first.cost, max(fall, expected - fall), target)
    if fall >= STALLED * expected or not in_reach:
        return []
    if not first.converged:
        return everywhere
    return [predicted] if _has_shape(parent.problem, move) else []


def _ordered(steps: list[Step]) -> list[Step]:
    """Return accepted steps of one parent, the best first.

    An effect that the records show without a model goes before all others.
    """
    evident, rest = ([s for s in steps if _is_evident(s) is one] for one in (True, False))
    return [*_by_evidence(evident), *_by_evidence(rest)]


def _by_evidence(steps: list[Step]) -> list[Step]:
    """Return steps by their evidence; among those near the best, colour accounted for, the simplest
    goes first.
    """
    if not steps:
        return []
    worths = {step: worth(step.fit) for step in steps}
    top = max(steps, key=lambda step: worths[step])
    margin = worths[top] - INSEPARABLE * inflation(top.fit, top.move.into)

    def order(step: Step):
        near, cards = worths[step] >= margin, step.fit.problem.cards
        complexity = sum(cards[name].complexity for name in step.fit.effects)
        return not near, complexity if near else 0, -worths[step]

    return sorted(steps, key=order)


def _refit_alternatives(tree: SearchTree, options: LoopOptions, progress: Progress) -> None:
    """Refit the exchanges of single effects that may be nearly as good as the best hypothesis.

    If one of them turns out to be clearly better, it becomes the best.
    """
    best = tree.best
    if not best.effects:
        return
    proposals = Proposals(best, options)
    known = {fitted.hypothesis.key for fitted in tree.fits()}
    margin = SETTLED * inflation(best, best.effects)
    moves = [
        move for move in proposals.swaps(margin, pairs=False) if move.hypothesis.key not in known
    ]
    count = len(proposals.candidates)
    steps = _refits(tree, best, moves[: options.refits], count, options, progress)
    better = [step for step in steps if step.comparison.accepted and worth(step.fit) > worth(best)]
    if better:
        step = max(better, key=lambda step: worth(step.fit))
        tree.best, tree.path = step.fit, [*tree.path, step]
