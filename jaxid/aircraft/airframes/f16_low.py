"""`f16_low`: the F-16 of Stevens and Lewis, with tables reduced from NASA TP-1538."""

import math
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

from ..._foundation.types import Array, Float
from ...data.io.table import GridData
from ...models.table_set import TableSet
from ...models.tables import Extrapolation, Interpolation
from ..vehicle.aerodynamics import AbstractAerodynamics
from ..vehicle.aerodynamics_tables import read_coefficients
from ..vehicle.airframe import Airframe
from .f16 import f16_airframe
from .shared import DATA

# Deflections of the increments (Stevens and Lewis, App. A).
AILERON, RUDDER, STABILATOR = (math.radians(angle) for angle in (20.0, 30.0, 25.0))


class F16LowAerodynamics(AbstractAerodynamics):
    r"""The build-up of Stevens and Lewis, Aircraft Control and Simulation, App. A, with `a =
    aileron/20deg`, `d = rudder/30deg`.

        CX = CX(alpha, stabilator) + CXq qhat
        CY = CYbeta beta + CYda aileron + CYdr rudder + CYp phat + CYr rhat
        CZ = CZ(alpha) (1 - beta^2) + CZds stabilator + CZq qhat
        Cl = Cl(alpha, beta) + a dCl_da20(alpha, beta) + d dCl_dr30(alpha, beta)
             + Clp phat + Clr rhat
        Cn as Cl
        Cm = Cm(alpha, stabilator) + Cmq qhat

    Cl and Cn are tabulated over |beta| and are odd in beta. The tables include the leading-edge
    flap on its schedule. The book has the sign convention of this library: a positive elevator has
    its trailing edge down and gives Cm negative, a positive aileron gives Cl negative, a positive
    rudder Cn negative and CY positive.

    Args:
        grids: knots and values by name of table.
        interpolation: between knots, see `Table`.
        extrapolation: beyond the knots.

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
        interpolation: Interpolation | str = Interpolation.LINEAR,
        extrapolation: Extrapolation | str = Extrapolation.LINEAR,
    ):
        odd = {
            name: _odd(grid) if "abs_beta" in grid.axes else grid for name, grid in grids.items()
        }
        self.tables = TableSet(odd, interpolation=interpolation, extrapolation=extrapolation)
        self.CYbeta = jnp.asarray(-0.02 / math.radians(1.0), float)
        self.CYda, self.CYdr = (
            jnp.asarray(0.021 / AILERON, float),
            jnp.asarray(0.086 / RUDDER, float),
        )
        self.CZds = jnp.asarray(-0.19 / STABILATOR, float)

    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        c = self.tables(signals)
        beta, stabilator, aileron, rudder = (
            signals[name] for name in ("beta", "stabilator", "aileron", "rudder")
        )
        p, q, r = (signals[name] for name in ("phat", "qhat", "rhat"))
        a, d = aileron / AILERON, rudder / RUDDER
        CX = c["CX"] + c["CXq"] * q
        CY = (
            self.CYbeta * beta
            + self.CYda * aileron
            + self.CYdr * rudder
            + c["CYp"] * p
            + c["CYr"] * r
        )
        CZ = c["CZ"] * (1.0 - beta**2) + self.CZds * stabilator + c["CZq"] * q
        Cl = c["Cl"] + a * c["dCl_da20"] + d * c["dCl_dr30"] + c["Clp"] * p + c["Clr"] * r
        Cm = c["Cm"] + c["Cmq"] * q
        Cn = c["Cn"] + a * c["dCn_da20"] + d * c["dCn_dr30"] + c["Cnp"] * p + c["Cnr"] * r
        return jnp.stack([CX, CY, CZ, Cl, Cm, Cn])

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return self.tables.limits

    @property
    def hard_limits(self) -> dict[str, tuple[float, float]]:
        return self.tables.hard_limits


def f16_low(
    *,
    xcg: float = 0.35,
    interpolation: Interpolation | str = Interpolation.LINEAR,
    extrapolation: Extrapolation | str = Extrapolation.LINEAR,
) -> Airframe:
    """Return the F-16 of Stevens and Lewis, below Mach 0.6, -10 to 45 deg in alpha and -30 to 30
    deg in beta.

    Interpolation and extrapolation are linear by default, as in the book, which reproduces its trim
    points.

    Args:
        xcg: centre of gravity as a fraction of the chord; the tables refer to 0.35.
        interpolation: between knots, see `Table`.
        extrapolation: beyond the knots.
    """
    grids = read_coefficients(DATA / "f16_low")
    aerodynamics = F16LowAerodynamics(
        grids, interpolation=interpolation, extrapolation=extrapolation
    )
    return f16_airframe("f16_low", aerodynamics, xcg)


def _odd(grid: GridData) -> GridData:
    """Return a table over |beta| as an odd table over beta."""
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
