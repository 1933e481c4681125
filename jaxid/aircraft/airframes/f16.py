"""`f16`: the F-16 of the wind-tunnel data base of NASA TP-1538."""

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
from .shared import DATA, angles, ft, ft2, mass_properties

# Deflections of the tables of TP-1538.
FLAP = math.radians(25.0)  # leading-edge flap of the basic tables
AILERON = math.radians(20.0)  # tables that end in _a20
RUDDER = math.radians(30.0)  # tables that end in _r30


class F16Aerodynamics(AbstractAerodynamics):
    r"""The build-up of NASA TP-1538, with `e = 1 - flap/25deg`, `a = aileron/20deg`, `d =
    rudder/30deg`.

        CX = CX(alpha, beta, stabilator) + e dCX_lef(alpha, beta) + (CXq + e dCXq_lef) qhat
        CZ as CX
        Cm = Cm(alpha, beta, stabilator) eta(stabilator) + e dCm_lef + dCm(alpha)
             + (Cmq + e dCmq_lef) qhat
        CY = CY(alpha, beta) + e dCY_lef + a (dCY_a20 + e dCY_a20_lef) + d dCY_r30
             + (CYp + e dCYp_lef) phat + (CYr + e dCYr_lef) rhat
        Cl, Cn as CY, with a static part that depends on the stabilator

    The basic tables are valid for the leading-edge flap fully down, 25 deg, tables that end in
    `_lef` for the flap up; the increments d... are differences of tables, and their values are
    parameters. The signs of deflections in the source are the signs of this library. Left out:
    speed brake, deep-stall increment of the stabilator, and the increments of Cl_beta and Cn_beta,
    because their unit (per degree or per radian) is uncertain.

    The flap is either fixed or follows its steady schedule (TP-1538, without its lag), within 0 to
    25 deg:

        flap = 1.38 alpha + 1.45 deg - 9.05 deg qbar/pressure

    Args:
        grids: knots and values by name of table.
        flap: of the leading edge [rad]; None for the schedule, which needs the signals `qbar` and
            `pressure`.
        interpolation: between knots, see `Table`.
        extrapolation: beyond the knots of the basic tables. Increments of the flap are constant
            above 45 deg of alpha, the end of their tables; the schedule has the flap fully down
            there.

    Raises:
        InputError: when a grid cannot be a table.
    """

    basic: TableSet
    increments: TableSet
    flap: Float[Array, ""] | None

    transparent: ClassVar[tuple[str, ...]] = ("basic", "increments")

    def __init__(
        self,
        grids: Mapping[str, GridData],
        *,
        flap: Float[Array, ""] | float | None = None,
        interpolation: Interpolation | str = Interpolation.LINEAR,
        extrapolation: Extrapolation | str = Extrapolation.HOLD,
    ):
        basic, increments = _differences(grids)
        self.basic = TableSet(basic, interpolation=interpolation, extrapolation=extrapolation)
        self.increments = TableSet(increments, interpolation=interpolation)
        self.flap = None if flap is None else jnp.asarray(flap, float)

    def coefficients(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, " coefficient"]:
        c = self.basic(signals) | self.increments(signals)
        e = 1.0 - self.flap_position(signals) / FLAP
        a, d = signals["aileron"] / AILERON, signals["rudder"] / RUDDER

        def longitudinal(name: str, static):
            return (
                static
                + e * c[f"d{name}_lef"]
                + (c[f"{name}q"] + e * c[f"d{name}q_lef"]) * signals["qhat"]
            )

        def lateral(name: str):
            static = c[name] + e * c[f"d{name}_lef"] + d * c[f"d{name}_r30"]
            roll = (c[f"{name}p"] + e * c[f"d{name}p_lef"]) * signals["phat"]
            yaw = (c[f"{name}r"] + e * c[f"d{name}r_lef"]) * signals["rhat"]
            return static + a * (c[f"d{name}_a20"] + e * c[f"d{name}_a20_lef"]) + roll + yaw

        pitching = longitudinal("Cm", c["Cm"] * c["eta_stab"] + c["dCm"])
        forces = longitudinal("CX", c["CX"]), lateral("CY"), longitudinal("CZ", c["CZ"])
        return jnp.stack([*forces, lateral("Cl"), pitching, lateral("Cn")])

    def flap_position(self, signals: Mapping[str, Float[Array, ""]]) -> Float[Array, ""]:
        """Return the position of the leading-edge flap [rad], fixed or by the schedule from
        `alpha`, `qbar` and `pressure`.
        """
        if self.flap is not None:
            return self.flap
        pressure = signals["qbar"] / signals["pressure"]
        return jnp.clip(
            1.38 * signals["alpha"] + math.radians(1.45) - math.radians(9.05) * pressure, 0.0, FLAP
        )

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return self.basic.limits

    @property
    def hard_limits(self) -> dict[str, tuple[float, float]]:
        return self.basic.hard_limits


