"""A hole in the time base that a Runge-Kutta step would cross is refused, with rows and remedy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxid import close_loop
from jaxid._foundation.checks import InputError
from jaxid._foundation.grid import HOLE, holes
from jaxid.data import record, split_at, stack
from jaxid.diagnosis import predict
from jaxid.estimation import OutputError, estimate
from jaxid.models import AbstractModel, LinearModel, free
from jaxid.simulation import RK4, Adaptive, BandLimited, simulate


class Oscillator(AbstractModel):
    """A linear oscillator of 2 rad/s, sampled some 30 times in a period."""

    k: object = 4.0
    states, inputs, outputs = ("x", "v"), ("u",), ("x",)

    def rhs(self, t, x, u):
        return jnp.stack([x[1], u[0] - self.k * x[0] - 0.4 * x[1]])

    def output(self, t, x, u):
        return x[:1]


def times(missing=40, n=100):
    """Uniform sample times, 0.1 s apart, with `missing` samples removed after row 29."""
    t = 0.1 * np.arange(n + missing)
    return np.delete(t, np.arange(30, 30 + missing))


def measured(t, name=""):
    y = simulate(Oscillator(), t, np.sin(t)[:, None], np.zeros(2), stepper=Adaptive()).y
    return record(t, np.sin(t), np.asarray(y), inputs=("u",), outputs=("x",), name=name)


LIKELIHOOD = OutputError()
REFUSED = (
    r"(?s)1 hole: .*rows 29 to 30 \(2\.9 to 7 s, 41 median steps\)"
    r".*split_at\(record, 30\).*Adaptive\(\).*RK4\(9\)"
)
ENTRIES = {
    "simulate": lambda data: simulate(Oscillator(), data.t, data.u, np.zeros(2)),
    "estimate": lambda data: estimate(Oscillator(), free(Oscillator(), "k"), data, LIKELIHOOD),
    "predict": lambda data: predict(Oscillator(), data, LIKELIHOOD),
    "close_loop": lambda data: close_loop(
        Oscillator(),
        free(Oscillator(), "k"),
        LIKELIHOOD,
        train=measured(times(0), "train"),
        check=data,
    ),
}


@pytest.mark.parametrize("entry", ENTRIES)
def test_hole_is_refused_with_rows_and_remedy(entry):
    with pytest.raises(InputError, match=REFUSED):
        ENTRIES[entry](measured(times(), "manoeuvre"))


def test_hole_of_stack_is_refused_by_name_of_record():
    both = stack([measured(times(0, 150), "one"), measured(times(), "two")])
    with pytest.raises(InputError, match=r"record 'two', rows 29 to 30"):
        estimate(Oscillator(), free(Oscillator(), "k"), both, OutputError())


def test_remedies_of_hole_message_are_accepted_and_accurate():
    t = times()
    u = np.sin(t)[:, None]
    exact = simulate(Oscillator(), t, u, np.zeros(2), stepper=Adaptive()).x
    # With h = 4.1/9 s and w = 2 rad/s each of nine steps adds at most (w h)^5/120 = 0.5 % of the
    # motion.
    found = simulate(Oscillator(), t, u, np.zeros(2), stepper=RK4(9, unrolled=False)).x
    np.testing.assert_allclose(found, exact, atol=0.05)
    with pytest.raises(InputError, match=r"8 Runge-Kutta steps would have to cross .* 40 median"):
        simulate(Oscillator(), t, u, np.zeros(2), stepper=RK4(8))
    for part in split_at(measured(t), 30):
        assert bool(simulate(Oscillator(), part.t, part.u, np.zeros(2)).finite)


def test_padding_of_stack_is_no_hole_and_hides_no_hole():
    padded = stack([measured(times(0, 20), "short"), measured(times(0, 200), "long")])
    assert holes(np.asarray(padded.t)) == []
    assert simulate(Oscillator(), padded.t, padded.u, np.zeros((2, 2))).finite.all()
    hidden = stack([measured(times(), "hole"), measured(times(0, 2000), "long")])
    assert [(hole.case, hole.row) for hole in holes(np.asarray(hidden.t))] == [(0, 29)]


def test_uneven_sampling_is_no_hole(seed):
    """Jitter of half a step, three samples lost in a row, and a change of the rate to half."""
    jitter = np.random.default_rng(seed).uniform(0.05, 0.15, 200).cumsum()
    slower = np.concatenate([0.1 * np.arange(60), 6.0 + 0.2 * np.arange(40)])
    for t in (jitter, times(3), slower):
        assert holes(t) == []
        assert bool(simulate(Oscillator(), t, np.sin(t)[:, None], np.zeros(2)).finite)


def test_interval_of_up_to_five_median_steps_is_no_hole():
    assert holes(times(4)) == []
    assert [hole.row for hole in holes(times(5))] == [29]
    assert HOLE == 5.0


def test_model_without_states_has_no_step_to_take():
    static = {"states": (), "inputs": ("u",), "outputs": ("x",)}
    matrices = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.eye(1)
    gain = LinearModel(*matrices, **static)
    data = measured(times())
    np.testing.assert_array_equal(simulate(gain, data.t, data.u, np.zeros(0)).y, data.u)
    predict(gain, data, OutputError())


def test_traced_times_are_not_checked():
    t = times()
    states = jax.jit(lambda t: simulate(Oscillator(), t, jnp.sin(t)[:, None], jnp.zeros(2)).x)(t)
    assert states.shape == (100, 2)


def test_simulate_refuses_times_unsuitable_for_hold():
    t = times(3)
    with pytest.raises(InputError, match="uneven"):
        simulate(Oscillator(), t, np.sin(t)[:, None], np.zeros(2), hold=BandLimited())


def test_print_of_record_shows_holes():
    data = measured(times(), "manoeuvre")
    assert "1 hole: 4.1 s (41 median steps) between rows 29 and 30" in repr(data)
    both = stack([measured(times(0), "even"), data])
    assert "between rows 29 and 30 of 'manoeuvre'" in repr(both)
    assert "hole" not in repr(measured(times(0)))
