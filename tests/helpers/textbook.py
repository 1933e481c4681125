"""Textbook data, as facts with their source, and a stepwise regression by statsmodels that shares
no code with ours.
"""

import numpy as np
import statsmodels.api as sm

# Heat of hardening of cement [cal/g] by composition [%] (Woods, Steinour & Starke, Ind. Eng. Chem.
# 24, 1932, Table I; Hald, Statistical Theory with Engineering Applications, 1952, p. 647; Draper &
# Smith, Applied Regression Analysis, 1981, appendix B).
HALD_NAMES = ("x1", "x2", "x3", "x4")
HALD = np.array(
    [
        (7, 26, 6, 60, 78.5),
        (1, 29, 15, 52, 74.3),
        (11, 56, 8, 20, 104.3),
        (11, 31, 8, 47, 87.6),
        (7, 52, 6, 33, 95.9),
        (11, 55, 9, 22, 109.2),
        (3, 71, 17, 6, 102.7),
        (1, 31, 22, 44, 72.5),
        (2, 54, 18, 22, 93.1),
        (21, 47, 4, 26, 115.9),
        (1, 40, 23, 34, 83.8),
        (11, 66, 9, 12, 113.3),
        (10, 68, 8, 12, 109.4),
    ]
)

# Employment in the United States, 1947 to 1962 (Longley, J. Am. Stat. Assoc. 62, 1967). Last the
# response: total employment.
LONGLEY_NAMES = ("deflator", "GNP", "unemployed", "forces", "population", "year")
LONGLEY = np.array(
    [
        (83.0, 234289, 2356, 1590, 107608, 1947, 60323),
        (88.5, 259426, 2325, 1456, 108632, 1948, 61122),
        (88.2, 258054, 3682, 1616, 109773, 1949, 60171),
        (89.5, 284599, 3351, 1650, 110929, 1950, 61187),
        (96.2, 328975, 2099, 3099, 112075, 1951, 63221),
        (98.1, 346999, 1932, 3594, 113270, 1952, 63639),
        (99.0, 365385, 1870, 3547, 115094, 1953, 64989),
        (100.0, 363112, 3578, 3350, 116219, 1954, 63761),
        (101.2, 397469, 2904, 3048, 117388, 1955, 66019),
        (104.6, 419180, 2822, 2857, 118734, 1956, 67857),
        (108.4, 442769, 2936, 2798, 120445, 1957, 68169),
        (110.8, 444546, 4681, 2637, 121950, 1958, 66513),
        (112.6, 482704, 3813, 2552, 123366, 1959, 68655),
        (114.2, 502601, 3931, 2514, 125368, 1960, 69564),
        (115.7, 518173, 4806, 2572, 127852, 1961, 69331),
        (116.9, 554894, 4007, 2827, 130081, 1962, 70551),
    ]
)
# Certified values of the NIST Statistical Reference Datasets, "Longley": value and standard error.
LONGLEY_CONSTANT = (-3482258.63459582, 890420.383607373)
LONGLEY_CERTIFIED = np.array(
    [
        (15.0618722713733, 84.9149257747669),
        (-0.358191792925910e-01, 0.334910077722432e-01),
        (-2.02022980381683, 0.488399681651699),
        (-1.03322686717359, 0.214274163161675),
        (-0.511041056535807e-01, 0.226073200069370),
        (1829.15146461355, 455.478499142212),
    ]
)
LONGLEY_S, LONGLEY_R2, LONGLEY_F = 304.854073561965, 0.995479004577296, 330.285339234588


def stepwise_by_statsmodels(X, y, names, F_in, F_out):
    """(action, name, F) of each step; every F is the square of a t value of a separate `OLS`."""
    steps, inside = [], []
    while True:
        if inside:
            F = _squared_t(X, y, inside)
            if min(F) < F_out:
                gone = inside.pop(int(np.argmin(F)))
                steps.append(("remove", names[gone], min(F)))
                continue
        outside = [i for i in range(len(names)) if i not in inside]
        F = [_squared_t(X, y, [*inside, i])[-1] for i in outside]
        if not F or max(F) < F_in:
            return steps, [names[i] for i in inside]
        inside.append(outside[int(np.argmax(F))])
        steps.append(("enter", names[inside[-1]], max(F)))


def _squared_t(X, y, inside):
    return sm.OLS(y, sm.add_constant(X[:, inside])).fit().tvalues[1:] ** 2
