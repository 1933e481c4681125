"""Equations in weak form: integrals against test functions, without noisy derivatives."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.polynomial import Polynomial

from .._foundation.checks import InputError, require
from .._foundation.types import Float, Numbers

DEFAULT_POWER = 6  # smooth enough for second derivatives at forty samples in a support (chosen)
DEFAULT_OVERLAP = 4  # test functions in a radius (chosen): twice as many lower no standard error
MIN_SAMPLES = 8  # of a support (chosen): fewer do not resolve the test function
TIME_ROUNDING = 1e-9  # relative rounding of sample times (chosen)

Coefficients = Sequence[float | Numbers]


@dataclass(frozen=True, eq=False)
class WeakForm:
    """The map from signals to whitened integrals over test functions, from `weak_form`.

    Attributes:
        t: sample times, shape (time,) [s].
        centres: centres of the test functions, shape (row,) [s].
        radius: half of the length of a test function's support [s].
        power: power p of the test functions `(1 - s^2)^p`.
        triangle: lower triangle L, `L L'` the covariance of the integrals, shape (row, row).
    """

    t: np.ndarray
    centres: np.ndarray
    radius: float
    power: int
    triangle: np.ndarray

    def __call__(
        self, signals: Float[Numbers, "time *column"], derivative: int = 0
    ) -> Float[np.ndarray, "row *column"]:
        """Return the whitened integrals of the derivative of signals.

            L^-1 int psi_j x^(d) dt = L^-1 (-1)^d int psi_j^(d) x dt

        Args:
            signals: one signal, shape (time,), or one in each column, shape (time, column).
            derivative: order d of the derivative; 0 for the signals themselves.

        Raises:
            InputError: if there are not as many samples as times, a value is not
                finite, or the test functions are not smooth enough for the derivative.
        """
        signals = np.asarray(signals, float)
        require(
            signals.shape[:1] == self.t.shape,
            f"The signals have shape {signals.shape} and there are {len(self.t)} times. Give one "
            "row for each time.",
        )
        require(
            bool(np.isfinite(signals).all()),
            "The signals have values that are not finite. Cut the record there, and stack the rows "
            "of the parts.",
        )
        integrals = _weights(self.t, self.centres, self.radius, self.power, derivative) @ signals
        return scipy.linalg.solve_triangular(self.triangle, integrals, lower=True)


def weak_form(
    t: Float[Numbers, " time"],
    radius: float,
    noise: Sequence[Coefficients],
    *,
    spacing: float | None = None,
    power: int = DEFAULT_POWER,
) -> WeakForm:
    """Return the weak form of equations: rows of a regression that needs no noisy derivative.

        x^(n) = sum_k theta_k phi_k
        (-1)^n int psi_j^(n) x dt = sum_k theta_k int psi_j phi_k dt
        psi_j = (1 - s^2)^p,    s = (t - centre_j) / radius,    |s| < 1

    Each test function gives one row. Integration by parts moves the derivatives from the signal to
    the test function, for the response and for columns that are derivatives themselves. Integrals
    are sums by the trapezoidal rule. Test functions overlap and noise enters through several terms,
    so the rows are whitened:

        covariance of rows = sum_s G_s G_s',    G_s = sum_d (-1)^d Psi^(d) diag(a_sd)

    with `a_sd` the coefficient of the d-th derivative of the noisy signal s in the equation. In
    `x'' + c x' + k x = u` with measured x they are `[(k, c, 1)]`. Start with `[(0, 0, 1)]`,
    estimate k and c, and repeat with the estimates until they no longer change; three times are
    enough. Without the repetitions noise in the columns biases the values, and standard errors are
    wrong. Rows are regressed by any function of `jaxid.structure` with `constant=False`; a constant
    of the equation is a column of ones.

    Args:
        t: sample times, shape (time,) [s], increasing, of one record; rows of several are stacked.
        radius: half of the length of a test function's support [s], at most half of the record.
            About half a period of the motion suits.
        noise: for each noisy signal, its coefficients in the equation by order of the derivative,
            each a number or of shape (time,). Of a nonlinear term it is the term's derivative with
            respect to the signal. With several noisy signals each coefficient is multiplied by the
            standard deviation of its signal. With one, the residual standard deviation `s` of the
            regression estimates the noise of that signal.
        spacing: from one centre to the next [s]; a quarter of the radius by default.
        power: power p of the test functions, at least two more than the order of a derivative.

    Raises:
        InputError: if the times do not increase, radius, spacing or power are out of range, a
            coefficient has another length, or the rows are linearly dependent.

    Sources: Shinbrot, Trans. ASME 79, 1957 (modulating functions); Messenger and Bortz, Multiscale
    Modeling & Simulation 19(3), 2021; Bortz, Messenger and Dukic, Bulletin of Mathematical Biology
    85, 2023 (covariance of the rows at the estimate).
    """
    t, radius = np.asarray(t, float), float(radius)
    spacing = radius / DEFAULT_OVERLAP if spacing is None else float(spacing)
    _check(t, radius, spacing)
    count = int(np.floor((t[-1] - t[0] - 2 * radius) / spacing * (1 + 1e-12))) + 1
    slack = (t[-1] - t[0] - 2 * radius - (count - 1) * spacing) / 2
    centres = t[0] + radius + slack + spacing * np.arange(count)
    gains = [_noise_gain(t, centres, radius, power, coefficients) for coefficients in noise]
    require(bool(gains), "`noise` is empty. Give the coefficients of at least one noisy signal.")
    # the triangle of G' = Q R, whose condition number is not squared: G G' = R' R
    triangle = np.asarray(np.linalg.qr(np.hstack(gains).T, mode="r")).T
    sizes = np.abs(np.diagonal(triangle))
    independent = len(sizes) == count and bool(np.min(sizes) > 1e-10 * np.max(sizes))
    require(
        independent,
        f"The {count} rows are linearly dependent at a spacing of {spacing:.4g} s with the given "
        "coefficients of the noise. Increase `spacing`, or give the coefficients of the signal "
        "that is noisy.",
    )
    return WeakForm(t, centres, radius, power, triangle)


def _check(t: np.ndarray, radius: float, spacing: float) -> None:
    require(
        t.ndim == 1 and len(t) >= MIN_SAMPLES and bool(np.all(np.diff(t) > 0)),
        f"The times have shape {t.shape}. Give one axis of at least {MIN_SAMPLES} times that "
        "increase strictly.",
    )
    shortest, longest = MIN_SAMPLES / 2 * float(np.max(np.diff(t))), float(t[-1] - t[0]) / 2
    require(
        shortest * (1 - TIME_ROUNDING) <= radius <= longest * (1 + TIME_ROUNDING),
        f"The radius is {radius:.4g} s. It must be at least {shortest:.4g} s, so that a test "
        f"function has {MIN_SAMPLES} samples, and at most half of the record, {longest:.4g} s.",
    )
    require(spacing > 0, f"The spacing is {spacing:.4g} s; it must be positive.")


def _noise_gain(
    t: np.ndarray, centres: np.ndarray, radius: float, power: int, coefficients: Coefficients
) -> np.ndarray:
    """Return G of one noisy signal, from its samples to the integrals, shape (row, time)."""
    total = np.zeros((len(centres), len(t)))
    for derivative, coefficient in enumerate(coefficients):
        coefficient = np.asarray(coefficient, float)
        if coefficient.shape not in ((), t.shape):
            raise InputError(
                f"The coefficient of derivative {derivative} in `noise` has shape "
                f"{coefficient.shape}. Give a number, or one value for each of {len(t)} times."
            )
        total += _weights(t, centres, radius, power, derivative) * coefficient
    return total


def _weights(
    t: np.ndarray, centres: np.ndarray, radius: float, power: int, derivative: int
) -> np.ndarray:
    """Return `(-1)^d psi_j^(d)(t_i)` times the interval of each sample, shape (row, time)."""
    require(
        0 <= derivative <= power - 2,
        f"Test functions of power {power} serve derivatives up to order {power - 2}, and "
        f"{derivative} is given. Increase `power`.",
    )
    steps = np.diff(t)
    intervals = (np.append(steps, 0.0) + np.insert(steps, 0, 0.0)) / 2
    s = (t - centres[:, None]) / radius
    psi = (Polynomial([1.0, 0.0, -1.0]) ** power).deriv(derivative)
    return np.where(np.abs(s) < 1, psi(s), 0.0) * intervals * (-1.0 / radius) ** derivative
