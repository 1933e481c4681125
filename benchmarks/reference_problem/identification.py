"""The same problem with the aircraft of the package, `jaxid.aircraft.IdentificationModel`.

The mathematical problem is that of `aircraft`: the air is at rest with the same density, the thrust
acts at the centre of gravity, the instruments have no errors, and the initial state follows from
the first sample, which has no noise. It computes more on the way: Mach number, the signals that
effects may use, and the specific force from the rates of the state.
"""

import jax.numpy as jnp

import jaxid
from benchmarks.reference_problem import problem
from benchmarks.reference_problem.problem import ReferenceProblem
from jaxid.aircraft.identification.model import IdentificationModel
from jaxid.aircraft.physics.mass import MassProperties
from jaxid.aircraft.vehicle.aerodynamics_polynomial import PolynomialAerodynamics
from jaxid.aircraft.vehicle.airframe import Airframe
from jaxid.models.polynomial import Polynomial

# Stops of the controls [rad]; they do not act here.
LIMITS = {name: (-1.0, 1.0) for name in problem.INPUTS}


def package_model(
    given: ReferenceProblem, theta, further: tuple[str, ...] = ()
) -> IdentificationModel:
    """Return the package's aircraft with coefficients `theta`, shape (30,).

    Each polynomial has the terms `further` as well, with coefficients of zero.
    """
    values = iter(float(value) for value in theta)
    polynomials = {
        name: Polynomial({term: next(values) for term in terms} | dict.fromkeys(further, 0.0))
        for name, terms in problem.TRUE.items()
    }
    airframe = Airframe(
        name="reference",
        mass_properties=MassProperties(mass=problem.MASS, **problem.INERTIA),
        S=problem.AREA,
        b=problem.SPAN,
        cbar=problem.CHORD,
        aerodynamics=PolynomialAerodynamics(polynomials),
        limits=LIMITS,
    )
    held = {
        "altitude": problem.ALTITUDE,
        "density": problem.DENSITY,
        "thrust": given.constants.thrust,
    }
    return IdentificationModel(
        airframe,
        held={name: jnp.asarray(value) for name, value in held.items()},
        outputs=problem.OUTPUTS,
        airspeed="true",
        beta="sideslip",
    )


def package_free(model: IdentificationModel) -> jaxid.Free:
    """Return the selection of the 30 coefficients, in the order of `problem.NAMES`."""
    return jaxid.free(model, *problem.NAMES)