def f16(
    *,
    flap_deg: float | None = None,
    xcg: float = 0.35,
    interpolation: Interpolation | str = Interpolation.LINEAR,
    extrapolation: Extrapolation | str = Extrapolation.HOLD,
) -> Airframe:
    """Return the F-16 of NASA TP-1538 (Nguyen et al., 1979), low speed, -20 to 90 deg in alpha and
    -30 to 30 deg in beta.

    Args:
        flap_deg: leading-edge flap, 0 to 25 [deg]; None for its schedule.
        xcg: centre of gravity as a fraction of the chord; the tables refer to 0.35.
        interpolation: between knots, see `Table`.
        extrapolation: beyond the knots.
    """
    flap = None if flap_deg is None else math.radians(flap_deg)
    aerodynamics = F16Aerodynamics(
        read_coefficients(DATA / "f16"),
        flap=flap,
        interpolation=interpolation,
        extrapolation=extrapolation,
    )
    return f16_airframe("f16", aerodynamics, xcg)


def f16_airframe(name: str, aerodynamics: AbstractAerodynamics, xcg: float) -> Airframe:
    """Return the F-16 with mass, size and stops of TP-1538 and one of its sets of tables."""
    cbar = ft(11.32)
    ranges = {signal: aerodynamics.limits[signal] for signal in ("alpha", "beta")}
    return Airframe(
        name=name,
        mass_properties=mass_properties(
            weight_lb=20500.0, Ix=9496.0, Iy=55814.0, Iz=63100.0, Ixz=982.0
        ),
        S=ft2(300.0),
        b=ft(30.0),
        cbar=cbar,
        aerodynamics=aerodynamics,
        reference=((xcg - 0.35) * cbar, 0.0, 0.0),
        limits=angles(stabilator=(-25.0, 25.0), aileron=(-21.5, 21.5), rudder=(-30.0, 30.0)),
        trusted=ranges,
    )


def _differences(grids: Mapping[str, GridData]) -> tuple[dict[str, GridData], dict[str, GridData]]:
    """Return basic tables and increments; an increment that the source tabulates as a total is the
    total less the basic table.
    """
    basic = {
        name: grid
        for name, grid in grids.items()
        if "_lef" not in name and not name.endswith(("_a20", "_r30"))
    }
    increments = {
        name: grid for name, grid in grids.items() if name.startswith("d") and name.endswith("_lef")
    }
    for name in ("CX", "CY", "CZ", "Cl", "Cm", "Cn"):
        grid = grids[f"{name}_lef"]
        # The knots in alpha of the flap tables are the first of the basic tables.
        clean, rows = _undeflected(grids[name]), len(grid.knots[0])
        increments[f"d{name}_lef"] = grid._replace(values=grid.values - clean[:rows])
        if name in ("CY", "Cl", "Cn"):
            for end in ("a20", "r30"):
                total = grids[f"{name}_{end}"]
                basic[f"d{name}_{end}"] = total._replace(values=total.values - clean)
            values = (
                grids[f"{name}_a20_lef"].values - grid.values - basic[f"d{name}_a20"].values[:rows]
            )
            increments[f"d{name}_a20_lef"] = grid._replace(values=values)
    return basic, increments


def _undeflected(grid: GridData) -> np.ndarray:
    """Return the values over alpha and beta at zero stabilator."""
    return grid.values[..., grid.knots[2].index(0.0)] if len(grid.knots) == 3 else grid.values
