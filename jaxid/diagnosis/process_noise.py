"""Process noise: whether forces that cannot be predicted explain a residual, and what a filter
leaves of it.

A random force in each uncertain equation, or a random motion of the air, of first order in time as
turbulence is, moves the outputs by the linear model along the trajectory (`free_form`). Its
strengths, its correlation time and what is left for the instruments are found by maximum likelihood
on the innovations of a Kalman filter. The same filter then whitens the sensitivities to absent
effects: a score among innovations is one that accounts for the process noise (generalised least
squares).

Errors of sensors that are of first order in time, coloured noise, are asked about in the same way;
each has its own memory.
"""
# Pyright counts the arguments of functions that equinox and jaxtyping wrap in its own way; the
# tests execute them.
# pyright: reportCallIssue=false

from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix

from .._foundation.compiler import fast_compile_jit
from .._foundation.grid import typical_step
from .._foundation.location import LocationKind
from .._foundation.types import Array, Float
from ..data.record import Record
from ..estimation.problem import Problem
from ..models.free import Parameters
from ..sensitivity.information import gather, record_triangles
from .autoregression import white_noise_variance
from .driven import driven, under
from .free_form import Linear, Places, answer, answers, linear_model, response
from .innovations import Noise, filtered, most_probable
from .probing import probing, waves
from .scores import sensitivities
from .validation import root_mean_square

# of the search for the noise: it is smooth, and a few per cent of its strengths decide nothing
STEPS = 80
TIMES = (1.0, 10.0, 100.0)  # typical steps: correlation times from which the search starts
# of noise, parameters and forces, at most, along the motion without forces and under them
TURNS = 12
# of what the forces explain: a turn that brings less is the last, of either
ROUGHLY, LITTLE = 0.02, 1e-4
SHORTER = 0.25  # by which the way of a turn is shortened that made things worse
RIDGE = 1e-9  # of a column's squared length
# of the variance that was taken for granted: a channel without any noise still has a logarithm
FLOOR = 1e-6
SILENT = -60.0  # the logarithm of no force


class ProcessNoise(NamedTuple):
    """What a filter makes of a residual.

    Attributes:
        parameters: that fit best beside the forces.
        force: standard deviation of the force at each place, in the units of `Noise`.
        time: its correlation time [s], one for all forces, or one for each sensor.
        instruments: standard deviation of the instruments' white noise, relative to that which was
            taken for granted.
        gain: twice the rise of the log-likelihood over noise of the instruments alone.
        worth: the same over the noise without one of the forces, the rest as it is.
        v: innovations of the residuals, white with variance one where the model is right.
        probes: those of what forces would do that follow the signals in some simple way
            (`probing`).
        noise, linear, unit: of the filter: its noise, its model in units of the noise that was
            taken for granted, and the residuals that this noise belongs to.
    """

    parameters: Parameters
    force: Float[Array, " place"]
    time: Float[Array, " memory"]
    instruments: Float[Array, " output"]
    gain: Float[Array, ""]
    worth: Float[Array, " place"]
    v: Float[Array, "case time output"]
    probes: Float[Array, "case time output probe"]
    noise: Noise
    linear: Linear
    unit: Float[Array, "case time output"]

    def of(
        self, problem: Problem, S: Float[Array, "case time output column"]
    ) -> Float[Array, "case time output column"]:
        """Innovations of columns, such as sensitivities at these parameters.

        Args:
            problem: with the records that were filtered.
            S: the columns.
        """
        return _through(self.noise, self.linear, problem.records, problem.whiten(self.unit, S))


