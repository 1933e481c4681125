"""Checks of relations between channels: delay, drift, feedback, collinearity, offset at rest."""

from collections.abc import Iterator

import numpy as np
import scipy

from ...data.excitation import INFLATION, variance_inflation
from .channels import Measured
from .findings import Finding, FindingKind
from .regression import Regression, lagged, lags_for, least_squares, regression
from .response import FINE, Response, sampled_response
from .thresholds import (
    CORRELATION_ERRORS,
    DELAY_FALL,
    DIRECT_ERRORS,
    DIRECT_RATIO,
    DIRECT_SHARE,
    FASTEST_STEP,
    FEEDBACK_LAGS,
    LARGEST_CHANGE,
    LARGEST_CONDITION,
    LEAST_CORRELATION,
    LEAST_INNOVATION,
    OFFSET_ERRORS,
    OFFSET_SHARE,
    REST,
    SAMPLES_AT_REST,
    TREND_ERRORS,
    TRIMMINGS,
)


def collinear_inputs(record: Measured) -> Iterator[Finding]:
    """Findings on inputs that are nearly combinations of the others."""
    moving = np.flatnonzero(np.ptp(record.u, axis=0) > 0)
    for k, inflation in zip(moving, variance_inflation(record.u[:, moving]), strict=True):
        if inflation > INFLATION:
            numbers = {"inflation": float(inflation)}
            yield Finding(FindingKind.COLLINEAR, record.name, (record.inputs[k],), numbers)


