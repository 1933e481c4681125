"""From files in the layouts of SIDPAC and of DLR to a model that predicts another flight: what
docs/real_records.md prints, run.

Files are simulated flights of an aircraft whose coefficients are known. Estimates are held against
them in standard errors, the seeds fixed: of 40 normal numbers the largest exceeds 4 in one of 400
draws.
"""

from pathlib import Path

import numpy as np
import pytest
from printed_code import blocks
from written_flight import MASS, NOISE, SIZE, SURFACES, TRUE, flight, write_hfb, write_sidpac

from jaxid import read_sidpac
from jaxid.data.smoothing import Fourier, differentiate

GUIDE = Path(__file__).resolve().parent.parent.parent / "docs" / "real_records.md"
RATES = {"p": "pdot", "q": "qdot", "r": "rdot"}
WORST = 4.0  # standard errors
# The guide's numbers of the HFB-320, for which the flight is that of the small aircraft.
OWN = {
    "mass=7472.0": f"mass={MASS['mass']}",
    "Iy=91420.0": f"Iy={MASS['Iy']}",
    "S=30.1": f"S={SIZE['S']}",
    "b=14.5": f"b={SIZE['b']}",
    "cbar=2.43": f"cbar={SIZE['cbar']}",
    ", position=(-1.343, 0.0, -0.652), up=0.0524": "",
}


@pytest.fixture(scope="module")
def guide(tmp_path_factory):
    """All variables that the guide's code blocks define, and their printed output."""
    folder = tmp_path_factory.mktemp("flights")
    write_sidpac(folder / "flight.mat", flight(seed=1))
    write_sidpac(folder / "other.mat", flight(seed=2, which=("rudder", "stabilator", "aileron")))
    write_hfb(folder / "hfb320_1_10.asc", flight(step=0.05, which=("stabilator",), seed=3))
    code = "\n".join(blocks(GUIDE.read_text(encoding="utf-8"), "python"))
    for printed, simulated in OWN.items():
        assert code.count(printed) == 1, printed
        code = code.replace(printed, simulated)
    names, said = {"print": lambda *things: said.append(" ".join(map(str, things)))}, []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        exec(compile(code, GUIDE.name, "exec"), names)
    return names | {"said": said, "folder": folder}


def true_at(centre):
    """The coefficients about other centres than zero."""
    a, b = centre["alpha"], centre["beta"]
    moved = {}
    for coefficient, terms in TRUE.items():
        by = {name: terms.get(name, 0.0) for name in ("alpha", "alpha^2", "beta")}
        moved |= {f"{coefficient}.{term}": value for term, value in terms.items()}
        level = terms.get("1", 0.0) + by["alpha"] * a + by["alpha^2"] * a**2 + by["beta"] * b
        moved[f"{coefficient}.1"] = level
        moved[f"{coefficient}.alpha"] = by["alpha"] + 2.0 * by["alpha^2"] * a
    return moved


def standardised(result):
    """Deviations from the truth, in standard errors."""
    estimate, true = result.estimate, true_at(result.centre)
    values, errors = np.asarray(estimate.values), np.asarray(estimate.corrected_errors)
    return {
        n: (v - true.get(n, 0.0)) / e
        for n, v, e in zip(estimate.names, values, errors, strict=True)
    }


def test_sidpac_record_is_identified(guide):
    """All six equations are kept, with the terms that are true and none that is not, and values
    within their errors.
    """
    result = guide["found"]
    assert bool(result.estimate.successful), result.estimate.status
    assert result.left_out == ()
    assert {n: {*equation.regression.names} for n, equation in result.equations.items()} == {
        n: {*of} - {"1"} for n, of in TRUE.items()
    }
    deviations = standardised(result)
    assert max(map(abs, deviations.values())) < WORST, deviations