def process_noise(
    problem: Problem,
    parameters: Parameters,
    force: Float[Array, " place"],
    places: Places,
    known: bool,
    begin: Sequence[Parameters] = (),
) -> ProcessNoise:
    r"""Fit process noise and parameters to the records of a problem, and filter the residuals with
    it.

        dx_(i+1) = Phi_i dx_i + P_i d_i + Q_i d_(i+1),    d_(i+1) = a d_i + sqrt(1 - a^2) s w_i
        v_i = C_i dx_i + D_i d_i + S_i dtheta + e_i,    a = exp(-h / time)

    Output error takes strong forces for other parameters, and strong forces lead where the linear
    model along the trajectory without them does not hold. So noise, parameters and forces are found
    in turn: the noise on the linear model along the trajectory; one Gauss-Newton step `dtheta` on
    the innovations; the most probable forces `d`, given all samples; and then the trajectory under
    these forces and the linear model along it anew, an iterated extended Kalman smoother. The
    sensitivities `S` and the probes stay those of the motion without forces: they are known
    beforehand, where a motion that was found from the measurements holds their noise, and would be
    correlated with the innovations. What the samples before it say of a state is not: an innovation
    is what the past does not foretell, and so is correlated with no function of it. A force that
    follows a state in whatever way, such as the magnets of a motor its angle, is told by that from
    a random one. Bounds and priors of the parameters hold as in the estimate.

    A gust acts through the derivatives of the aircraft: with those that output error takes for it,
    the forces that are most probable can lead astray, to a wind that wanders. Begun anew, at the
    likeliest of several parameters, the first turns are without forces in the trajectory, until the
    parameters come near, and a noise is judged by what these leave of the innovations.

    Args:
        problem: with output error for likelihood; its shared parameters are those that are free.
        parameters: its solution.
        force: its strength at each place, where the search starts: that of the disturbance which
            `where` finds there.
        places: equations, and then the air; or sensors alone.
        known: whether the instruments' noise is known; else its variances are estimated as well.
        begin: where the turns may begin anew, else at the solution.

    Returns:
        Strengths, the innovations, and the filter. (Maine & Iliff, NASA RP-1168, 1986, section 5;
        Kalman 1960; Bell, SIAM J. Optimization 4, 1994: the iterated smoother is Gauss-Newton on
        the forces.)
    """
    sensors, mask = of_sensors(places), problem.records.mask
    unit = _residuals(problem, parameters)
    white = problem.whiten(unit, unit)
    without = _white_alone(white, mask, known)
    search = _begin(force, force.size if sensors else 1, problem.records.t, white, mask)
    pushed, asked = (problem, places) if sensors else driven(problem, places)
    signals, still = _signals(problem, parameters), jnp.zeros((*mask.shape[:2], force.size))
    anew = len(begin) > 0

    def turn(parameters: Parameters, forces, search: Noise) -> Turn:
        v, S = sensitivities(problem, parameters)
        at = pushed if sensors else under(pushed, asked, forces)
        v = v if sensors else _residuals(at, parameters)
        return _turn(at, parameters, (unit, v, S), forces, search, asked, known, anew)

    def again(last: Turn, way: float, forced: bool = True) -> Turn:
        ahead, forces = jax.tree.map(lambda old, new: old + way * (new - old), last.begin, last.end)
        return turn(problem.project(ahead), forces if forced else still, _again(last.noise, search))

    starts = [turn(one, still, search) for one in begin or (parameters,)]
    best = min(starts, key=lambda one: float(jnp.nan_to_num(one.cost, nan=jnp.inf)))
    if anew:
        near = _settled(best, without, lambda last, way: again(last, way, False), ROUGHLY)
        forced = again(near, 1.0)
        best = forced if jnp.isfinite(forced.cost) else near
    best = _settled(best, without, again, LITTLE)
    instruments = jnp.where(known, 1.0, jnp.exp(0.5 * best.noise.instruments))
    strengths = (jnp.exp(best.noise.force), jnp.exp(best.noise.time), instruments)
    gain = 2.0 * jnp.sum(mask) * (without - best.cost)
    probes = _probes(best.noise, best.linear, problem.records, signals, best.foreseen)
    return ProcessNoise(
        best.begin[0], *strengths, gain, best.worth, best.v, probes, best.noise, best.linear, unit
    )


def of_sensors(places: Places) -> bool:
    """Whether all places are sensors, so that no state is moved."""
    return all(kind is LocationKind.SENSOR for kind, _ in places)


class Turn(NamedTuple):
    """One turn of `process_noise`.

    Attributes:
        noise: what is most likely along the trajectory.
        linear: the model along it, in units of the noise that was taken for granted.
        v: innovations of the residuals.
        foreseen: the states at each sample, as those before it say.
        begin: parameters and forces of the trajectory.
        end: those that are most probable, given this noise.
        cost: negative log-likelihood for each sample at the beginning.
        worth: as in `ProcessNoise`.
    """

    noise: Noise
    linear: Linear
    v: Float[Array, "case time output"]
    foreseen: Float[Array, "case time state"]
    begin: tuple[Parameters, Float[Array, "case time place"]]
    end: tuple[Parameters, Float[Array, "case time place"]]
    cost: Float[Array, ""]
    worth: Float[Array, " place"]


def _settled(
    best: Turn, without: Float[Array, ""], again: Callable[[Turn, float], Turn], little: float
) -> Turn:
    """Turns, until one brings less than a little of what the forces explain."""
    way = 1.0
    for _ in range(TURNS):
        found = again(best, way)
        gain = float(best.cost - found.cost)
        # Gauss-Newton goes too far where the linear model does not hold so far: then less of the
        # same way.
        best, way = (found, min(1.0, 2.0 * way)) if gain > 0 else (best, SHORTER * way)
        if abs(gain) <= little * abs(float(without - best.cost)):
            break
    return best


