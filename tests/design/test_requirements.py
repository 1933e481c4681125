"""Checks of an input against requirements: numbers in closed form, verdicts, refusals."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_spring import SIGMA, Spring

from jaxid import AbstractModel, FixedNoise, OutputError, free, simulate
from jaxid._foundation.checks import InputError
from jaxid._foundation.types import Array
from jaxid.aircraft.flight.longitudinal_flight import longitudinal_flight
from jaxid.design import (
    Criterion,
    Limits,
    Requirements,
    Trace,
    Verdict,
    alternating_pulses,
    check_input,
    combine,
    planned_record,
    sample_times,
)

SPRING = Spring(jnp.array(1.5), jnp.array(0.2))
KNOWN = OutputError(FixedNoise(jnp.array([SIGMA**2])))
T = sample_times(12.0, 0.1)
CHOSEN = free(SPRING, "k", "c", per_record=("initial_state",))
PERIODIC = sample_times(9.99, 0.01)  # ten periods of 1 Hz, without the first sample of an eleventh


class Gains(AbstractModel):
    """`y = a left + b right` without states."""

    a: Array
    b: Array
    states, inputs, outputs = (), ("left", "right"), ("y",)

    def rhs(self, t, x, u):
        return jnp.zeros(0)

    def output(self, t, x, u):
        return jnp.stack([self.a * u[0] + self.b * u[1]])


GAINS = Gains(jnp.array(2.0), jnp.array(0.5))
BOTH = free(GAINS, "a", "b")


def flown(values, t=T):
    """The spring's record under samples of its force."""
    return planned_record(SPRING, combine(t, {"force": values}, ("force",), name="plan"), KNOWN)


def of_gains(left, right, t=PERIODIC):
    """The record of the two gains under samples of their inputs."""
    signal = combine(t, {"left": left, "right": right}, GAINS.inputs)
    return planned_record(GAINS, signal, KNOWN)


def checked(record, **requirements):
    return check_input(SPRING, CHOSEN, record, KNOWN, Requirements(**requirements))


def gains_checked(record, **requirements):
    return check_input(GAINS, BOTH, record, KNOWN, Requirements(**requirements))


def sine(frequency, amplitude=1.0):
    return amplitude * jnp.sin(2 * jnp.pi * frequency * PERIODIC)


@pytest.fixture(scope="module")
def pulses():
    return flown(alternating_pulses(T, (1.2, 0.8, 0.4, 0.4), 1.0))


def test_without_requirements_only_the_procedure_and_the_sample_rate_are_checked(pulses):
    result = checked(pulses)
    assert {name: check.verdict for name, check in result.checks.items()} == {
        **dict.fromkeys(result.checks, Verdict.NOT_CHECKED),
        **dict.fromkeys(("instruments", "procedure"), Verdict.MET),
    }
    assert result.is_met
    rows = [line.split()[0] for line in str(result).splitlines()]
    assert rows == ["requirement", *result.checks]
    assert "nothing was given" in result._repr_html_()


def test_limits_are_the_shares_that_the_manoeuvre_uses(pulses):
    """Pulses of height 1 at 0.1 s have a rate from +1 to -1 of 20/s; their energy is a sum."""
    limits = Limits({"force": 2.0}, {"force": 16.0}, 10.0, {"x": (-1.0, None), "v": (None, 3.0)})
    check = checked(pulses, limits=limits).pilot
    v = simulate(SPRING, pulses.t, pulses.u, jnp.zeros(2)).x[:, 1]
    assert check.numbers == pytest.approx(
        {
            "force, amplitude over its limit": 0.5,
            "force, rate over its limit": 20.0 / 16.0,
            "energy over its limit": float(jnp.sum(pulses.u**2)) * 0.1 / 10.0,
            "x, lower over its limit": -float(jnp.min(pulses.z)),
            "v, upper over its limit": float(jnp.max(v)) / 3.0,
        }
    )
    assert check.verdict is Verdict.NOT_MET
    (failure,) = check.failures
    assert failure.name == "force, rate over its limit"
    assert "Scale the input down" in str(check)


def test_amplitude_is_the_deviation_from_trim(pulses):
    shifted = eqx.tree_at(lambda r: r.u, pulses, pulses.u + 3.0)
    limits, trims = Requirements(limits=Limits({"force": 1.0})), (None, jnp.array([3.0]))
    at = [check_input(SPRING, CHOSEN, shifted, KNOWN, limits, trim_input=trim) for trim in trims]
    assert [result.pilot.numbers["force, amplitude over its limit"] for result in at] == [4.0, 1.0]
    assert [result.pilot.verdict for result in at] == [Verdict.NOT_MET, Verdict.MET]


