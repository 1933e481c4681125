"""Random forces along the motion without forces are estimated as by the filter of `FilterError`."""

import numpy as np
import pytest
from searched_spring import problem

from jaxid import RK4, OutputError, hold
from jaxid.loop import Coloured, Hypothesis, RandomForces
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


def test_filter_of_forces_takes_the_steps_of_the_declared_stepper():
    declared = OutputError(hold=hold.ZeroOrder(), stepper=RK4(10))
    filtered = NOISE.likelihood(declared)
    assert (filtered.stepper.substeps, filtered.hold) == (10, declared.hold)


def test_values_of_a_noise_but_starting_values_are_its_identity():
    assert Coloured(1).key == Coloured(1).key != Coloured(2).key
    assert (
        RandomForces({"v": 0.3}, {}, 2.0).key == NOISE.key != RandomForces({"x": 0.1}, {}, 0.5).key
    )


def test_diverging_start_has_infinite_cost():
    given = problem(7, gust=0.3)
    declared = fit(given, Hypothesis())
    motion = declared.motion
    motion.values[given.columns.index["c"]] = -500.0
    found = fit_forces(motion, NOISE, NOISE.initial(declared.noise_covariance))
    assert np.isinf(found.cost)