@fast_compile_jit
def _turn(
    problem: Problem,
    parameters: Parameters,
    seen: tuple[
        Float[Array, "case time output"],
        Float[Array, "case time output"],
        Float[Array, "case time output column"],
    ],
    forces: Float[Array, "case time place"],
    begin: Noise,
    places: Places,
    known: bool,
    ahead: bool,
) -> Turn:
    r"""The noise by maximum likelihood, and the parameters and forces that its filter finds.

        cost = (|w|^2 + log det) / 2, or (|w|^2 - w' F (F' F)^-1 F' w + log det) / 2

    with w and F the innovations of residuals and of sensitivities. In the second what the
    parameters will take does not count against a noise: where a steady wind is another start of the
    motion, a noise that is judged at the parameters as they are follows these, and they it, one
    small turn after the other. It looks far ahead on a linear model that may not hold so far.

    Args:
        seen: the residuals whose noise is the unit of all turns; residuals at these parameters
            under these forces; and sensitivities without them.
        forces: in the trajectory already; a sensor's error is not, as it moves nothing.
        begin: where the search starts, several such.
        ahead: whether the noise is judged by the second cost.
    """

    def one(own, case):
        return linear_model(problem, own, parameters.shared, case, places)

    linear = jax.vmap(one)(parameters.rows, problem.cases())
    along, (unit, *rows) = linear.x, seen
    linear = linear._replace(C=problem.whiten(unit, linear.C), D=problem.whiten(unit, linear.D))
    linear = _without_states(linear) if of_sensors(places) else linear
    t, mask = problem.records.t, problem.records.mask
    white, S = (problem.whiten(unit, one) for one in rows)
    # What the linear model says of the residuals without any force: what stands in the trajectory
    # is no prior knowledge.
    white = white + jax.vmap(answer)(linear, forces)
    columns, count = jnp.concatenate([white[..., None], S], axis=-1), parameters.rows.shape[1]
    prior = problem.prior_cost(parameters)

    def told(noise: Noise) -> Noise:
        return noise._replace(instruments=jnp.where(known, 0.0, noise.instruments))

    def through(noise: Noise, columns):
        return jax.vmap(lambda *case: filtered(*case, noise))(linear, t, mask, columns)

    def cost(noise: Noise, ahead: bool):
        innovations, log_det, _ = through(told(noise), columns if ahead else columns[..., :1])
        left = _unexplained(innovations, count) if ahead else jnp.sum(innovations**2)
        return (0.5 * (left + jnp.sum(log_det)) + prior) / jnp.sum(mask)

    def search(begin: Noise):
        solver = optimistix.BFGS(rtol=LITTLE, atol=LITTLE)
        found = optimistix.minimise(cost, solver, begin, ahead, max_steps=STEPS, throw=False).value
        return found, cost(found, ahead)

    # One after the other: under vmap, BFGS of optimistix 0.1.0 took no step at all on the forces of
    # an aircraft.
    tried, costs = jax.lax.map(search, begin)
    best = jnp.nanargmin(costs)
    noise = told(jax.tree.map(lambda one: one[best], tried))
    whole, _, dx = through(noise, columns)
    # What sensors err moves no state.
    foreseen = along if of_sensors(places) else along - jax.vmap(response)(linear, forces) + dx
    step, left = _step(
        whole[..., 0], whole[..., 1:], white, S, count, problem.prior_rows(parameters)
    )
    probable = jax.vmap(lambda *case: most_probable(*case, noise))(linear, t, mask, left)
    end = (jax.tree.map(jnp.add, parameters, step), forces if of_sensors(places) else probable)
    each = jnp.arange(noise.force.size)
    without_one = jax.lax.map(
        lambda place: cost(noise._replace(force=noise.force.at[place].set(SILENT)), ahead), each
    )
    worth = 2.0 * jnp.sum(mask) * (without_one - costs[best])
    return Turn(
        noise, linear, whole[..., 0], foreseen, (parameters, forces), end, cost(noise, False), worth
    )


@eqx.filter_jit
def _through(
    noise: Noise, linear: Linear, records: Record, columns: Float[Array, "case time output column"]
):
    """Innovations of columns."""
    return jax.vmap(lambda *case: filtered(*case, noise)[0])(
        linear, records.t, records.mask, columns
    )