def test_regression_equals_ordinary_least_squares_on_measured_pressure(guide):
    """Coefficients by hand from the recorded dynamic pressure, accelerations and rates, and NumPy's
    least squares.
    """
    result = guide["found"]
    record = differentiate(read_sidpac(guide["folder"] / "flight.mat"), RATES, Fourier())
    z = {n: np.asarray(record.channel(n)) for n in (*record.inputs, *record.outputs)}
    p, q, r = z["p"], z["q"], z["r"]
    half = {"phat": SIZE["b"] * p, "qhat": SIZE["cbar"] * q, "rhat": SIZE["b"] * r}
    signals = z | {name: value / (2.0 * z["V"]) for name, value in half.items()}
    signals |= {name: z[name] - result.centre[name] for name in ("alpha", "beta")}
    pressure, inertia = z["qbar"] * SIZE["S"], MASS
    thrust = z["thrust"] if "thrust" in z else float(record.constants["thrust"])
    forces = [inertia["mass"] * z[name] for name in ("ax", "ay", "az")]
    forces[0] = forces[0] - thrust
    Ix, Iy, Iz, Ixz = (inertia[name] for name in ("Ix", "Iy", "Iz", "Ixz"))
    moments = [
        Ix * z["pdot"] - Ixz * (z["rdot"] + p * q) + (Iz - Iy) * q * r,
        Iy * z["qdot"] + (Ix - Iz) * p * r + Ixz * (p**2 - r**2),
        Iz * z["rdot"] - Ixz * (z["pdot"] - q * r) + (Iy - Ix) * p * q,
    ]
    lengths = (1.0, 1.0, 1.0, SIZE["b"], SIZE["cbar"], SIZE["b"])
    for name, load, length in zip(TRUE, (*forces, *moments), lengths, strict=True):
        regression = result.equations[name].regression
        columns = [np.ones_like(p)]
        for term in regression.names:
            base, _, power = term.partition("^")
            columns.append(signals[base] ** int(power or 1))
        values, *_ = np.linalg.lstsq(
            np.stack(columns, axis=1), load / (pressure * length), rcond=None
        )
        ours = np.array([regression.constant, *regression.values])
        np.testing.assert_allclose(ours, values, rtol=1e-6, err_msg=name)


def test_consistency_of_sidpac_record_finds_gyro_noise_level(guide):
    """No error is planted, and the residuals are noise; the estimated error is the integrated noise
    of the gyros (1e-4 rad/s).
    """
    checked = guide["checked"]
    assert bool(checked.estimate.successful)
    for channel in checked.channels:
        assert channel.after == pytest.approx(NOISE[channel.name], rel=0.08), channel.name
    assert all(
        abs(error.value) < 2e-4
        for error in checked.errors
        if error.name in ("input_bias.p", "input_bias.q", "input_bias.r")
    )
    assert "instruments" in guide["said"][0]


def test_other_flight_is_predicted_to_noise_level(guide):
    """RMS of errors near the noise; an error of the model and of its start as large as the noise
    would make 1.41 of it.
    """
    rms = dict(zip(guide["found"].model.outputs, np.asarray(guide["prediction"].rms), strict=True))
    assert set(rms) == set(NOISE) - {"altitude"}
    for name, value in rms.items():
        assert 0.9 * NOISE[name] < value < 1.45 * NOISE[name], name


def test_longitudinal_flight_in_text_columns_is_identified(guide):
    """Mass and size as arguments, angular accelerations from the file, density from qbar, no
    altitude and no heading.
    """
    result = guide["longitudinal"]
    assert bool(result.estimate.successful), result.estimate.status
    assert result.model.states == ("u", "w", "q", "pitch")
    assert set(result.model.inputs) == {*SURFACES, "thrust", "density", "v", "p", "r", "phi"}
    assert {n: {*equation.regression.names} for n, equation in result.equations.items()} == {
        n: {*TRUE[n]} - {"1"} for n in ("CX", "CZ", "Cm")
    }
    deviations = standardised(result)
    assert max(map(abs, deviations.values())) < WORST, deviations