def offset_at_rest(record: Measured, model: Response) -> Iterator[Finding]:
    """Findings on outputs that are not zero while the inputs rest at zero at the start."""
    extent = np.max(np.abs(record.u), axis=0)
    resting = np.all(np.abs(record.u) <= REST * extent, axis=1)
    count = len(record.t) if resting.all() else int(np.argmin(resting))
    if count < SAMPLES_AT_REST or not model.rests_at_zero:
        return
    for name, values in zip(record.outputs, record.z.T, strict=True):
        z = values[:count][np.isfinite(values[:count])]
        if z.size < SAMPLES_AT_REST:
            continue
        error = np.std(z) / np.sqrt(z.size)
        first, second = z[: z.size // 2], z[z.size // 2 :]
        steady = abs(first.mean() - second.mean()) <= 2 * OFFSET_ERRORS * error
        large = abs(z.mean()) > max(OFFSET_ERRORS * error, OFFSET_SHARE * np.nanmax(np.abs(values)))
        if steady and large:
            errors = float(abs(z.mean()) / error) if error > 0 else np.inf
            numbers = {"value": float(z.mean()), "errors": errors}
            yield Finding(FindingKind.OFFSET, record.name, (name,), numbers)


def delay_and_drift(record: Measured, model: Response) -> Iterator[Finding]:
    """Findings on trends that the inputs do not explain, and on responses later than the model's.

    The record is averaged over steps of `FASTEST_STEP` of the fastest mode.
    """
    factor = steps_in_a_block(record, model)
    u, z = block_means(record.u, factor), block_means(record.z, factor)
    lags = lags_for(len(u), u.shape[1])
    for output, name in enumerate(record.outputs if lags else ()):
        fit = regression(z[:, output], u, lags)
        if fit is None:
            continue
        yield from drift(record, name, fit)
        for channel in range(u.shape[1]):
            if np.ptp(record.u[:, channel]) > 0 and fit.condition < LARGEST_CONDITION:
                yield from delay(record, model, fit, factor, output, channel)


def steps_in_a_block(record: Measured, model: Response) -> int:
    """Return the number of steps of a record in `FASTEST_STEP` of the fastest mode."""
    rate = np.max(model.rates, initial=0.0)
    factor = max(1, int(FASTEST_STEP / (rate * record.step))) if rate > 0 else 1
    return min(factor, max(1, len(record.t) // 100))


def drift(record: Measured, name: str, fit: Regression) -> Iterator[Finding]:
    """Finding on a trend of an output, from a regression on its past and on the inputs."""
    if fit.trend_error > 0 and abs(fit.trend) > TREND_ERRORS * fit.trend_error:
        duration = record.t[-1] - record.t[0]
        slope = fit.trend / duration / max(1.0 - np.sum(fit.past), 1e-6)
        numbers = {"slope": float(slope), "errors": abs(fit.trend) / fit.trend_error}
        yield Finding(FindingKind.DRIFT, record.name, (name,), numbers)


def delay(
    record: Measured, model: Response, fit: Regression, factor: int, output: int, channel: int
) -> Iterator[Finding]:
    """Finding on a response that is later than the model's.

    The impulse response g of the regression is compared with the model's for a grid of delays d:

        chi^2(d) = min_w |g - [m, integral of m, its integral](d) w|^2  in the metric of cov(g)

    The integrals allow for parameters that are not yet fitted. m is of order t^(r-1) at its start.
    """
    g, covariance = impulse_response(fit, channel)
    step = factor * record.step
    delays = np.arange(0.0, 0.5 * len(g), 1.0 / FINE) * step
    basis = sampled_response(model, step, len(g), delays, output, channel)
    L = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) * np.eye(len(g)))
    white, target = np.linalg.solve(L, basis), np.linalg.solve(L, g)
    chi = np.array([_misfit(columns, target) for columns in white])
    best = int(np.argmin(chi))
    if chi[0] - chi[best] > DELAY_FALL and delays[best] > 0.9 * record.step:
        near = delays[chi < chi[best] + 1.0]
        deviation = max(0.5 * (near.max() - near.min()), 0.5 * step / FINE)
        if delays[best] > 3.0 * deviation:
            names = (record.inputs[channel], record.outputs[output])
            numbers = {"seconds": float(delays[best]), "deviation": float(deviation)}
            numbers["fall"] = float(chi[0] - chi[best])
            yield Finding(FindingKind.DELAY, record.name, names, numbers)


def impulse_response(fit: Regression, channel: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the impulse response of a regression, and its covariance.

    g_k = b_k + sum_(i=1..k) a_i g_(k-i); its covariance is the covariance of b, exact where g is
    zero, before the response.
    """
    count = fit.input.shape[1]
    feedback = np.eye(count)
    for lag, a in enumerate(fit.past[: count - 1], start=1):
        feedback -= a * np.eye(count, k=-lag)
    T = np.linalg.inv(feedback)
    at = slice(channel * count, (channel + 1) * count)
    return T @ fit.input[channel], T @ fit.input_covariance[at, at] @ T.T


def _misfit(columns: np.ndarray, target: np.ndarray) -> float:
    U, s, _ = np.linalg.svd(columns, full_matrices=False)
    U = U[:, s > 1e-9 * max(s[0], 1e-300)]
    return float(target @ target - np.sum((U.T @ target) ** 2))


def feedback(record: Measured, model: Response) -> Iterator[Finding]:
    """Findings on inputs that contain the noise of an output.

    In open loop the part of an output that neither its past nor the inputs explain is independent
    of the inputs. Its correlation with the unexpected changes of an input up to `FEEDBACK_LAGS`
    samples later then has the variance 1/N whatever the input. The direct response of the output
    to an unexpected change of the input is compared with the model's (Caines and Chan, IEEE Trans.
    Automatic Control 20, 1975).
    """
    lags = lags_for(len(record.t), record.u.shape[1])
    if not lags:
        return
    changes = [_innovation(values, lags) for values in record.u.T]
    for output, name in enumerate(record.outputs):
        fit = regression(record.z[:, output], record.u, lags)
        if fit is None or not np.nanstd(fit.residual) > 1e-9 * np.nanstd(record.z[:, output]):
            continue
        for channel, change in enumerate(changes):
            if change is None:
                continue
            later = _later_correlation(fit.residual, change)
            lag, r = later or _direct(record, model, lags, output, channel)
            if r != 0.0:
                names = (record.inputs[channel], name)
                numbers = {"lag": lag * record.step, "correlation": r}
                yield Finding(FindingKind.FEEDBACK, record.name, names, numbers)


def _innovation(values: np.ndarray, lags: int) -> np.ndarray | None:
    """Return the small changes of an input that its past does not explain, None if there is none.

    Large ones are NaN.
    """
    X = np.column_stack([np.ones(len(values)), lagged(values, range(1, lags + 1))])
    change = np.full(len(values), np.nan)
    change[lags:] = small_changes(X[lags:], values[lags:])
    return change if np.nanvar(change) > LEAST_INNOVATION * np.var(values) else None


def small_changes(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the residual of a regression, NaN where it is large.

    Large changes of an input are steps of a programme, in which feedback would be lost. They are
    left out of the regression as well (trimmed least squares).
    """
    kept = np.ones(len(y), bool)
    residual = y
    for _ in range(TRIMMINGS):
        theta, *_ = least_squares(X[kept], y[kept])
        residual = y - X @ theta
        deviation = 1.4826 * np.median(np.abs(residual))
        kept = np.abs(residual) <= LARGEST_CHANGE * deviation
    return np.where(kept, residual, np.nan)


def _later_correlation(e: np.ndarray, change: np.ndarray) -> tuple[int, float] | None:
    """Return lag and correlation of noise and later changes of an input, if significant."""
    best = (0, 0.0, 0.0)
    for lag in range(1, FEEDBACK_LAGS + 1):
        first, second = e[: len(e) - lag], change[lag:]
        both = np.isfinite(first) & np.isfinite(second)
        first, second = first[both], second[both]
        power = np.sqrt(np.sum(first**2) * np.sum(second**2))
        r = first @ second / power if power > 0 else 0.0
        best = max(best, (lag, float(r), abs(r) * np.sqrt(both.sum())), key=lambda row: row[2])
    significant = best[2] > CORRELATION_ERRORS and abs(best[1]) > LEAST_CORRELATION
    return best[:2] if significant else None


def _direct(
    record: Measured, model: Response, lags: int, output: int, channel: int
) -> tuple[int, float]:
    """Return lag zero and the correlation of an output with an input at the same sample; zero if it
    is not far above the model's.
    """
    z, u = record.z[:, output], record.u
    past = np.concatenate(
        [np.ones((len(z), 1)), lagged(z, range(1, lags + 1))]
        + [lagged(column, range(1, lags + 1)) for column in u.T],
        axis=1,
    )
    complete = np.isfinite(past).all(axis=1) & np.isfinite(z)
    if complete.sum() < 2 * past.shape[1]:
        return 0, 0.0
    *_, e, _ = least_squares(past[complete], z[complete])
    change = small_changes(past[complete], u[complete, channel])
    small = np.isfinite(change)
    e, change = e[small], change[small]
    power = change @ change
    if power <= LEAST_INNOVATION * np.var(u[:, channel]) * len(change) or not e @ e > 0:
        return 0, 0.0
    slope = change @ e / power
    r = slope * np.sqrt(power / (e @ e))
    error = np.sqrt(max(1.0 - r**2, 1e-12) * (e @ e) / power / len(e))
    expected = _direct_response(model, record.step, output, channel)
    excess = abs(slope) - DIRECT_RATIO * abs(expected) - DIRECT_ERRORS * error
    return 0, float(r) if excess > 0 and r**2 > DIRECT_SHARE else 0.0


def _direct_response(model: Response, step: float, output: int, channel: int) -> float:
    """Return the response at a sample to an input that rises in a straight line from the sample
    before: D + C integral_0^h (1 - s/h) expm(A s) ds B, or D if the sample is held from then on.
    """
    if model.held or not model.A.size:
        return float(model.D[output, channel])
    n, m = model.B.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m] = model.A * step, model.B * step
    block[n : n + m, n + m :] = np.eye(m)
    ramp = scipy.linalg.expm(block)[:n, n + m :]
    return float(model.D[output, channel] + model.C[output] @ ramp[:, channel])


def block_means(values: np.ndarray, factor: int) -> np.ndarray:
    """Return the means of blocks of samples; NaN where one is missing."""
    count = len(values) // factor
    return values[: count * factor].reshape(count, factor, -1).mean(axis=1)
