"""`solve_equilibrium`: exact roots, limits, derivatives through the root, batches, and messages
of failures.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid._foundation.results import RESULTS
from jaxid.aircraft.flight.longitudinal_flight import LONGITUDINAL_SPEED, level_trim, true_aircraft
from jaxid.models.free import with_values
from jaxid.simulation import solve_equilibrium

NAMES = {
    "names": ("x", "y"),
    "equations": ("circle", "line"),
    "units": ("m", ""),
    "equation_units": ("m^2", ""),
}
LIMITS = {"lower": np.array([0.0, -3.0]), "upper": np.array([3.0, 3.0])}


def circle_and_line(x, args):
    """Circle of radius `args` and the diagonal: x = y = args/sqrt(2)."""
    return jnp.stack([x[0] ** 2 + x[1] ** 2 - args**2, x[0] - x[1]])


# From here the search ends on the limit x = 0, at y = -radius/sqrt(2), a minimum but no root.
TRAP = np.array([0.1, -2.0])


def solve_circle(radius, start=((2.5, 0.1),), **options):
    return solve_equilibrium(
        circle_and_line, jnp.array(start), jnp.asarray(radius, float), **NAMES, **LIMITS, **options
    )


def rates(unknown, model):
    """Return the rates of the longitudinal aircraft in level flight at SPEED.

    The unknowns are angle of attack, elevator and thrust.
    """
    alpha, elevator, thrust = unknown
    trimmed = with_values(model, ("thrust",), thrust[None])
    state = jnp.stack(
        [
            LONGITUDINAL_SPEED * jnp.cos(alpha),
            LONGITUDINAL_SPEED * jnp.sin(alpha),
            jnp.zeros(()),
            alpha,
        ]
    )
    return trimmed.rhs(jnp.zeros(()), state, elevator[None])[:3]


def level(model, thrust_limit=80e3, start=(-0.2, -0.4, 0.0), **options):
    return solve_equilibrium(
        rates,
        jnp.array(start),
        model,
        names=("alpha", "elevator", "thrust"),
        equations=("udot", "wdot", "qdot"),
        units=("rad", "rad", "N"),
        equation_units=("m/s^2", "m/s^2", "rad/s^2"),
        lower=jnp.array([-0.5, -0.6, 0.0]),
        upper=jnp.stack([jnp.array(0.8), jnp.array(0.3), jnp.asarray(thrust_limit, float)]),
        **options,
    )


def test_root_equals_exact_solution():
    trim = solve_circle(1.0)
    np.testing.assert_allclose(trim.values, np.sqrt(0.5), rtol=1e-14)
    np.testing.assert_allclose(trim.residuals, 0.0, atol=1e-14)
    assert bool(trim.successful)
    assert trim.value("y") == trim.values[1]
    assert trim.residual("line") == trim.residuals[1]
    assert "status: balanced" in str(trim)


def test_root_without_limits_and_with_scales_is_exact():
    """Kepler's equation and a linear equation of another size, without limits."""

    def kepler(x, _):
        return jnp.stack([x[0] - 0.5 * jnp.sin(x[0]) - 1.0, 1e6 * x[1] - 3.0])

    names = {"names": ("E", "small"), "equations": ("anomaly", "other")}
    trim = solve_equilibrium(
        kepler,
        jnp.zeros(2),
        **names,
        scale=np.array([1.0, 1e-6]),
        equation_scale=np.array([1.0, 1.0]),
    )
    # Newton's method in 50 digits
    np.testing.assert_allclose(trim.value("E"), 1.4987011335178481, rtol=1e-14)
    np.testing.assert_allclose(trim.value("small"), 3e-6, rtol=1e-14)


def test_failed_case_of_batch_does_not_affect_others():
    """The largest circle with a root inside the limits has the radius 3 sqrt(2) = 4.24."""
    trim = jax.vmap(solve_circle)(jnp.array([1.0, 5.0, 2.0]))
    np.testing.assert_array_equal(trim.successful, [True, False, True])
    np.testing.assert_allclose(
        trim.values[::2], np.sqrt(0.5) * np.array([[1.0, 1.0], [2.0, 2.0]]), rtol=1e-13
    )
    np.testing.assert_allclose(trim.values[1], 3.0, rtol=1e-3)
    assert str(trim) == "Trim of 3 cases, 2 balanced: x, y"


def test_failure_message_names_equation_and_limit():
    with pytest.raises(
        InputError, match=r"circle is out of balance by -7 m\^2.*x stands at its upper limit, 3 m"
    ) as raised:
        solve_circle(5.0, remedy="Ask for a smaller circle.")
    assert str(raised.value).endswith("Ask for a smaller circle.")
    assert bool(solve_circle(5.0, throw=False).result == RESULTS.unbalanced)


