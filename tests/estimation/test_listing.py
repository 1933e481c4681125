"""The complete print of an estimate has every number of the report's Table 4.2."""

import numpy as np
import pytest
from reference_estimation import Pendulum, as_records, pendulum_records

import jaxid
from jaxid.estimation import listing


@pytest.fixture(scope="module")
def fit():
    model = Pendulum(stiffness=3.5, damping=0.2, torque=1.5)
    records = as_records(pendulum_records(np.random.default_rng(2), gaps=True), model)
    chosen = jaxid.free(model, "stiffness", "damping", per_record=("initial_state",))
    return jaxid.estimate(model, chosen, records, jaxid.OutputError())


def test_listing_holds_all_numbers(fit):
    text = listing(fit)
    lines = text.splitlines()
    stiffness = next(line for line in lines if line.startswith("stiffness"))
    for number in ("3.5", f"{fit.value('stiffness'):.6g}", f"{float(fit.F[0]):.4g}"):
        assert number in stiffness.split()
    fixed = next(line for line in lines if line.startswith("torque"))
    assert fixed.split() == ["torque", "1.5", "fixed"]
    both = np.all(np.asarray(fit.mask), axis=-1)
    v = np.asarray(fit.residuals)[both]
    correlation = v[:, 0] @ v[:, 1] / np.sqrt((v[:, 0] @ v[:, 0]) * (v[:, 1] @ v[:, 1]))
    rows = lines[lines.index(next(line for line in lines if line.startswith("R ("))) + 2 :]
    assert rows[0].split()[:2] == ["angle", f"{float(fit.noise[0, 0]):.3g}"]
    assert rows[1].split() == ["rate", f"{correlation:.3g}", f"{float(fit.noise[1, 1]):.3g}"]
    largest = float(fit.spectrum.eigenvalues[0])
    assert f"eigenvalues: {largest:.3g}, " in text
    assert "angle (measured)" in text
    assert "by record: initial_state.angle" in text
    assert f"cost {float(fit.cost):.6g}" in text


def test_weak_eigenvalue_is_marked(fit):
    import dataclasses

    weak = dataclasses.replace(fit, threshold=0.999)
    assert "*" in listing(weak).split("eigenvalues: ")[1]


def test_value_against_sign_of_its_start_is_remarked(fit):
    """Of a value within two standard errors of zero the sign is not known."""
    import dataclasses

    assert "sign:" not in str(fit)
    against = dataclasses.replace(fit, start=fit.start * np.array([-1.0, 1.0]))
    text = str(against)
    assert (
        f"sign: stiffness is {fit.value('stiffness'):.4g}, against the sign of its start -3.5"
        in text
    )
    assert "sign: damping" not in text
    uncertain = dataclasses.replace(against, standard_errors=0.6 * abs(fit.values))
    assert "sign:" not in str(uncertain)
