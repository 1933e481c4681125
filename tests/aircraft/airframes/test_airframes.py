"""Airframes of the package against the numbers of their sources and known properties."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid.aircraft.airframes import f4, f4_origins, f16, f16_low, f16_thrust
from jaxid.aircraft.vehicle.aerodynamics import COEFFICIENTS
from jaxid.models.names import parameter_names

ANGLES = ("alpha", "beta", "stabilator", "aileron", "rudder")
RATES = ("phat", "qhat", "rhat")

# Targets of the tables of `f4` at the mean alpha of the report's runs [deg]: the value of the
# table, linear between its knots, and the report's estimate (Tables 6.3, 6.5, 6.11, 6.12, 6.14 to
# 6.16; regression or maximum likelihood).
REPORT = [
    *[("CX", "1", 11.55, -0.01646, -0.0149), ("CX", "stabilator", 11.55, 0.08306, 0.0856)],
    *[
        ("CZ", "1", 11.55, -0.7552, -0.760),
        ("CZ", "1", 12.75, -0.8207, -0.824),
        ("CZ", "1", 15.8, -0.9646, -0.965),
    ],
    *[("CZ", "stabilator", 11.55, -0.2946, -0.213), ("CZ", "qhat", 15.8, -11.89, -11.8)],
    *[
        ("Cm", "1", 11.55, -0.0431, -0.0442),
        ("Cm", "1", 12.75, -0.04475, -0.0426),
        ("Cm", "1", 15.8, -0.04146, -0.0447),
    ],
    *[("Cm", "stabilator", 11.55, -0.4513, -0.453), ("Cm", "stabilator", 15.8, -0.497, -0.500)],
    *[("Cm", "qhat", 11.55, -5.672, -5.52), ("Cm", "qhat", 15.8, -6.564, -6.19)],
    *[("Cl", "aileron", 12.75, -0.0395, -0.0401), ("Cl", "aileron", 18.0, -0.028, -0.0268)],
    *[
        ("Cl", "rudder", 18.0, 0.0054, 0.00356),
        ("Cl", "phat", 20.6, 0.029, 0.0372),
        ("Cl", "phat", 12.75, -0.155, -0.176),
    ],
    *[
        ("Cn", "rudder", 12.75, -0.04735, -0.0437),
        ("Cn", "rudder", 17.4, -0.046, -0.0499),
        ("Cn", "rudder", 18.0, -0.0456, -0.0418),
    ],
    *[
        ("Cn", "aileron", 18.0, 0.00854, 0.00687),
        ("Cn", "phat", 20.6, -0.06925, -0.0685),
        ("CY", "rudder", 12.75, 0.074, 0.0599),
    ],
    *[("Cn", "rhat", 17.4, -0.3878, -0.426)],
]
# Beta slopes: the table's own lie on secants of 5 deg, the fit's on a curve; hence the tolerance of
# 7 % below.
BETA_SLOPES = [
    *[("CY", 12.75, -0.574), ("CY", 17.4, -0.5232), ("CY", 18.0, -0.5187), ("CY", 20.6, -0.5032)],
    *[
        ("Cl", 12.75, -0.1169),
        ("Cl", 17.4, -0.08192),
        ("Cl", 18.8, -0.07661),
        ("Cl", 20.6, -0.06092),
    ],
    *[("Cn", 12.75, 0.1175), ("Cn", 17.4, 0.06818), ("Cn", 18.0, 0.05846), ("Cn", 18.8, 0.04532)],
]
# Stevens and Lewis, App. A, at alpha 10, |beta| 10 (increments: beta -10), elevator -12 deg.
CELLS = {
    **{
        "CX": 0.016,
        "CXq": 2.08,
        "CYp": 0.258,
        "CYr": 0.962,
        "CZ": -0.731,
        "CZq": -31.2,
        "Cl": -0.03,
        "Clp": -0.383,
    },
    **{"Clr": 0.208, "Cm": 0.11, "Cmq": -6.11, "Cn": 0.043, "Cnp": -0.013, "Cnr": -0.37},
    **{"dCl_da20": -0.049, "dCl_dr30": 0.011, "dCn_da20": -0.005, "dCn_dr30": -0.04},
}


def at(
    alpha=0.0,
    beta=0.0,
    stabilator=0.0,
    aileron=0.0,
    rudder=0.0,
    phat=0.0,
    qhat=0.0,
    rhat=0.0,
    qbar=0.0,
):
    """Signals as one vector, from degrees where they are angles; the pressure is one."""
    return jnp.array(
        [*np.deg2rad([alpha, beta, stabilator, aileron, rudder]), phat, qhat, rhat, qbar]
    )


@jax.jit
def coefficients(aerodynamics, point):
    names = dict(zip((*ANGLES, *RATES, "qbar"), point, strict=True))
    return aerodynamics.coefficients(names | {"pressure": jnp.ones(())})


@jax.jit
def slopes(aerodynamics, point):
    return jax.jacfwd(coefficients, argnums=1)(aerodynamics, point)


def slope(aerodynamics, coefficient, signal, **point):
    table = slopes(aerodynamics, at(**point))
    return float(table[COEFFICIENTS.index(coefficient), (*ANGLES, *RATES).index(signal)])


@pytest.fixture(scope="module")
def monotone():
    return f4().aerodynamics


@pytest.fixture(scope="module")
def straight():
    return f4(interpolation="linear").aerodynamics


@pytest.fixture(scope="module")
def tunnel():
    """TP-1538 with the flap down, where the basic tables stand alone."""
    return f16(flap_deg=25.0).aerodynamics


@pytest.fixture(scope="module")
def book():
    return f16_low().aerodynamics


@pytest.mark.parametrize(("coefficient", "term", "alpha", "table", "report"), REPORT)
def test_f4_has_numbers_of_report(straight, monotone, coefficient, term, alpha, table, report):
    for aerodynamics, tolerance in (
        (straight, 5e-4),
        (monotone, 0.15),
    ):  # four digits are given; the curve departs from the line
        if term == "1":
            value = float(coefficients(aerodynamics, at(alpha))[COEFFICIENTS.index(coefficient)])
        else:
            value = slope(aerodynamics, coefficient, term, alpha=alpha)
        np.testing.assert_allclose(value, table, rtol=tolerance)
    np.testing.assert_allclose(
        table, report, rtol=0.55
    )  # its estimates scatter by as much between regression and likelihood


@pytest.mark.parametrize(("coefficient", "alpha", "table"), BETA_SLOPES)
def test_f4_has_slopes_by_beta(monotone, coefficient, alpha, table):
    np.testing.assert_allclose(slope(monotone, coefficient, "beta", alpha=alpha), table, rtol=0.07)


def test_f4_has_stability_changes_of_report(monotone):
    # Section 3.3.1: Cn_beta changes its sign between 15 and 25 deg; Cl_p is near zero at 15 deg;
    # pitch-up near the stall.
    assert slope(monotone, "Cn", "beta", alpha=15.0) > 0.05
    assert slope(monotone, "Cn", "beta", alpha=25.0) < -0.01
    assert abs(slope(monotone, "Cl", "phat", alpha=15.0)) < 0.03
    assert slope(monotone, "Cl", "phat", alpha=5.0) < -0.2
    pitching = [
        slope(monotone, "Cm", "alpha", alpha=alpha) for alpha in (10.0, 13.5, 14.5, 15.5, 19.0)
    ]
    assert pitching[0] < 0
    assert min(pitching[1:4]) > 0
    assert pitching[4] < 0
    for coefficient, surface in (("Cm", "stabilator"), ("Cl", "aileron"), ("Cn", "rudder")):
        assert slope(monotone, coefficient, surface, alpha=12.0) < 0
    assert slope(monotone, "CY", "rudder", alpha=12.0) > 0


def test_f4_is_differentiable_across_knots(monotone):
    step = 1e-6
    for alpha in (11.0, 12.5, 15.0, 17.3):
        for beta in (0.3, 4.0):
            point = at(alpha, beta, -3.0, 2.0, 1.0, 0.01, 0.01, -0.01)
            exact = slopes(monotone, point)[:, 0]
            ahead = coefficients(monotone, point.at[0].add(step)) - coefficients(
                monotone, point.at[0].add(-step)
            )
            # curvature jumps at a knot
            np.testing.assert_allclose(exact, ahead / (2 * step), rtol=0, atol=1e-4)


def test_f4_origins_name_parameters_and_classes():
    known = f4_origins()
    names = {name.removeprefix("aerodynamics.") for name in parameter_names(f4())}
    assert set(known) <= names
    assert {origin[0] for origin in known.values()} == set("MRBIE")
    assert known["Cmds.alpha=110"].startswith("E")
    assert len(known) == 6 * 26 * 15 + 21 * 26


def test_airframes_are_in_si_units():
    airframe = f4()
    assert airframe.limits["stabilator"] == (np.deg2rad(-21.0), np.deg2rad(9.0))
    assert airframe.trusted == {"alpha": (np.deg2rad(5.0), np.deg2rad(21.0))}
    np.testing.assert_allclose(airframe.mass_properties.mass, 17655.6, rtol=1e-5)  # 38,924 lb
    np.testing.assert_allclose(
        [airframe.S, airframe.b, airframe.cbar], [49.239, 11.787, 4.889], rtol=1e-4
    )  # TM-2003-212145
    inertia = f16(xcg=0.30).mass_properties.inertia()
    # TP-1538 [kg m^2]
    np.testing.assert_allclose(jnp.diag(inertia), [12874.8, 75673.6, 85552.1], rtol=1e-5)
    np.testing.assert_allclose(inertia[0, 2], -1331.4, rtol=1e-4)
    np.testing.assert_allclose(
        f16(xcg=0.30).reference, [-0.05 * 11.32 * 0.3048, 0.0, 0.0], rtol=1e-12
    )


def test_f16_has_stability_of_tunnel_data(tunnel):
    # Between -4 and 4 deg of beta.
    secant = [
        float((coefficients(tunnel, at(a, 4.0)) - coefficients(tunnel, at(a, -4.0)))[5])
        for a in (0, 10, 22, 28.5, 30, 45)
    ]
    Cn_beta = np.array(secant) / np.deg2rad(8.0)
    np.testing.assert_allclose(Cn_beta[:3], [0.20, 0.21, 0.12], atol=0.005)
    assert Cn_beta[3] > 0 > Cn_beta[4]
    np.testing.assert_allclose(Cn_beta[5], -0.41, atol=0.005)
    assert slope(tunnel, "Cl", "phat", alpha=10.0) < 0 < slope(tunnel, "Cl", "phat", alpha=45.0)
    np.testing.assert_allclose(coefficients(tunnel, at(90.0))[4], -0.56, atol=0.01)


def test_f16_totals_equal_source(tunnel):
    # Cells of TP-1538 at knots: the total with flap, aileron or rudder comes back from the
    # increments.
    up = f16(flap_deg=0.0).aerodynamics
    total = coefficients(up, at(10.0))
    np.testing.assert_allclose([total[0], total[2]], [0.0099, -0.774], rtol=1e-12)  # CX_lef, CZ_lef
    with_aileron = coefficients(tunnel, at(10.0, aileron=20.0))
    np.testing.assert_allclose(
        with_aileron[jnp.array([1, 3, 5])], [0.0229, -0.0501, -0.009], rtol=1e-12
    )
    with_rudder = coefficients(tunnel, at(10.0, rudder=30.0))
    np.testing.assert_allclose(
        with_rudder[jnp.array([1, 3, 5])], [0.0796, 0.0135, -0.0441], rtol=1e-12
    )
    # Cm: -0.0437 basic, and dCm at 10 deg.
    np.testing.assert_allclose(
        coefficients(up, at(10.0))[4] - coefficients(tunnel, at(10.0))[4],
        -0.0016 + 0.0437,
        rtol=1e-12,
    )


def test_f16_flap_follows_its_schedule():
    scheduled = f16().aerodynamics
    ratio = 0.11
    expected = 1.38 * 10.0 + 1.45 - 9.05 * ratio
    fixed = coefficients(f16(flap_deg=expected).aerodynamics, at(10.0, 3.0, qhat=0.01))
    np.testing.assert_allclose(
        coefficients(scheduled, at(10.0, 3.0, qhat=0.01, qbar=ratio)), fixed, rtol=1e-12
    )
    down = coefficients(f16(flap_deg=25.0).aerodynamics, at(40.0, 3.0))
    np.testing.assert_allclose(coefficients(scheduled, at(40.0, 3.0, qbar=ratio)), down, rtol=1e-12)


def test_f16_low_equals_sum_by_hand(book):
    p, q, r = 0.02, 0.01, -0.03
    values = coefficients(book, at(10.0, -10.0, -12.0, 10.0, -15.0, p, q, r))
    beta = np.deg2rad(-10.0)
    expected = [
        CELLS["CX"] + CELLS["CXq"] * q,
        -0.02 * -10 + 0.021 * 0.5 + 0.086 * -0.5 + CELLS["CYp"] * p + CELLS["CYr"] * r,
        CELLS["CZ"] * (1 - beta**2) - 0.19 * -12 / 25 + CELLS["CZq"] * q,
        -CELLS["Cl"]
        + 0.5 * CELLS["dCl_da20"]
        - 0.5 * CELLS["dCl_dr30"]
        + CELLS["Clp"] * p
        + CELLS["Clr"] * r,
        CELLS["Cm"] + CELLS["Cmq"] * q,
        -CELLS["Cn"]
        + 0.5 * CELLS["dCn_da20"]
        - 0.5 * CELLS["dCn_dr30"]
        + CELLS["Cnp"] * p
        + CELLS["Cnr"] * r,
    ]
    np.testing.assert_allclose(values, expected, rtol=1e-12)


def test_f16_low_has_signs_of_library_and_extrapolates_linearly(book):
    for coefficient, surface in (("Cm", "stabilator"), ("Cl", "aileron"), ("Cn", "rudder")):
        assert slope(book, coefficient, surface, alpha=5.0) < 0
    assert slope(book, "CY", "rudder", alpha=5.0) > 0
    edge, beyond, inside = (coefficients(book, at(alpha)) for alpha in (45.0, 47.0, 43.0))
    np.testing.assert_allclose(beyond - edge, edge - inside, rtol=0, atol=1e-12)


def test_f16_thrust_is_in_newtons():
    # 10,000 ft: -170, 9839 and 18910 lbf
    thrust = f16_thrust()({"altitude": jnp.array(3048.0), "mach": jnp.array(0.6)})
    np.testing.assert_allclose(
        thrust, np.array([-170.0, 9839.0, 18910.0]) * 4.4482216152605, rtol=1e-12
    )