def test_failure_message_without_limit_names_no_limit():
    def no_root(x, _):
        return 1.0 + x**2

    with pytest.raises(
        InputError, match="square is out of balance by 1; no unknown stands at a limit"
    ):
        solve_equilibrium(no_root, jnp.ones(1), names=("x",), equations=("square",))


def test_nonfinite_equation_is_named_in_message():
    def broken(x, _):
        return jnp.log(x) - 100.0 * jnp.nan

    with pytest.raises(InputError, match=r"log cannot be computed .* at x = 1"):
        solve_equilibrium(broken, jnp.ones(1), names=("x",), equations=("log",))


def test_first_successful_start_determines_root():
    """Starts at 2 and -3 are near different roots of the cubic; the first one counts."""

    def cubic(x, _):
        return (x - 1.0) * (x + 2.0) * (x + 0.5)

    starts = jnp.array([[2.0], [-3.0]])
    roots = [
        solve_equilibrium(cubic, order, names=("x",), equations=("cubic",)).values[0]
        for order in (starts, starts[::-1])
    ]
    np.testing.assert_allclose(roots, [1.0, -2.0], rtol=1e-14)


def test_start_without_root_is_abandoned():
    """The search ends at a relative fall of the cost of 1e-9, an accuracy of some 1e-5."""
    trapped = solve_circle(1.0, TRAP, throw=False)
    np.testing.assert_allclose(trapped.values, [0.0, -np.sqrt(0.5)], rtol=1e-4)
    np.testing.assert_array_equal(trapped.at_limit, [True, False])
    trim = solve_circle(1.0, (TRAP, (2.5, 0.1)))
    np.testing.assert_allclose(trim.values, np.sqrt(0.5), rtol=1e-14)
    assert trim.steps > trapped.steps
    lost = solve_circle(1.0, (TRAP, TRAP), throw=False)
    np.testing.assert_allclose(lost.values, trapped.values, rtol=1e-6)


def test_inconsistent_arguments_are_refused():
    with pytest.raises(InputError, match="2 unknowns, but 1 equations"):
        solve_equilibrium(
            circle_and_line, jnp.zeros(2), jnp.ones(()), names=("x", "y"), equations=("circle",)
        )
    with pytest.raises(InputError, match="limits of 'x' are empty: 3 is not below 0"):
        solve_equilibrium(
            circle_and_line,
            jnp.zeros(2),
            jnp.ones(()),
            **NAMES,
            lower=LIMITS["upper"],
            upper=LIMITS["lower"],
        )
    with pytest.raises(InputError, match="'x' has one limit, 0 to inf"):
        solve_equilibrium(
            circle_and_line, jnp.zeros(2), jnp.ones(()), **NAMES, lower=LIMITS["lower"]
        )
    with pytest.raises(InputError, match="3 values for 2 unknowns"):
        solve_equilibrium(circle_and_line, jnp.zeros(3), jnp.ones(()), **NAMES)


# The aircraft


def test_level_flight_from_poor_start_equals_newton_from_good_start():
    model = true_aircraft()
    state, elevator, thrust = level_trim(model, LONGITUDINAL_SPEED)
    trim = level(model)
    np.testing.assert_allclose(
        trim.values, [np.arctan2(state[1], state[0]), elevator, thrust], rtol=1e-12
    )
    assert not np.any(trim.at_limit)


def test_aircraft_without_enough_thrust_is_out_of_balance_by_missing_force():
    """The force along the flight path is out of balance by the missing thrust."""
    needed = level(true_aircraft()).value("thrust")
    with pytest.raises(
        InputError,
        match=r"udot is out of balance by -0\.3.* thrust stands at its "
        r"upper limit",
    ):
        level(true_aircraft(), float(needed) - 6000.0)


def test_derivatives_through_root_equal_finite_differences():
    """Central differences with a relative step of 1e-4 are accurate to some 1e-8."""
    model, names = true_aircraft(), ("mass", "CZ.alpha", "Cm.elevator", "CX.1")
    values = jnp.array([17700.0, -3.2, -0.55, -0.02])

    @jax.jit
    def trimmed(values):
        return level(with_values(model, names, values)).values

    exact = jax.jit(jax.jacfwd(trimmed))(values)
    reverse = jax.jit(jax.jacrev(trimmed))(values)
    for column, value in enumerate(values):
        step = 1e-4 * abs(value)
        plus, minus = (trimmed(values.at[column].add(sign * step)) for sign in (1, -1))
        np.testing.assert_allclose(
            exact[:, column], (plus - minus) / (2 * step), rtol=1e-6, atol=1e-10
        )
    np.testing.assert_allclose(reverse, exact, rtol=1e-10)
