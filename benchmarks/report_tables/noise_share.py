"""Share of the residual of a regression that the noise of the sensors makes."""

import dataclasses

import jax.numpy as jnp
import numpy as np

from benchmarks.report_tables.cases import CaseResult, model_of, record_of
from jaxid.structure import columns

DRAWS = 10  # of the noise (chosen: with 1,000 samples each, a variance is known to 1.4 %)


def noise_shares(result: CaseResult) -> dict[str, float]:
    """Return noise variance over residual variance of each regression, by response.

    A further draw of the sensors' noise on the record changes a response and its terms; the
    variance of the difference of both changes is the noise of the equation. Above one the terms
    follow noise; far below one the residual is a misfit of the terms, or an error of instruments
    that is no noise.

    Args:
        result: of a case with one flight.
    """
    (flight,), identified = result.flights, result.identified
    record, model = record_of(flight, result.setting), model_of(flight, result.setting)
    sensors = flight.aircraft.instruments.noise
    noise = dict(zip(sensors.channels, np.asarray(sensors.values), strict=True))
    sigma = np.array([noise.get(name, 0.0) for name in record.outputs])
    rng = np.random.default_rng(0)
    differences = {name: [] for name in identified.equations}
    clean = _residuals(result, model, record)
    for _ in range(DRAWS):
        z = record.z + jnp.asarray(sigma * rng.normal(size=record.z.shape))
        noisy = _residuals(result, model, dataclasses.replace(record, z=z))
        for name in differences:
            differences[name].append(noisy[name] - clean[name])
    return {
        name: float(np.var(np.stack(differences[name])) / equation.regression.s**2)
        for name, equation in identified.equations.items()
    }


def _residuals(result: CaseResult, model, record) -> dict[str, np.ndarray]:
    """Return response minus regression of each equation of a record."""
    measured = model.pseudo_measurements(record)
    signals = {name: np.asarray(value) for name, value in measured.signals.items()}
    residuals = {}
    for name, equation in result.identified.equations.items():
        regression = equation.regression
        X = columns(regression.names, signals, result.identified.centre)
        residuals[name] = np.asarray(measured.responses[name]) - regression.predict(X)
    return residuals
