"""Polynomial and table aerodynamics against sums by hand; errors on invalid folders and names."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_airframe import small_airframe

from jaxid._foundation.checks import InputError
from jaxid.aircraft import Aircraft, IdentificationModel, MeasuredSurfaces
from jaxid.aircraft.vehicle.aerodynamics import COEFFICIENTS
from jaxid.aircraft.vehicle.aerodynamics_increments import AerodynamicsWithIncrements
from jaxid.aircraft.vehicle.aerodynamics_polynomial import PolynomialAerodynamics
from jaxid.aircraft.vehicle.aerodynamics_tables import TableAerodynamics, origins, read_coefficients
from jaxid.models.names import parameter_names
from jaxid.models.polynomial import Polynomial

SIGNALS = {
    name: jnp.array(value)
    for name, value in {
        **{"alpha": 0.2, "beta": -0.1, "stabilator": 0.05, "aileron": 0.03, "rudder": -0.02},
        **{"phat": 0.01, "qhat": 0.004, "rhat": -0.006},
    }.items()
}
FILES = {
    "Cm.csv": "alpha_rad,beta_rad,Cm,origin\n0,-1,0,M\n0,1,2,M\n1,-1,10,E\n1,1,12,R\n",
    "Cmq.csv": "alpha_rad,Cmq\n0,-5\n1,-6\n",
    "Cmds.csv": "alpha_rad,Cmds\n0,-0.4\n1,-0.5\n",
    "Clp.csv": "alpha_rad,beta_rad,Clp\n0,-1,-0.3\n0,1,-0.3\n1,-1,-0.1\n1,1,-0.1\n",
    "Cnr.csv": "alpha_rad,Cnr\n0,-0.3\n2,-0.1\n",
    "Clda.csv": "alpha_deg,Clda\n0,-0.05\n90,-0.05\n",
    "CYdr.csv": "alpha_rad,CYdr\n0,0.1\n1,0.1\n",
}


@pytest.fixture
def folder(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def test_polynomials_equal_sums_by_hand():
    aerodynamics = PolynomialAerodynamics(
        {
            "Cm": {"1": 0.1, "alpha^2": 2.0, "stabilator": -0.5},
            "Cn": Polynomial({"beta": 0.1, "alpha beta": 1.0}),
        },
        limits={"alpha": (0.0, 0.3)},
    )
    coefficients = aerodynamics.coefficients(SIGNALS)
    np.testing.assert_allclose(
        coefficients, [0, 0, 0, 0, 0.1 + 2 * 0.04 - 0.025, -0.01 - 0.02], rtol=1e-14
    )
    assert parameter_names(aerodynamics) == (
        "Cm.1",
        "Cm.alpha^2",
        "Cm.stabilator",
        "Cn.beta",
        "Cn.alpha beta",
    )
    assert (aerodynamics.limits, aerodynamics.hard_limits) == ({"alpha": (0.0, 0.3)}, {})


@pytest.mark.parametrize(
    ("baseline", "common"),
    [({}, (0.0, 0.3)), ({"alpha": (0.1, 0.5)}, (0.1, 0.3))],
)
def test_limits_of_increments_narrow_those_of_the_baseline(baseline, common):
    increments = PolynomialAerodynamics({"Cm": {"alpha": 0.1}}, limits={"alpha": (0.0, 0.3)})
    both = AerodynamicsWithIncrements(PolynomialAerodynamics({}, limits=baseline), increments)
    assert both.limits == {"alpha": common}


def test_unknown_coefficient_raises_error():
    with pytest.raises(InputError, match="no aerodynamic coefficient 'CL'"):
        PolynomialAerodynamics({"CL": {"alpha": 5.0}})


def test_tables_equal_sums_by_hand(folder):
    aerodynamics = TableAerodynamics(read_coefficients(folder), interpolation="linear")
    Cl = (-0.3 + 0.2 * 0.2) * 0.01 - 0.05 * 0.03
    Cm = 10 * 0.2 + 1 - 0.1 + (-5 - 0.2) * 0.004 + (-0.4 - 0.1 * 0.2) * 0.05
    Cn = (-0.3 + 0.1 * 0.2) * -0.006
    np.testing.assert_allclose(
        aerodynamics.coefficients(SIGNALS), [0, 0.1 * -0.02, 0, Cl, Cm, Cn], rtol=1e-13
    )
    assert aerodynamics.limits == {"alpha": (0.0, 1.0), "beta": (-1.0, 1.0)}
    assert aerodynamics.hard_limits == {}
    assert (
        TableAerodynamics(read_coefficients(folder), extrapolation="refuse").hard_limits
        == aerodynamics.limits
    )


def test_every_value_has_a_name_and_changes_its_coefficient(folder):
    aerodynamics = TableAerodynamics(read_coefficients(folder), interpolation="linear")
    names = parameter_names(aerodynamics)
    assert {"Cm.alpha=0,beta=-57.29577951", "Clda.alpha=90", "Cmq.alpha=0"} <= set(names)
    moved = jax.jit(jax.jacfwd(lambda a: a.coefficients(SIGNALS)))(aerodynamics)
    leaves = map(np.asarray, jax.tree.leaves(moved))
    columns = np.concatenate([leaf.reshape(len(COEFFICIENTS), -1) for leaf in leaves], axis=1)
    for name, column in zip(names, columns.T, strict=True):
        others = [k for k, coefficient in enumerate(COEFFICIENTS) if coefficient != name[:2]]
        assert not column[others].any()


def test_origins_are_listed_by_name(folder):
    known = origins(read_coefficients(folder))
    assert len(known) == 4
    assert known["Cm.alpha=57.29577951,beta=57.29577951"] == "R"


def test_folder_is_read_again_only_after_change(folder):
    first = read_coefficients(folder)
    assert read_coefficients(str(folder)) is first
    (folder / "Cm.csv").unlink()
    assert set(first) - set(read_coefficients(folder)) == {"Cm"}


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("Cmx.csv", "alpha_deg,Cmx\n0,1\n1,2\n", "no aerodynamic table 'Cmx'. Did you mean .*'Cm"),
        (
            "Cmr.csv",
            "alpha,Cmr\n0,1\n1,2\n",
            "Cmr.csv: the axis 'alpha' is an angle and has no unit. Call its column 'alpha_deg'",
        ),
        (
            "Cmr.csv",
            "alpha_m,Cmr\n0,1\n1,2\n",
            r"Cmr.csv: the axis 'alpha' is an angle and has the "
            r"unit \[m\]",
        ),
        ("Cmr.csv", "alpha_deg,Cm\n0,1\n1,2\n", "Cmr.csv has no column 'Cmr'"),
    ],
)
def test_invalid_folder_raises_error(folder, name, text, words):
    (folder / name).write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        TableAerodynamics(read_coefficients(folder))


def test_empty_folder_raises_error(tmp_path):
    with pytest.raises(InputError, match="There is no CSV file in the folder"):
        read_coefficients(tmp_path)


@pytest.mark.parametrize("kind", ["simulated", "identified"])
def test_tables_and_terms_vary_with_mach_and_altitude(tmp_path, kind):
    """Bilinear tables (Figs. 2.4, 2.5), equal to polynomial terms in alpha, Mach and altitude."""
    (tmp_path / "CZ.csv").write_text("alpha_rad,mach,CZ\n0,0,0\n0,1,-1\n1,0,-4\n1,1,-7\n")
    (tmp_path / "Cm.csv").write_text("altitude_m,Cm\n0,0.01\n10000,0.03\n")
    tables = TableAerodynamics(read_coefficients(tmp_path), interpolation="linear")
    terms = PolynomialAerodynamics(
        {
            "CZ": {"mach": -1.0, "alpha": -4.0, "alpha mach": -2.0},
            "Cm": {"1": 0.01, "altitude": 2e-6},
        }
    )

    def coefficients(aerodynamics):
        frame = eqx.tree_at(lambda one: one.aerodynamics, small_airframe(), aerodynamics)
        if kind == "identified":
            model = IdentificationModel(frame, held={"altitude": 5000.0})
            x = jnp.array([150.0, 2.0, 20.0, *np.zeros(6)])
        else:
            model = Aircraft(frame, controls=MeasuredSurfaces())
            e = jnp.array([1.0, 0.0, 0.0, 0.0])
            place = jnp.array([0.0, 0.0, 5000.0])
            x = model.flight_state(jnp.array([150.0, 2.0, 20.0]), jnp.zeros(3), e, place)
        u = jnp.zeros(len(model.inputs))
        signals = eqx.filter_jit(lambda model: model.signals(jnp.zeros(()), x, u))(model)
        assert 0.45 < signals["mach"] < 0.5
        return [signals[name] for name in COEFFICIENTS]

    np.testing.assert_allclose(coefficients(tables), coefficients(terms), atol=1e-14)
    assert coefficients(tables)[4] == pytest.approx(0.02)
