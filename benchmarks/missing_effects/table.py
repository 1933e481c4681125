"""Results as text: goals, scenarios and shortfalls."""

from collections.abc import Sequence

from benchmarks.missing_effects.judge import (
    Answer,
    Goal,
    Result,
    Row,
    Share,
    answer,
    goals,
    identifiable,
    names_no_cause,
    outcome_of,
    rows,
    split,
    unseen_in,
)
from benchmarks.missing_effects.scenarios import HARDER
from jaxid.loop.outcome import Outcome

NOTES = """\
chi2: median reduction of twice the cost by the true model. id: the planted effect is significant in
that fit; first, top 3 and found count these studies only. wrong: number of added effects that were
not planted. ratio: error on test records over the error of the true model; before: the same ratio
of the declared model. place, quiet: with the effect left out of the library, its place is right,
and no cause is named. naive: a stepwise regression of the residual begins with the right signal;
terms: number of terms at its end."""


def text(results: Sequence[Result]) -> str:
    """Return all tables as one text."""
    parts = [
        goal_table(goals(results)),
        row_table(rows(results)),
        NOTES,
        controls_table(rows(results)),
        harder_table(split(results)[HARDER]),
    ]
    return "\n\n".join(part for part in (*parts, shortfalls(results)) if part)


def goal_table(figures: Sequence[Goal]) -> str:
    """Return the table of shares and their goals."""
    lines = [f"{'':<54} {'found':>7} {'95 % interval':>16} {'goal':>8}"]
    for one in figures:
        low, high = one.share.interval
        sign = "<=" if one.at_most else ">="
        mark = "" if one.met else "  SHORT"
        counts = f"({one.share.count} of {one.share.of})"
        lines.append(
            f"{one.name:<54} {one.share.value:>7.1%} {f'{low:.1%} - {high:.1%}':>16} "
            f"{sign:>3}{one.goal:>5.0%}"
            f"{mark} {counts}"
        )
    return "\n".join(lines)


def row_table(scenarios: Sequence[Row]) -> str:
    """Return one line for each scenario with planted effects or gusts."""
    head = (
        "chi2",
        "id",
        "first",
        "top 3",
        "found",
        "wrong",
        "ratio",
        "before",
        "place",
        "quiet",
        "naive",
        "terms",
        "s",
    )
    width = max([len(one.scenario) for one in scenarios] + [8])
    lines = [
        f"{'system':<13}{'scenario':<{width}}" + "".join(f"{name:>8}" for name in head) + "  "
        "outcomes"
    ]
    for one in scenarios:
        if one.kind in ("control", HARDER):
            continue
        cells = (
            f"{one.chi_square:.3g}",
            *map(_of, (one.identifiable, one.first, one.top, one.found)),
            f"{one.wrong:.1f}",
            f"{one.ratio[0]:.3f}",
            f"{one.ratio[1]:.3g}",
            *map(_of, (one.place, one.no_cause, one.naive)),
            f"{one.naive_terms:.1f}",
            f"{one.seconds:.1f}",
        )
        lines.append(
            f"{one.system:<13}{one.scenario:<{width}}"
            + "".join(f"{c:>8}" for c in cells)
            + _outcomes(one)
        )
    return "\n".join(lines)


def controls_table(scenarios: Sequence[Row]) -> str:
    """Return one line for each control."""
    controls = [one for one in scenarios if one.kind == "control"]
    if not controls:
        return ""
    lines = [
        f"{'system':<13}{'nothing missing':<34}{'studies':>8}{'wrong':>8}{'naive terms':>13}"
        f"{'s':>7}  outcomes"
    ]
    for one in controls:
        numbers = f"{one.studies:>8}{one.wrong:>8.2f}{one.naive_terms:>13.1f}{one.seconds:>7.1f}"
        lines.append(f"{one.system:<13}{one.scenario:<34}{numbers}{_outcomes(one)}")
    return "\n".join(lines)