def test_power_of_two_sines_is_shared_by_their_squared_amplitudes():
    """A Hann window leaks 1e-6 of a line's power beyond 5 lines, 0.5 Hz in 10 s."""
    record = of_gains(sine(1.0) + sine(4.0, 0.5), sine(1.0))
    for share, verdict in ((0.21, Verdict.MET), (0.19, Verdict.NOT_MET)):
        check = gains_checked(record, pilot_frequency=2.0, pilot_share=share).pilot
        assert check.numbers["left, power above 2 Hz"] == pytest.approx(0.2, abs=1e-3)
        assert check.numbers["right, power above 2 Hz"] == pytest.approx(0.0, abs=1e-3)
        assert check.verdict is verdict


def test_reversals_are_turning_points_and_noise_adds_none(pulses):
    """3-2-1-1 turns at the end of each pulse; the return to zero is no reversal."""
    noise = 0.01 * np.random.default_rng(1).normal(size=pulses.u.shape)
    for record in (pulses, eqx.tree_at(lambda r: r.u, pulses, pulses.u + noise)):
        met, missed = (checked(record, reversals=rate).pilot for rate in (0.4, 0.3))
        assert met.numbers["force, reversals/s"] == pytest.approx(4 / 12.0)
        assert (met.verdict, missed.verdict) == (Verdict.MET, Verdict.NOT_MET)


def test_motion_returns_to_trim_after_a_pulse_and_not_after_a_step():
    """The damped spring, d = exp(-c t/2) at 16 s after the pulse; a step leaves it at 1/k."""
    damped, t = Spring(jnp.array(1.5), jnp.array(1.0)), sample_times(20.0, 0.1)
    ends = []
    for values in (jnp.where(t < 1.0, 1.0, 0.0), jnp.ones_like(t)):
        record = planned_record(damped, combine(t, {"force": values}, ("force",)), KNOWN)
        given = Requirements(trim_distance={"x": 0.01, "v": 0.01})
        ends.append(check_input(damped, CHOSEN, record, KNOWN, given).pilot)
    assert [check.verdict for check in ends] == [Verdict.MET, Verdict.NOT_MET]
    number = ends[1].numbers["x, distance from trim at the end"]
    assert number == pytest.approx(1 / 1.5, rel=1e-3)
    (failure,) = ends[1].failures  # its velocity has decayed
    assert "doublet" in failure.remedy


def test_signal_to_noise_of_a_sine_is_its_effective_value_over_the_deviation():
    record = of_gains(sine(1.0), 0.0 * PERIODIC)
    ratio = 2.0 / np.sqrt(2.0) / SIGMA
    for least, verdict in ((0.99 * ratio, Verdict.MET), (1.01 * ratio, Verdict.NOT_MET)):
        check = gains_checked(record, signal_to_noise={"y": least}).instruments
        assert check.numbers["y, signal to noise"] == pytest.approx(ratio, rel=1e-12)
        assert check.verdict is verdict


def test_range_and_quantum_of_an_instrument():
    record = of_gains(sine(1.0), 0.0 * PERIODIC)
    met = gains_checked(record, ranges={"y": (-2.0, 2.0)}, quantum={"y": SIGMA}).instruments
    assert met.verdict is Verdict.MET
    assert met.numbers["y, quantum over noise"] == 1.0
    missed = gains_checked(record, ranges={"y": (-1.9, 1.9)}, quantum={"y": 2 * SIGMA}).instruments
    assert [failure.name for failure in missed.failures] == [
        *("y, lowest", "y, highest", "y, quantum over noise"),
    ]


@pytest.mark.parametrize(("frequency", "share"), [(10.0, 0.0), (30.0, 1.0)])
def test_output_above_half_of_the_nyquist_frequency_is_sampled_too_slowly(frequency, share):
    """At 100 samples per second half of the Nyquist frequency is 25 Hz."""
    check = gains_checked(of_gains(sine(frequency), 0.0 * PERIODIC)).instruments
    (number,) = check.numbers.values()
    assert number == pytest.approx(share, abs=1e-3)
    assert check.verdict is (Verdict.NOT_MET if share else Verdict.MET)


def test_inputs_are_collinear_by_their_correlation():
    for mixture, verdict in ((0.5, Verdict.MET), (0.1, Verdict.NOT_MET)):
        record = of_gains(sine(1.0), sine(1.0) + mixture * sine(2.0) + 0.3)
        check = gains_checked(record).procedure
        factor = 1.0 / (1.0 - np.corrcoef(np.asarray(record.u).T)[0, 1] ** 2)
        assert check.numbers["left, variance inflation"] == pytest.approx(factor)
        assert check.numbers["right, variance inflation"] == pytest.approx(factor)
        assert check.verdict is verdict


