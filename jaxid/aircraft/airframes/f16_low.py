"""`f16_low`: the F-16 of a widely used textbook, with its tables reduced from NASA TP-1538."""

import math
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from ..._foundation.types import Array, Float
from ...data.io_table import GridData
from ...models.table_set import TableSet
from ...models.tables import Extrapolation, Interpolation
from ..aerodynamics import AbstractAerodynamics
from ..aerodynamics_tables import read_coefficients
from ..airframe import Airframe
from .f16 import f16_airframe
from .shared import DATA

AILERON, RUDDER, STABILATOR = (math.radians(angle) for angle in (20.0, 30.0, 25.0))  # deflections of the increments


class F16LowAerodynamics(AbstractAerodynamics):
    r"""The build-up of Stevens and Lewis, Aircraft Control and Simulation, App. A, with `a = aileron/20deg`, `d = rudder/30deg`.

        CX = CX(alpha, stabilator) + CXq qhat
        CY = CYbeta beta + CYda aileron + CYdr rudder + CYp phat + CYr rhat
        CZ = CZ(alpha) (1 - beta^2) + CZds stabilator + CZq qhat
        Cl = Cl(alpha, beta) + a dCl_da20(alpha, beta) + d dCl_dr30(alpha, beta) + Clp phat + Clr rhat,    Cn alike
        Cm = Cm(alpha, stabilator) + Cmq qhat

    Cl and Cn are tabulated over |beta| and are odd in beta. The leading-edge flap, on its schedule, is in the tables. The book's
    signs are those of this library, so nothing is turned round: its elevator has the trailing edge down and Cm negative, its
    aileron gives Cl negative, its rudder Cn negative and CY positive.

    Args:
        grids: knots and values by name of table.
        interpolation: between knots, see `Table`.
        extrapolation: beyond them.

    Raises:
        InputError: when a grid cannot be a table.
    """

    tables: TableSet
    CYbeta: Float[Array, ""]
    CYda: Float[Array, ""]
    CYdr: Float[Array, ""]
    CZds: Float[Array, ""]

    transparent: ClassVar[tuple[str, ...]] = ("tables",)

    def __init__(
        self,
        grids: Mapping[str, GridData],
        *,
        interpolation: Interpolation = "linear",
        extrapolation: Extrapolation = "linear",
    ):
        odd = {name: _odd(grid) if "abs_beta" in grid.axes else grid for name, grid in grids.items()}
        self.tables = TableSet(odd, interpolation=interpolation, extrapolation=extrapolation)
        self.CYbeta = jnp.asarray(-0.02 / math.radians(1.0), float)
        self.CYda, self.CYdr = jnp.asarray(0.021 / AILERON, float), jnp.asarray(0.086 / RUDDER, float)
        self.CZds = jnp.asarray(-0.19 / STABILATOR, float)

    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        c = self.tables(signals)
        beta, stabilator, aileron, rudder = (signals[name] for name in ("beta", "stabilator", "aileron", "rudder"))
        p, q, r = (signals[name] for name in ("phat", "qhat", "rhat"))
        a, d = aileron / AILERON, rudder / RUDDER
        CX = c["CX"] + c["CXq"] * q
        CY = self.CYbeta * beta + self.CYda * aileron + self.CYdr * rudder + c["CYp"] * p + c["CYr"] * r
        CZ = c["CZ"] * (1.0 - beta**2) + self.CZds * stabilator + c["CZq"] * q
        Cl = c["Cl"] + a * c["dCl_da20"] + d * c["dCl_dr30"] + c["Clp"] * p + c["Clr"] * r
        Cm = c["Cm"] + c["Cmq"] * q
        Cn = c["Cn"] + a * c["dCn_da20"] + d * c["dCn_dr30"] + c["Cnp"] * p + c["Cnr"] * r
        return jnp.stack([CX, CY, CZ, Cl, Cm, Cn])

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return self.tables.limits

    @property
    def refuses(self) -> dict[str, tuple[float, float]]:
        return self.tables.refuses


def f16_low(
    *, xcg: float = 0.35, interpolation: Interpolation = "linear", extrapolation: Extrapolation = "linear"
) -> Airframe:
    """The F-16 of Stevens and Lewis, below Mach 0.6, -10 to 45 deg in alpha and -30 to 30 deg in beta.

    Linear between knots and beyond them, as in the book, so that its trim points are met.

    Args:
        xcg: centre of gravity in parts of the chord; the tables refer to 0.35.
        interpolation: between knots, see `Table`.
        extrapolation: beyond them.
    """
    grids = read_coefficients(DATA / "f16_low")
    aerodynamics = F16LowAerodynamics(grids, interpolation=interpolation, extrapolation=extrapolation)
    return f16_airframe("f16_low", aerodynamics, xcg)


def _odd(grid: GridData) -> GridData:
    """A table over |beta| as one over beta that changes its sign with beta."""
    k = grid.axes.index("abs_beta")
    line, values = grid.knots[k], grid.values
    mirrored = np.flip(np.delete(values, 0, axis=k), axis=k)
    knots = (*(-beta for beta in reversed(line[1:])), *line)
    return grid._replace(
        axes=(*grid.axes[:k], "beta", *grid.axes[k + 1 :]),
        knots=(*grid.knots[:k], knots, *grid.knots[k + 1 :]),
        values=np.concatenate([-mirrored, values], axis=k),
        origin=None,
    )
