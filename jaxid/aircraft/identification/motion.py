"""`RigidMotion`: the equations of Appendix E, solved for rates or for coefficients."""

from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._foundation.types import Array, Float
from ..air.atmosphere import GRAVITY, AbstractAtmosphere
from ..air.turbulence import GUSTS
from ..instruments.channels import ANGULAR, FLOW, FORCE, RATES
from ..instruments.inverse import air_of
from ..physics.frames import air_angle_rates, downwards, euler_rates
from ..physics.rigid_body import solve_3x3, specific_force
from ..vehicle.aerodynamics import COEFFICIENTS
from ..vehicle.air_relative import flow
from ..vehicle.airframe import Airframe, aerodynamic_loads
from ..vehicle.engine import Engine, loads
from ..vehicle.force_derivatives import effectiveness
from .channels import Channels
from .frames import Translation
from .rate_signals import RATE_SIGNALS, needed_rates, propagated_rates, solve_2x2

Signals = dict[str, Float[Array, ""]]


class RigidMotion(eqx.Module):
    """Equations of motion of `IdentificationModel`; some of them may be left out.

    Args:
        airframe: mass, size and aerodynamics.
        held: constants that replace states or inputs, by name [SI].
        engines: engines; they share a measured or held thrust, otherwise their thrust is computed
            from the signals.
        atmosphere: properties of the air at an altitude.
        channels: names of states, inputs and constants.
    """

    airframe: Airframe
    held: dict[str, Float[Array, ""]]
    engines: tuple[Engine, ...]
    atmosphere: AbstractAtmosphere
    channels: Channels = eqx.field(static=True)

    def flow(self, x: Float[Array, " state"], u: Float[Array, " input"]) -> Signals:
        """Return the signals of an instant that do not depend on accelerations.

        Args:
            x: state.
            u: input.

        Returns:
            States, inputs and constants, `u v w`, the signals of `air_relative.flow`, and `thrust`
            [SI].
        """
        states = dict(zip(self.channels.states, x, strict=True))
        known = self.held | states | dict(zip(self.channels.inputs, u, strict=True))
        velocity = self._translation.velocity(_vector(known, self._translation.names))
        signals = known | dict(zip("uvw", velocity, strict=True))
        air_velocity = jnp.stack([known.get(gust, jnp.zeros(())) for gust in GUSTS[:3]])
        through_air = velocity - air_velocity
        signals |= flow(
            self.airframe, air_of(self.atmosphere, known), through_air, _vector(known, RATES)
        )
        return signals | {"thrust": jnp.sum(jnp.stack(self.engine_thrusts(signals)))}

    def coefficient_signals(self, signals: Signals) -> tuple[Float[Array, "6"], Signals]:
        """Return CX to Cn, and the signals with all coefficients by name.

        The rates of alpha and beta follow from the coefficients, and are signals where the model
        propagates the angle. Where terms depend on them, the linear equations of both are solved
        (`C xdot = f`, E.21):

            d = g(C(d)) = g(C(0)) + G d,    (I - G) d = g(C(0)),    d = (alphadot_hat, betadot_hat)

        Args:
            signals: signals from `flow`.

        Raises:
            InputError: if a term is not linear in the rates, or the equation of the angle is not
                propagated.
        """
        aerodynamics = self.airframe.aerodynamics
        if needed_rates(aerodynamics.terms, self.channels):

            def resulting(rates: Float[Array, "2"]) -> Float[Array, "2"]:
                given = signals | dict(zip(RATE_SIGNALS, rates, strict=True))
                vdot, _ = self._accelerations(given, aerodynamics.coefficients(given))
                return self.reduced_air_rates(signals, vdot)

            base, slopes = resulting(jnp.zeros(2)), jax.jacfwd(resulting)(jnp.zeros(2))
            rates = solve_2x2(jnp.eye(2) - slopes, base)
            given = signals | dict(zip(RATE_SIGNALS, rates, strict=True))
            values = aerodynamics.coefficients(given)
        else:
            values = aerodynamics.coefficients(signals)
            rates = self.reduced_air_rates(signals, self._accelerations(signals, values)[0])
        by_name: Signals = dict(zip(RATE_SIGNALS, rates, strict=True))
        known = {name: by_name[name] for name in propagated_rates(self.channels)}
        return values, signals | known | self._named(signals, values)

    def reduced_air_rates(self, signals: Signals, vdot: Float[Array, "3"]) -> Float[Array, "2"]:
        """Return `alphadot cbar/2V` and `betadot b/2V`, with the propagated parts of `vdot` only.

        The velocity of the air is taken as constant.

        Args:
            signals: signals from `flow`.
            vdot: rate of the velocity in body axes [m/s^2].
        """
        velocity = _vector(signals, "uvw")
        rates = self._translation.rates(velocity, vdot)
        propagated = np.array([name in self.channels.states for name in self._translation.names])
        vdot = self._translation.accelerations(velocity, jnp.where(propagated, rates, 0.0))
        alphadot, betadot = air_angle_rates(_vector(signals, FLOW), vdot)
        lengths = jnp.stack([self.airframe.cbar, self.airframe.b])
        return jnp.stack([alphadot, betadot]) * lengths / (2.0 * signals["V"])

    def _named(self, signals: Signals, values: Float[Array, "6"]) -> Signals:
        """Return the coefficients by name, in body axes and in the axes of the model."""
        body = dict(zip(COEFFICIENTS, values, strict=True))
        if self.channels.axes == "body":
            return body
        force = self.channels.force
        turned = force.matrix(signals["alpha"], signals["beta"]).T @ values[:3]
        return dict(zip(force.names, turned, strict=True)) | body

    def engine_thrusts(self, signals: Signals) -> list[Float[Array, ""]]:
        """Return the thrust of each engine [N].

        Args:
            signals: `thrust` if it is measured or held, which the engines share; otherwise the
                signals on which the engines depend.
        """
        if "thrust" in self.channels.inputs or "thrust" in self.held:
            shares = jnp.stack([engine.share for engine in self.engines])
            return list(signals["thrust"] * shares / jnp.sum(shares))
        return [engine.thrust(jnp.zeros(0), signals) for engine in self.engines]

    def rates(self, signals: Signals, coefficients: Float[Array, "6"]) -> Signals:
        """Return the rates of all possible states by name [unit of the state per second].

        Args:
            signals: signals from `flow`.
            coefficients: CX, CY, CZ, Cl, Cm, Cn.
        """
        vdot, omegadot = self._accelerations(signals, coefficients)
        velocity = _vector(signals, "uvw")
        rates = dict(
            zip(self._translation.names, self._translation.rates(velocity, vdot), strict=True)
        )
        rates |= dict(zip(RATES, omegadot, strict=True))
        angle_rates = euler_rates(signals["phi"], signals["pitch"], _vector(signals, RATES))
        rates |= dict(zip(("phi", "pitch", "psi"), angle_rates, strict=True))
        return rates | {"altitude": -jnp.dot(downwards(signals["phi"], signals["pitch"]), velocity)}

    def inertial_signals(self, signals: Signals, dx: Float[Array, " state"]) -> Signals:
        """Return specific forces and angular accelerations at the centre of gravity by name.

        The specific forces are `ax ay az` [m/s^2], the angular accelerations `pdot qdot rdot`
        [rad/s^2].

        Args:
            signals: signals from `flow`.
            dx: rate of the state, including the contributions of effects; for a velocity or rate
                that is not propagated the equations of motion are evaluated.
        """
        given = dict(zip(self.channels.states, dx, strict=True))
        rates = dict(given)
        if not {*self._translation.names, *RATES} <= set(given):
            rates = self.rates(signals, self.coefficient_signals(signals)[0]) | given
        velocity, omega = _vector(signals, "uvw"), _vector(signals, RATES)
        vdot = self._translation.accelerations(velocity, _vector(rates, self._translation.names))
        omegadot = _vector(rates, RATES)
        gravity = GRAVITY * downwards(signals["phi"], signals["pitch"])
        force = specific_force(vdot, omega=omega, velocity=velocity, gravity=gravity)
        return dict(zip((*FORCE, *ANGULAR), jnp.concatenate([force, omegadot]), strict=True))

    def effectiveness(self, signals: Signals) -> Signals:
        """Return the derivatives of the state rates by each coefficient, `p_per_Cl` and so on.

        Args:
            signals: signals from `flow`.
        """
        slopes = effectiveness(
            self.airframe, signals["qbar"], self._inertia(), self._propagated_rates
        )
        velocity = _vector(signals, "uvw")
        translated = jax.vmap(lambda vdot: self._translation.rates(velocity, vdot))(slopes[:, :3])
        columns = dict(zip(self._translation.names, translated.T, strict=True))
        columns |= dict(zip(RATES, slopes[:, 3:].T, strict=True))
        return {
            f"{state}_per_{coefficient}": slope
            for state, column in columns.items()
            if state in self.channels.states
            for coefficient, slope in self._named(signals, column).items()
        }

    def coefficients(self, true: Mapping[str, Float[Array, ""]]) -> tuple[Signals, Signals]:
        """Return the coefficients that satisfy the equations of motion.

        They are the responses of `IdentificationModel.pseudo_measurements`.

        Args:
            true: `u v w`, rates, angular accelerations and specific forces at the centre of
                gravity, surfaces, and the signals that determine air and engines [SI]. A missing
                specific force counts as zero. A measured `qbar` precedes `density V^2/2`.

        Returns:
            The six coefficients in the axes of the model, and all signals of the instant, with the
            reduced rates of alpha and beta if the attitude is known.
        """
        airframe, mass = self.airframe, self.airframe.mass_properties
        velocity, omega, omegadot = (
            _vector(true, "uvw"),
            _vector(true, RATES),
            _vector(true, ANGULAR),
        )
        signals = dict(true) | flow(airframe, air_of(self.atmosphere, true), velocity, omega)
        if "qbar" in true:
            measured = jnp.isfinite(true["qbar"])
            signals["qbar"] = jnp.where(measured, true["qbar"], signals["qbar"])
        thrusts = self.engine_thrusts(signals)
        signals |= {"thrust": jnp.sum(jnp.stack(thrusts))}
        engine_force, engine_moment, momentum = loads(self.engines, thrusts)
        acceleration = jnp.stack([true.get(name, jnp.zeros(())) for name in FORCE])
        force = mass.mass * acceleration - engine_force
        inertia = mass.inertia()
        moment = inertia @ omegadot + jnp.cross(omega, inertia @ omega + momentum) - engine_moment
        moment = moment - jnp.cross(airframe.reference, force)
        pressure_area = signals["qbar"] * airframe.S
        values = jnp.concatenate([force, moment / airframe.lengths]) / pressure_area
        if {"phi", "pitch"} <= set(signals):
            gravity = GRAVITY * downwards(signals["phi"], signals["pitch"])
            vdot = acceleration + gravity - jnp.cross(omega, velocity)
            rates = self.reduced_air_rates(signals, vdot)
            signals |= dict(zip(RATE_SIGNALS, rates, strict=True))
        return self._named(signals, values), signals

    def known_coefficients(self, signals: Signals) -> Signals:
        """Return the part of each coefficient that has no terms, such as tables, by name.

        Args:
            signals: all signals of an instant.
        """
        known = self.airframe.aerodynamics.known(signals)
        return {} if known is None else self._named(signals, known)

    @property
    def _translation(self) -> Translation:
        return self.channels.translation

    def _accelerations(
        self, signals: Signals, coefficients
    ) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Return the accelerations; measured or held ones for rates that are not propagated."""
        mass = self.airframe.mass_properties
        omega, velocity = _vector(signals, RATES), _vector(signals, "uvw")
        force, moment = aerodynamic_loads(self.airframe, signals["qbar"], coefficients)
        thrusts = self.engine_thrusts(signals)
        engine_force, engine_moment, momentum = loads(self.engines, thrusts)
        gravity = GRAVITY * downwards(signals["phi"], signals["pitch"])
        vdot = (force + engine_force) / mass.mass + gravity - jnp.cross(omega, velocity)
        net = moment + engine_moment - jnp.cross(omega, mass.inertia() @ omega + momentum)
        given = jnp.stack([signals.get(name, jnp.zeros(())) for name in ANGULAR])
        return vdot, solve_3x3(self._inertia(), jnp.where(self._propagated_rates, net, given))

    @property
    def _propagated_rates(self) -> np.ndarray:
        """True for each angular rate that is propagated."""
        return np.array([name in self.channels.states for name in RATES])

    def _inertia(self) -> Float[Array, "3 3"]:
        """Return the inertia tensor, with a unit row for each rate that is not propagated."""
        rows = np.tile(self._propagated_rates[:, None], 3)
        return jnp.where(rows, self.airframe.mass_properties.inertia(), jnp.eye(3))


def _vector(signals: Mapping[str, Float[Array, ""]], names: Sequence[str]) -> Float[Array, "3"]:
    return jnp.stack([signals[name] for name in names])