def test_undetermined_combination_and_parameter_are_named():
    same = gains_checked(of_gains(sine(1.0), sine(1.0)), parameters=("a",))
    assert "a + 1 b is determined, a - 1 b is not" in str(same.procedure)
    assert same.sensitivity.numbers["a, error inflation"] == np.inf
    assert "confounded with b" in str(same.sensitivity)
    rest = gains_checked(of_gains(sine(1.0), 0.0 * PERIODIC), parameters=("b",))
    assert "b is not determined: fix a parameter" in str(rest.procedure)
    assert "No output depends on b" in str(rest.sensitivity)
    assert not rest.is_met
    still = checked(flown(jnp.zeros(T.size)))
    words = "undetermined parameters 2 (at most 0). k is not determined; c is not determined: fix"
    assert words in str(still.procedure)


def test_time_in_the_range_of_interest_and_its_part_that_is_covered():
    """A sine is inside half of its amplitude for 2/pi arcsin(1/2) = 1/3 of the time."""
    record = of_gains(0.5 * sine(1.0), 0.0 * PERIODIC)
    few = gains_checked(record, interest={"y": (-0.5, 0.5)}).modelling
    assert few.numbers["y, time in the range of interest"] == pytest.approx(1 / 3, abs=0.02)
    assert few.numbers["y, range of interest covered"] == 1.0
    wide = gains_checked(record, interest={"y": (-2.0, 2.0)}).modelling
    assert wide.numbers["y, time in the range of interest"] == 1.0
    assert wide.numbers["y, range of interest covered"] == pytest.approx(0.5)
    assert [len(check.failures) for check in (few, wide)] == [1, 1]
    outside = gains_checked(record, interest={"y": (3.0, 4.0)}).modelling
    assert list(outside.numbers.values()) == [0.0, 0.0]
    whole = gains_checked(record, interest={"y": (-1.0, 1.0)}, valid={"y": (-1.0, 1.0)}).modelling
    assert whole.verdict is Verdict.MET
    narrow = gains_checked(record, valid={"y": (None, 0.9), "left": (-1.0, 1.0)}).modelling
    assert [failure.name for failure in narrow.failures] == ["y, highest"]


def test_objective_is_a_measure_and_standard_errors(pulses):
    information = checked(pulses).information
    errors = dict(zip(information.names, map(float, information.standard_errors), strict=True))
    measure = Trace([1.0, 1.0])
    total = errors["k"] ** 2 + errors["c"] ** 2
    for factor, verdict in ((1.01, Verdict.MET), (0.99, Verdict.NOT_MET)):
        check = checked(
            pulses,
            goal=(measure, factor * total),
            standard_errors={"k": factor * errors["k"]},
            relative_errors={"c": factor * errors["c"] / 0.2},
        ).objective
        assert check.numbers == pytest.approx(
            {
                "cost of the measure": total,
                "k, standard error": errors["k"],
                "c, relative error": errors["c"] / 0.2,
            }
        )
        assert check.verdict is verdict
        assert len(check.failures) == (0 if verdict is Verdict.MET else 3)


def test_integrity_is_a_range_of_the_motion(pulses):
    x = simulate(SPRING, pulses.t, pulses.u, jnp.zeros(2)).x
    lowest = float(jnp.min(x[:, 1]))
    met, missed = (
        checked(pulses, integrity={"v": (lowest + shift, None)}).integrity for shift in (0, 0.01)
    )
    assert met.numbers == pytest.approx({"v, lowest": lowest})
    assert (met.verdict, missed.verdict) == (Verdict.MET, Verdict.NOT_MET)


@pytest.mark.parametrize(("mixture", "verdict"), [(1.0, "MET"), (0.2, "NOT_MET")])
def test_error_inflation_follows_from_the_correlation_of_two_parameters(mixture, verdict):
    """`1/sqrt(1 - rho^2)`, with `rho` of the columns of sensitivities, here the inputs."""
    record = of_gains(sine(1.0), sine(1.0) + mixture * sine(2.0))
    check = gains_checked(record, parameters=("a", "b")).sensitivity
    left, right = np.asarray(record.u).T
    rho = left @ right / np.sqrt(left @ left * (right @ right))
    expected = 1.0 / np.sqrt(1.0 - rho**2)
    for name in ("a", "b"):
        assert check.numbers[f"{name}, error inflation"] == pytest.approx(expected)
    error = SIGMA * expected / np.sqrt(left @ left) / 2.0
    assert check.numbers["a, relative error"] == pytest.approx(error)
    assert check.verdict is Verdict[verdict]
    if check.failures:
        assert f"confounded with b (correlation of size {rho:.3g})" in check.failures[0].remedy