@eqx.filter_jit
def _probes(
    noise: Noise,
    linear: Linear,
    records: Record,
    signals: Float[Array, "case time signal"],
    foreseen: Float[Array, "case time state"],
):
    """Innovations of what forces would do that follow the signals, or the states as they are
    foreseen, at each place.
    """
    probes = jax.vmap(answers)(
        linear, jnp.concatenate([probing(signals, records.t), waves(foreseen)], axis=-1)
    )
    return _through(noise, linear, records, probes.reshape(*records.mask.shape, -1))


@eqx.filter_jit
def _residuals(problem: Problem, parameters: Parameters) -> Float[Array, "case time output"]:
    """Those of all records, compiled."""
    return problem.residuals(parameters)


@eqx.filter_jit
def _signals(problem: Problem, parameters: Parameters) -> Float[Array, "case time signal"]:
    """States, inputs and outputs along the trajectories."""
    motion = problem.solve(parameters)
    return jnp.concatenate([motion.x, problem.records.u, motion.y], axis=-1)


def _unexplained(
    innovations: Float[Array, "case time output column"], count: int
) -> Float[Array, ""]:
    """Sum of squares that least squares on all other columns leaves of the first; the next so many
    are each case's own.
    """
    rows = innovations.reshape(innovations.shape[0], -1, innovations.shape[-1])
    own, others = (
        rows[..., 1 : 1 + count],
        jnp.concatenate([rows[..., :1], rows[..., 1 + count :]], axis=-1),
    )
    left = jax.vmap(_left)(others, own).reshape(-1, others.shape[-1])
    return jnp.sum(_left(left[:, :1], left[:, 1:]) ** 2)


def _left(
    y: Float[Array, "row column"], X: Float[Array, "row known"]
) -> Float[Array, "row column"]:
    """What least squares on some columns leaves of others; columns that are zero, or one too many,
    do no harm.
    """
    power = jnp.sum(X**2, axis=0)
    X = X / jnp.sqrt(jnp.where(power > 0, power, 1.0))[None]
    return y - X @ jnp.linalg.solve(X.T @ X + RIDGE * jnp.eye(power.size), X.T @ y)


def _step(
    v, S, white, columns, count: int, prior
) -> tuple[Parameters, Float[Array, "case time output"]]:
    """The Gauss-Newton step of the parameters on filtered residuals, and what it leaves of those
    that are not filtered.
    """
    triangles, shared = record_triangles(S[..., :count], S[..., count:], v), S.shape[-1] - count
    free = jnp.zeros((v.shape[0], count), bool), jnp.zeros(shared, bool)
    information = gather(triangles, prior, *free)
    theta = jnp.linalg.pinv(information.triangle) @ information.rhs
    step = Parameters(theta, information.own.solve(theta))
    explained = jnp.einsum("ctok,ck->cto", columns[..., :count], step.rows)
    return step, white - explained - jnp.einsum("ctok,k->cto", columns[..., count:], theta)


def _without_states(linear: Linear) -> Linear:
    """The same without the states that nothing moves."""
    return linear._replace(
        Phi=linear.Phi[..., :0, :0],
        P=linear.P[..., :0, :],
        Q=linear.Q[..., :0, :],
        C=linear.C[..., :0],
    )


def _white_alone(white, seen, known: bool) -> Float[Array, ""]:
    """Negative log-likelihood for each sample of white residuals, of variance one, or of whatever
    variance by channel.
    """
    rms, count = root_mean_square(white, seen), jnp.sum(seen, axis=(0, 1))
    if known:
        return 0.5 * jnp.sum(count * rms**2) / jnp.sum(count)
    return 0.5 + jnp.sum(count * jnp.log(jnp.where(count > 0, rms, 1.0))) / jnp.sum(count)


def _begin(force, memories, t, white, seen) -> Noise:
    """The given forces, with several correlation times; what is fast in the residual is the
    instruments'.
    """
    fast, times = white_noise_variance(white, seen), jnp.array(TIMES) * typical_step(t)
    each = [jnp.tile(jnp.log(one)[None], (times.size, 1)) for one in (force, fast + FLOOR)]
    return Noise(each[0], jnp.tile(jnp.log(times)[:, None], (1, memories)), each[1])


def _again(noise: Noise, begin: Noise) -> Noise:
    """Where a search goes on: at the strengths that were found, with all correlation times; what
    has vanished gets a chance.
    """
    floor = begin.force - jnp.log(10.0)
    return Noise(
        jnp.maximum(jnp.broadcast_to(noise.force, floor.shape), floor),
        begin.time,
        jnp.broadcast_to(noise.instruments, begin.instruments.shape),
    )
