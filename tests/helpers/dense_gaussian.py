"""The joint Gaussian of all samples of a linear model, in NumPy: a reference without a filter.

All functions accept complex parameters, so that derivatives are taken by the complex step.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm


class Discrete(NamedTuple):
    """A linear model from sample to sample, `x <- Phi x + b + noise of covariance Q`."""

    Phi: list
    Q: list
    b: list


def van_loan(A, GG, h):
    """Transition by four terms of its series (as Runge-Kutta steps have it), and exact `Qd`."""
    n = len(A)
    block = np.block([[-A, GG], [np.zeros((n, n)), A.T]]) * h
    exponential = expm(block)
    Phi = np.eye(n) + A * h + A @ A * h**2 / 2 + A @ A @ A * h**3 / 6 + A @ A @ A @ A * h**4 / 24
    return Phi, exponential[n:, n:].T @ exponential[:n, n:]


def discrete(A, B, GG, t, u):
    """Steps of a linear model under an input of straight lines."""
    steps = Discrete([], [], [])
    for i, h in enumerate(np.diff(t)):
        Phi, Q = van_loan(A, GG, h)
        middle = (u[i] + u[i + 1]) / 2

        def rate(x, u, A=A, B=B):
            return A @ x + B @ u

        k1 = rate(np.zeros(len(A)), u[i])
        k2 = rate(h / 2 * k1, middle)
        k3 = rate(h / 2 * k2, middle)
        k4 = rate(h * k3, u[i + 1])
        steps.Phi.append(Phi)
        steps.Q.append(Q)
        steps.b.append(h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    return steps


def joint(steps: Discrete, x0, P0):
    """Mean (time, state) and covariance (time, state, time, state) of all states."""
    n, count = len(x0), len(steps.Phi) + 1
    mean = [x0 + 0 * steps.b[0]]
    covariance = np.zeros((count, n, count, n), complex)
    covariance[0, :, 0] = P0
    for i, (Phi, Q, b) in enumerate(zip(*steps, strict=True)):
        mean.append(Phi @ mean[-1] + b)
        for j in range(i + 1):
            covariance[i + 1, :, j] = Phi @ covariance[i, :, j]
            covariance[j, :, i + 1] = covariance[i + 1, :, j].T
        covariance[i + 1, :, i + 1] = Phi @ covariance[i, :, i] @ Phi.T + Q
    return np.stack(mean), covariance


def measured(mean, covariance, C, r, z):
    """Residuals and covariance of all valid measurements, sample by sample."""
    count, n = mean.shape
    H = np.kron(np.eye(count), C)
    sigma = H @ covariance.reshape(count * n, count * n) @ H.T + np.kron(
        np.eye(count), np.diag(r**2)
    )
    valid = ~np.isnan(z).ravel()
    residual = np.where(np.isnan(z), 0, z).ravel() - (mean @ C.T).ravel()
    return residual[valid], sigma[np.ix_(valid, valid)], H[valid]


def cholesky(sigma):
    """Lower factor with `L L^T = sigma` (no conjugate)."""
    L = np.zeros_like(sigma)
    for j in range(len(sigma)):
        L[j, j] = np.sqrt(sigma[j, j] - L[j, :j] @ L[j, :j])
        L[j + 1 :, j] = (sigma[j + 1 :, j] - L[j + 1 :, :j] @ L[j, :j]) / L[j, j]
    return L


def innovations(residual, sigma, z):
    """Innovations and their covariances for each sample, from the factor of the joint one."""
    L = cholesky(sigma.astype(complex))
    w = np.linalg.solve(L, residual)
    result, begin = [], 0
    for row in ~np.isnan(z):
        end = begin + int(row.sum())
        block = L[begin:end, begin:end]
        result.append((block @ w[begin:end], block @ block.T))
        begin = end
    return result


def likelihood(function, theta):
    """Cost, gradient (4.17) and information (4.18) of `function(theta) -> innovations`."""
    value = [(v.real, B.real) for v, B in function(theta)]
    step = 1e-30
    moved = [function(theta + 1j * step * e) for e in np.eye(len(theta))]
    cost, gradient = 0.0, np.zeros(len(theta))
    information = np.zeros((len(theta), len(theta)))
    for i, (v, B) in enumerate(value):
        if not len(v):
            continue
        W = np.linalg.inv(B)
        dv = [m[i][0].imag / step for m in moved]
        dB = [m[i][1].imag / step for m in moved]
        cost += 0.5 * v @ W @ v + 0.5 * np.linalg.slogdet(B)[1]
        for j in range(len(theta)):
            gradient[j] += v @ W @ dv[j] + 0.5 * np.trace(W @ dB[j]) - 0.5 * v @ W @ dB[j] @ W @ v
            for k in range(len(theta)):
                information[j, k] += dv[j] @ W @ dv[k]
                information[j, k] += 0.5 * np.trace(W @ dB[j] @ W @ dB[k])
    return cost, gradient, information