def test_measured_outputs_count_as_recorded_where_they_are_valid(pulses):
    """A peak of the sensor leaves the range; a missing sample does not."""
    faulty = eqx.tree_at(lambda r: r.z, pulses, pulses.z.at[40, 0].set(5.0))
    missing = eqx.tree_at(lambda r: r.mask, faulty, faulty.mask.at[40, 0].set(False))
    results = [checked(record, ranges={"x": (-1.0, 1.0)}) for record in (faulty, missing)]
    assert [result.instruments.verdict for result in results] == [Verdict.NOT_MET, Verdict.MET]
    assert results[0].instruments.numbers["x, highest"] == 5.0


def test_signals_of_an_aircraft_come_from_its_declared_motion():
    flight = longitudinal_flight(jax.random.key(1))
    record, model = flight.train[0], flight.model
    chosen = free(model, "Cm.alpha", "Cm.elevator", per_record=("initial_state",))
    given = Requirements(
        integrity={"az": (-2.0 * 9.81, 0.0)},
        valid={"qhat": (-1.0, 1.0), "alpha": (-0.1, 0.5)},
        parameters=("Cm.alpha",),
    )
    likelihood = OutputError(FixedNoise(flight.noise**2))
    result = check_input(model, chosen, record, likelihood, given)
    y = simulate(model, record.t, record.u, model.initial_state(record)).y
    qhat = y[:, 1] * model.cbar / (2.0 * y[:, 5])
    assert result.modelling.numbers["qhat, highest"] == pytest.approx(float(jnp.max(qhat)))
    assert result.modelling.numbers["alpha, lowest"] == float(jnp.min(record.z[:, 0]))
    assert result.integrity.numbers["az, lowest"] == float(jnp.min(record.z[:, 4]))
    assert result.is_met


def test_failures_are_printed_with_their_remedies_and_met_numbers_in_part(pulses):
    ranges = {"x": (-0.1, 0.1), "v": (-9.0, 9.0), "force": (-9.0, 9.0)}
    lines = str(checked(pulses, valid=ranges)).splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("modelling"))
    assert lines[start].split()[:4] == ["modelling", "not", "met", "x,"]
    assert lines[start].endswith(
        "(at least -0.1). Lower the amplitude, or take a model that is valid there."
    )
    assert lines[start + 1].split()[:2] == ["x,", "highest"]
    ranges = {"v": (-9.0, 9.0), "force": (-9.0, 9.0)}
    assert str(checked(pulses, valid=ranges).modelling).endswith("; and 1 more")


def test_criterion_at_its_limit_is_met_and_not_a_number_is_not():
    assert Criterion("x", 1.0 + 1e-12, "", high=1.0).is_met
    assert not Criterion("x", 1.0 + 1e-6, "", high=1.0).is_met
    assert not Criterion("x", np.nan, "").is_met


@pytest.mark.parametrize(
    ("requirements", "message"),
    [
        ({"ranges": {"y": (0.0, 1.0)}}, r"no output 'y'\..* The names are: x\."),
        ({"signal_to_noise": {"v": 3.0}}, "no output 'v'"),
        ({"valid": {"alpha": (0.0, 1.0)}}, r"no state, output or signal 'alpha'.*x, v, force"),
        ({"parameters": ("m",)}, r"no free parameter 'm'.*k, c\. Free it, or take it out\."),
        ({"relative_errors": {"cc": 0.1}}, "Did you mean 'c'"),
        ({"integrity": {"x": (1.0, 0.0)}}, r"range of 'x', 1\.0 to 0\.0, is empty.*lower end"),
        ({"interest": {"x": (None, 0.0)}}, "range of interest of 'x' has no bound"),
        ({"limits": Limits({"torque": 1.0})}, "no input 'torque'"),
        ({"limits": Limits({}, {"force": 1.0})}, "amplitude of the input 'force' has no limit"),
        ({"limits": Limits({}, energy=1.0)}, "amplitude of the input 'force' has no limit"),
        ({"limits": Limits({}, envelope={"x": (0.1, 1.0)})}, "exclude the trim"),
        ({"quantum": {"x": 0.0}}, "limit of 'x' is 0.0; it must be positive"),
        ({"pilot_frequency": -1.0}, "limit of 'pilot_frequency' is -1.0"),
    ],
)
def test_requirements_that_do_not_fit_are_refused(pulses, requirements, message):
    with pytest.raises(InputError, match=message):
        checked(pulses, **requirements)


def test_unknown_noise_and_stacks_are_refused(pulses):
    with pytest.raises(InputError, match="noise covariance is unknown"):
        check_input(SPRING, CHOSEN, pulses, OutputError(), Requirements())
    stacked = jax.tree.map(lambda leaf: leaf[None], pulses)
    stacked = dataclasses.replace(stacked, names=("plan",))
    with pytest.raises(InputError, match="Only a single record can be checked"):
        checked(stacked)
