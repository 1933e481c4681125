"""Sixteen least-squares problems of More, Garbow and Hillstrom, "Testing Unconstrained Optimization
Software", ACM Transactions on Mathematical Software 7(1), 1981: formulas, data, standard starts and
least sums of squares. Numbers in the comments are those of that paper.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jaxid._foundation.types import Array, Float


class StaticProblem(NamedTuple):
    """Minimise the sum of squares of a function.

    Attributes:
        function: residuals at a vector of parameters.
        start: standard start.
        least: least sum of squares.
    """

    function: Callable[[Float[Array, " parameter"]], Float[Array, " row"]]
    start: tuple[float, ...]
    least: float


def rosenbrock(x):  # 1
    return jnp.stack([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])


def freudenstein_roth(x):  # 2
    first = -13.0 + x[0] + ((5.0 - x[1]) * x[1] - 2.0) * x[1]
    return jnp.stack([first, -29.0 + x[0] + ((x[1] + 1.0) * x[1] - 14.0) * x[1]])


def powell_badly_scaled(x):  # 3
    return jnp.stack([1e4 * x[0] * x[1] - 1.0, jnp.exp(-x[0]) + jnp.exp(-x[1]) - 1.0001])


def brown_badly_scaled(x):  # 4
    return jnp.stack([x[0] - 1e6, x[1] - 2e-6, x[0] * x[1] - 2.0])


def beale(x):  # 5
    return jnp.array([1.5, 2.25, 2.625]) - x[0] * (1.0 - x[1] ** jnp.arange(1.0, 4.0))


def jennrich_sampson(x):  # 6
    i = jnp.arange(1.0, 11.0)
    return 2.0 + 2.0 * i - (jnp.exp(i * x[0]) + jnp.exp(i * x[1]))


def helical_valley(x):  # 7
    turn = jnp.arctan2(x[1], x[0]) / (2.0 * jnp.pi)
    turn = jnp.where(turn < -0.25, turn + 1.0, turn)
    radius = jnp.sqrt(x[0] ** 2 + x[1] ** 2)
    return jnp.stack([10.0 * (x[2] - 10.0 * turn), 10.0 * (radius - 1.0), x[2]])


BARD = np.array(
    [0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39]
)


def bard(x):  # 8
    u = jnp.arange(1.0, 16.0)
    v = 16.0 - u
    return BARD - (x[0] + u / (v * x[1] + jnp.minimum(u, v) * x[2]))


GAUSSIAN = np.array([0.0009, 0.0044, 0.0175, 0.0540, 0.1295, 0.2420, 0.3521, 0.3989])


def gaussian(x):  # 9
    measured = np.concatenate([GAUSSIAN, GAUSSIAN[-2::-1]])
    t = (8.0 - jnp.arange(1.0, 16.0)) / 2.0
    return x[0] * jnp.exp(-x[1] * (t - x[2]) ** 2 / 2.0) - measured


MEYER = np.array(
    [
        [34780, 28610, 23650, 19630, 16370, 13720, 11540, 9744],
        [8261, 7030, 6005, 5147, 4427, 3820, 3307, 2872],
    ]
).ravel()


def meyer(x):  # 10
    return x[0] * jnp.exp(x[1] / (45.0 + 5.0 * jnp.arange(1.0, 17.0) + x[2])) - MEYER


def box(x):  # 12
    t = 0.1 * jnp.arange(1.0, 11.0)
    return jnp.exp(-t * x[0]) - jnp.exp(-t * x[1]) - x[2] * (jnp.exp(-t) - jnp.exp(-10.0 * t))


def powell_singular(x):  # 13
    return jnp.stack(
        [
            x[0] + 10.0 * x[1],
            np.sqrt(5.0) * (x[2] - x[3]),
            (x[1] - 2.0 * x[2]) ** 2,
            np.sqrt(10.0) * (x[0] - x[3]) ** 2,
        ]
    )


def wood(x):  # 14
    return jnp.stack(
        [
            10.0 * (x[1] - x[0] ** 2),
            1.0 - x[0],
            np.sqrt(90.0) * (x[3] - x[2] ** 2),
            1.0 - x[2],
            np.sqrt(10.0) * (x[1] + x[3] - 2.0),
            (x[1] - x[3]) / np.sqrt(10.0),
        ]
    )


KOWALIK = np.array(
    [0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246]
)
KOWALIK_AT = np.array([4.0, 2.0, 1.0, 0.5, 0.25, 0.167, 0.125, 0.1, 0.0833, 0.0714, 0.0625])


def kowalik_osborne(x):  # 15
    u = jnp.asarray(KOWALIK_AT)
    return KOWALIK - x[0] * (u**2 + u * x[1]) / (u**2 + u * x[2] + x[3])


def brown_dennis(x):  # 16
    t = jnp.arange(1.0, 21.0) / 5.0
    first = x[0] + t * x[1] - jnp.exp(t)
    return first**2 + (x[2] + x[3] * jnp.sin(t) - jnp.cos(t)) ** 2


OSBORNE = np.array(
    [
        [0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751],
        [0.718, 0.685, 0.658, 0.628, 0.603, 0.580, 0.558, 0.538, 0.522, 0.506, 0.490],
        [0.478, 0.467, 0.457, 0.448, 0.438, 0.431, 0.424, 0.420, 0.414, 0.411, 0.406],
    ]
).ravel()


def osborne(x):  # 17
    t = 10.0 * jnp.arange(33.0)
    return OSBORNE - (x[0] + x[1] * jnp.exp(-t * x[3]) + x[2] * jnp.exp(-t * x[4]))


STATIC = {
    "Rosenbrock": StaticProblem(rosenbrock, (-1.2, 1.0), 0.0),
    "Freudenstein and Roth": StaticProblem(freudenstein_roth, (0.5, -2.0), 0.0),
    "Powell, badly scaled": StaticProblem(powell_badly_scaled, (0.0, 1.0), 0.0),
    "Brown, badly scaled": StaticProblem(brown_badly_scaled, (1.0, 1.0), 0.0),
    "Beale": StaticProblem(beale, (1.0, 1.0), 0.0),
    "Jennrich and Sampson": StaticProblem(jennrich_sampson, (0.3, 0.4), 124.362),
    "helical valley": StaticProblem(helical_valley, (-1.0, 0.0, 0.0), 0.0),
    "Bard": StaticProblem(bard, (1.0, 1.0, 1.0), 8.21487e-3),
    "Gaussian": StaticProblem(gaussian, (0.4, 1.0, 0.0), 1.12793e-8),
    "Meyer": StaticProblem(meyer, (0.02, 4000.0, 250.0), 87.9458),
    "Box": StaticProblem(box, (0.0, 10.0, 20.0), 0.0),
    "Powell, singular": StaticProblem(powell_singular, (3.0, -1.0, 0.0, 1.0), 0.0),
    "Wood": StaticProblem(wood, (-3.0, -1.0, -3.0, -1.0), 0.0),
    "Kowalik and Osborne": StaticProblem(kowalik_osborne, (0.25, 0.39, 0.415, 0.39), 3.07505e-4),
    "Brown and Dennis": StaticProblem(brown_dennis, (25.0, 5.0, -5.0, -1.0), 85822.2),
    "Osborne, exponentials": StaticProblem(osborne, (0.5, 1.5, -1.0, 0.01, 0.02), 5.46489e-5),
}
