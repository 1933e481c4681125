"""Random forces along the motion without forces are estimated as by the filter of `FilterError`."""

import numpy as np
import pytest
from searched_spring import problem

from jaxid.loop import Hypothesis, RandomForces
from jaxid.loop.fit import fit
from jaxid.loop.random_forces import fit_forces

NOISE = RandomForces({"v": 0.1}, {}, 0.5)


def test_forces_and_parameters_of_linear_model_equal_those_of_filter_error():
    given = problem(7, gust=0.3)
    declared = fit(given, Hypothesis())
    found = fit_forces(declared.motion, NOISE, NOISE.initial(declared.noise_covariance))
    filtered = fit(given, Hypothesis((), NOISE), declared)
    fall = declared.cost - filtered.cost
    assert fall > 50.0
    # The force is a straight line between samples in one, and moves on at random in the other.
    assert declared.cost - found.cost == pytest.approx(fall, rel=0.02)
    values = given.columns.names[: given.columns.declared]
    named = dict(zip(values, found.motion.values, strict=False)) | NOISE.named(
        found.noise, given.model.outputs
    )
    for name, (value, error) in filtered.estimates.items():
        assert abs(named[name] - value) < 0.5 * error, name


def test_diverging_start_has_infinite_cost():
    given = problem(7, gust=0.3)
    declared = fit(given, Hypothesis())
    motion = declared.motion
    motion.values[given.columns.index["c"]] = -500.0
    found = fit_forces(motion, NOISE, NOISE.initial(declared.noise_covariance))
    assert np.isinf(found.cost)