HARDER_NOTES = """\
right: all planted effects named, and no other; part: some of them; doubt: something is missing, no
cause named, the right answer if the library lacks the truth; unseen: nothing named that the records
determine; wrong: another effect named, or the missing one denied."""


def harder_table(results: Sequence[Result]) -> str:
    """Return one line for each harder truth with its answers, and one for all."""
    if not results:
        return ""
    keys = dict.fromkeys((one["system"], one["scenario"]) for one in results)
    head = ("studies", "lacked", *(one.value for one in Answer))
    width = max([len(name) for _, name in keys] + [12])
    lines = [f"{'system':<13}{'harder truth':<{width}}" + "".join(f"{name:>8}" for name in head)]
    groups = [
        (*key, [one for one in results if (one["system"], one["scenario"]) == key]) for key in keys
    ]
    for system, name, studies in (*groups, ("all", "", results)):
        answers = [answer(one) for one in studies]
        lacked = sum(not all(one.get("offered", ())) for one in studies)
        cells = (len(studies), lacked, *(answers.count(one) for one in Answer))
        lines.append(f"{system:<13}{name:<{width}}" + "".join(f"{cell:>8}" for cell in cells))
    return "\n".join((*lines, HARDER_NOTES))


def shortfalls(results: Sequence[Result]) -> str:
    """Return one line for each study that falls short, with the effects added instead."""
    lines, unseen = [], unseen_in(results)
    for one in results:
        why = shortfall(one, unseen(one))
        if why:
            left_out = ", not in the library" if one["removed"] else ""
            lines.append(f"{one['system']}, {one['scenario']}{left_out}, seed {one['seed']}: {why}")
    return "\n".join(["Studies that fall short:", *lines]) if lines else ""


def shortfall(one: Result, unseen: bool = False) -> str:
    """Return the reason why a study falls short; empty if it does not.

    `unseen` is True if no planted effect is significant in its records.
    """
    if one["failed"]:
        return f"failed, {one['failed']}"
    added = ", ".join(one["effects"]) or "nothing"
    if one["removed"]:
        words = [f"{one['outcome']}: {added}"] * (not names_no_cause(one, unseen))
        misplaced = not (one["place_right"] or unseen)
        return "; ".join(words + [f"place: {', '.join(one['where'])}"] * misplaced)
    if one["kind"] == "control":
        return f"false: {added} ({one['outcome']})" if one["effects"] else ""
    if one["kind"] == HARDER:
        return _harder_shortfall(one, added)
    if one["kind"] == "process":
        return "" if outcome_of(one) is Outcome.PROCESS_NOISE else f"{one['outcome']}: {added}"
    if not identifiable(one):
        return ""
    words = []
    if not all(one["in"]) or (one["kind"] == "single" and not one["first_right"]):
        words.append(f"{added} ({one['outcome']}; {_leading(one)})")
    if one["ratio"] >= 1.05:
        words.append(
            f"ratio {one['ratio']:.3f}" + ("" if words else f" with {added} ({one['outcome']})")
        )
    return "; ".join(words)


def _harder_shortfall(one: Result, added: str) -> str:
    """Return the answer to a harder truth with the planted effects; empty if it is right."""
    given = answer(one)
    is_right = given is Answer.RIGHT or (given is Answer.DOUBT and not all(one["offered"]))
    truth = " and ".join(name for name, _ in one["planted"])
    return "" if is_right else f"{given.value}: {added} ({one['outcome']}) for {truth}"


def _leading(one: Result) -> str:
    """Return the true fall of chi-square, and the nearest alternatives with their distance."""
    others = [
        f"{' + '.join(names) or 'none'} {worse:.0f}" for names, _, worse in one["alternatives"]
    ]
    return f"truth {one['chi_square']:.0f}; worse by: " + "; ".join(others)


def _of(one: Share) -> str:
    return f"{one.count}/{one.of}" if one.of else "-"


def _outcomes(one: Row) -> str:
    return "  " + ", ".join(f"{name} {count}" for name, count in sorted(one.outcomes.items()))
