"""Gusts: spectra against the military formulas, exact discretisation, scales by altitude, keys,
errors on invalid arguments.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2, norm

from jaxid._foundation.checks import InputError
from jaxid._foundation.compiler import is_known
from jaxid.aircraft import (
    GUSTS,
    REPORT_GUSTS,
    FixedIntensity,
    MilitaryIntensity,
    dryden,
    von_karman,
    white_gusts,
)
from jaxid.aircraft.air.forming_filters import (
    covariance,
    factor,
    first_order,
    second_order,
    transition,
)
from jaxid.aircraft.air.gust_scales import DRYDEN_LENGTH, VON_KARMAN_LENGTH, as_intensity

FT = 0.3048
V, SPAN, SIGMAS, LENGTHS = 120.0, 12.0, (2.0, 1.5, 1.0), (300.0, 200.0, 60.0)
FIXED = FixedIntensity(SIGMAS, LENGTHS)
STEP, SAMPLES, DRAWS = 0.05, 256, 1500
T = STEP * jnp.arange(SAMPLES)
# Two-sided probability of a chance failure in a total test is 0.1 %, shared among its comparisons.
CHANCE = 1e-3


def military_spectra(f, kind):
    """One-sided spectra per Hz of u, v, w, p, q, r, written from MIL-F-8785C, 3.7.1 and 3.7.4."""
    Om, (su, sv, sw), (Lu, Lv, Lw), b = 2 * np.pi * f / V, SIGMAS, LENGTHS, SPAN
    if kind == "dryden":
        u = su**2 * 2 * Lu / np.pi / (1 + (Lu * Om) ** 2)
        v, w = (
            s**2 * L / np.pi * (1 + 3 * (L * Om) ** 2) / (1 + (L * Om) ** 2) ** 2
            for s, L in ((sv, Lv), (sw, Lw))
        )
    else:
        u = su**2 * 2 * Lu / np.pi / (1 + (1.339 * Lu * Om) ** 2) ** (5 / 6)
        v, w = (
            s**2
            * L
            / np.pi
            * (1 + 8 / 3 * (1.339 * L * Om) ** 2)
            / (1 + (1.339 * L * Om) ** 2) ** (11 / 6)
            for s, L in ((sv, Lv), (sw, Lw))
        )
    p = sw**2 / Lw * 0.8 * (np.pi * Lw / (4 * b)) ** (1 / 3) / (1 + (4 * b * Om / np.pi) ** 2)
    q = Om**2 / (1 + (4 * b * Om / np.pi) ** 2) * w
    r = Om**2 / (1 + (3 * b * Om / np.pi) ** 2) * v
    return np.stack([u, v, w, p, q, r], axis=-1) * 2 * np.pi / V


@pytest.fixture(scope="module")
def draws():
    """Many gusts of both kinds, shape (draw, time, 6)."""
    keys = jax.random.split(jax.random.key(1974), DRAWS)
    gusts_by_kind = {}
    # Sines take a third of the time at this level, other than the one of the tests.
    level = "xla_backend_optimization_level", 1
    options = dict([level]) if is_known(*level) else None
    for make in (dryden, von_karman):
        many = jax.vmap(lambda key, make=make: make(key, T, V, 100.0, FIXED, span=SPAN))
        gusts_by_kind[make.__name__] = np.asarray(jax.jit(many, compiler_options=options)(keys))
    return gusts_by_kind


@pytest.mark.parametrize("kind", ["dryden", "von_karman"])
def test_spectrum_equals_specification(kind, draws):
    # The mean of many periodograms is the spectrum smoothed by the window, within 4.2 of its
    # standard errors: that is the 99.9 % point of the largest of 42 normal numbers.
    window, lines = np.hanning(SAMPLES), np.array([2, 4, 8, 16, 32, 64, 96])
    at = lines / (STEP * SAMPLES)
    phasors = np.exp(-2j * np.pi * at[:, None] * np.arange(SAMPLES) * STEP) * window
    power = np.abs(phasors @ draws[kind]) ** 2
    # Dryden's tail folds back, as in any sampled signal; the sum of sinusoids ends at half the
    # sample rate. The steps of this integral, and its end where a tail of power -2 is left, are
    # 1e-3 of the result, of p and of `von_karman` too.
    end = 2000.0 if kind == "dryden" else 0.5 / STEP
    f = np.concatenate([np.linspace(1e-6, 15.0, 6001), np.linspace(15.0, end, 200_001)[1:]])
    f = f[f <= end]
    gains = _window_gain(f, at, window)
    S = military_spectra(f, kind)
    expected = np.stack([np.trapezoid(S * row[:, None], f, axis=0) for row in gains])
    if kind == "von_karman":  # its roll is the filter's, which folds back
        wide = np.concatenate(
            [np.linspace(1e-6, 15.0, 6001), np.linspace(15.0, 2000.0, 200_001)[1:]]
        )
        expected[:, 3] = [
            np.trapezoid(military_spectra(wide, kind)[:, 3] * row, wide)
            for row in _window_gain(wide, at, window)
        ]
    error = (power.mean(axis=0) - expected) / (power.std(axis=0) / DRAWS**0.5)
    limit = norm.ppf(1 - CHANCE / 2 / expected.size) + 2e-3 * DRAWS**0.5
    assert (np.abs(error) < limit).all(), error
    # The test is sensitive: the other kind's spectrum, where it differs most, is far outside.
    other = military_spectra(at, "von_karman" if kind == "dryden" else "dryden") / military_spectra(
        at, kind
    )
    assert np.abs((other - 1) * expected / (power.std(axis=0) / DRAWS**0.5)).max() > 2 * limit


def _window_gain(f, at, window):
    """Return the gain of a windowed periodogram at the frequencies `at` for the power of a real
    signal at f, shape (at, f).
    """
    fold = np.fft.rfft(window, 2**14)
    grid = np.arange(fold.size) / (2**14 * STEP)

    def gain(g):
        g = np.abs((g + 0.5 / STEP) % (1 / STEP) - 0.5 / STEP)
        return np.interp(g, grid, np.abs(fold) ** 2)

    return np.stack([0.25 * (gain(a - f) + gain(a + f)) * 2 for a in at])


def test_variances_equal_specification(draws):
    f = np.concatenate([[0.0], np.geomspace(1e-7, 1e5, 400_001)])
    for kind in draws:
        total = np.trapezoid(military_spectra(f, kind), f, axis=0)
        if kind == "dryden":
            np.testing.assert_allclose(
                total[:3], np.square(SIGMAS), rtol=1e-4
            )  # a check of the formulas above
        inside = (f <= 0.5 / STEP) | (kind == "dryden")
        part = np.trapezoid(military_spectra(f[inside], kind), f[inside], axis=0)
        part[3] = total[3]
        power = draws[kind][:, SAMPLES // 2] ** 2
        error = (power.mean(axis=0) - part) / (power.std(axis=0) / DRAWS**0.5)
        # 3.9 is the 99.9 % point of the largest of 12 normal numbers; 2e-3 of the power lies below
        # the lowest line.
        assert (np.abs(error) < 3.9 + 2e-3 * DRAWS**0.5).all(), (kind, error)


@pytest.mark.parametrize(
    ("a", "c", "h"),
    [
        (1.0, 2.0, 0.1),
        (1.0, 1.0, 0.3),
        (9.0, 3.0, 2.0),
        (0.1, 40.0, 1e-4),
        (3.0, 3.0001, 1.0),
        (1.0, 2.0, 0.0),
    ],
)
def test_discretisation_is_exact(a, c, h):
    root3 = 3**0.5
    A = np.array([[-a, 0, 0], [a, -a, 0], [root3 * c, (1 - root3) * c, -c]])
    P = np.asarray(covariance(jnp.array(a), jnp.array(c)))
    F = np.asarray(transition(jnp.array(h), jnp.array(a), jnp.array(c)))
    np.testing.assert_allclose(F, expm(A * h), atol=1e-14)  # rounding of numbers of order one
    np.testing.assert_allclose(A @ P + P @ A.T, -np.diag([a, 0, 0]), atol=1e-13 * max(a, c))
    e = np.asarray(factor(jnp.asarray(P - F @ P @ F.T)))
    # Independent of the step: the drawn noise restores the covariance. 3e-14 is three times the
    # smallest pivot that counts.
    np.testing.assert_allclose(F @ P @ F.T + e @ e.T, P, atol=3e-14)


def test_covariance_is_independent_of_sample_times(key):
    # The filters are linear in their noise, so that their Jacobian gives the covariance of the
    # samples, exactly.
    a, c = jnp.array(0.8), jnp.array(3.0)
    t = np.array([0.0, 0.01, 0.5, 0.5, 2.0])

    def gram(signal, width):
        J = jax.jacfwd(signal)(jnp.zeros((t.size, width))).reshape(t.size, -1)
        return np.asarray(J @ J.T)

    step, lag = jnp.diff(jnp.asarray(t)), np.abs(t[:, None] - t[None])
    longitudinal = gram(lambda n: first_order(n[:, 0], step, a), 1)
    np.testing.assert_allclose(longitudinal, np.exp(-0.8 * lag), atol=1e-14)
    lateral = gram(lambda n: second_order(n, step, a, c)[0], 3)
    # The Dryden correlation across the flight path, exp(-x/L) (1 - x/2L).
    np.testing.assert_allclose(lateral, np.exp(-0.8 * lag) * (1 - 0.4 * lag), atol=1e-13)


@pytest.mark.parametrize("make", [dryden, von_karman])
def test_rotations_equal_gradients_of_gust_velocities(make, key):
    # q = -dw/dx and r = dv/dx of the gust smoothed by the span, x = V t: so the integral of V r is
    # v less its lag V r/c.
    h = 0.001
    options = {"highest": 3.0, "count": 64} if make is von_karman else {}
    gusts = np.asarray(
        jax.jit(lambda key: make(key, h * jnp.arange(4000), V, 100.0, FIXED, span=SPAN, **options))(
            key
        )
    )
    gusts = dict(zip(GUSTS, gusts.T, strict=True))
    for velocity, rate, c in (
        (gusts["gust_v"], gusts["gust_r"], 3),
        (gusts["gust_w"], -gusts["gust_q"], 4),
    ):
        smooth = velocity - rate * c * SPAN / np.pi
        integral = np.concatenate([[0.0], np.cumsum(0.5 * h * V * (rate[1:] + rate[:-1]))])
        # The rule of trapezoids on a rough signal errs by some 0.5 % here, and falls with the step;
        # a wrong sign gives 200 %.
        error = integral - (smooth - smooth[0])
        assert np.std(error) < 0.05 * np.std(smooth)


def test_scales_equal_specification():
    severe = MilitaryIntensity(45 * 1852 / 3600, 1e-5)
    # 100 ft: Lu = 100/(0.177 + 0.0823)^1.2 ft, sigma_u/sigma_w = (0.2593)^-0.4 (figures 10 and 11);
    # W20 = 75.95 ft/s.
    lengths, sigmas = severe.scales(100 * FT, DRYDEN_LENGTH)
    np.testing.assert_allclose(np.asarray(lengths) / FT, [505.1693, 505.1693, 100.0], rtol=1e-5)
    np.testing.assert_allclose(np.asarray(sigmas) / FT, [13.0322, 13.0322, 7.59514], rtol=1e-5)
    # 1000 ft: isotropic, L = 1000 ft.
    lengths, sigmas = severe.scales(1000 * FT, DRYDEN_LENGTH)
    np.testing.assert_allclose(np.asarray(lengths) / FT, 1000.0, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(sigmas) / FT, 7.59514, rtol=1e-5)
    # Above 2000 ft: 1750 ft or 2500 ft, sigmas of figure 7; 23.6 ft/s at 7500 ft, half way to 22.1
    # ft/s at 11,250 ft.
    for feet, sigma in ((7500, 23.6), (11250, 22.85), (55000, 12.1), (200_000, 5.1)):
        lengths, sigmas = severe.scales(feet * FT, VON_KARMAN_LENGTH)
        np.testing.assert_allclose(np.asarray(lengths) / FT, 2500.0, rtol=1e-12)
        np.testing.assert_allclose(np.asarray(sigmas) / FT, sigma, rtol=1e-12)
    # In between, straight: at 1500 ft half of each. Figure 7 at 2000 ft is 17.6 + 5.4/8 ft/s.
    lengths, sigmas = severe.scales(1500 * FT, DRYDEN_LENGTH)
    np.testing.assert_allclose(np.asarray(lengths) / FT, 1375.0, rtol=1e-12)
    np.testing.assert_allclose(np.asarray(sigmas) / FT, (7.59514 + 17.6 + 5.4 / 8) / 2, rtol=1e-5)
    # Ten feet is the lowest; a probability between two curves lies between them.
    np.testing.assert_array_equal(
        severe.scales(1.0, 1.0).lengths, severe.scales(10 * FT, 1.0).lengths
    )
    between = MilitaryIntensity(1.0, 10**-2.5).sigma_aloft(7500 * FT)
    np.testing.assert_allclose(between / FT, (6.7 + 10.1) / 2, rtol=1e-12)


@pytest.fixture(scope="module", params=[dryden, von_karman], ids=["dryden", "von_karman"])
def gusts_of(request):
    """Gusts of one kind by key, speed and intensity, at times that end in padding."""
    t = jnp.concatenate([T[:20], T[19:20], T[19:20]])
    return jax.jit(lambda key, V, intensity: request.param(key, t, V, 3000.0, intensity, span=SPAN))


def test_gusts_depend_on_key(gusts_of, key):
    one, two = jax.random.split(key)
    np.testing.assert_array_equal(gusts_of(one, V, FIXED), gusts_of(one, V, FIXED))
    assert not np.any(gusts_of(one, V, FIXED) == gusts_of(two, V, FIXED))
    np.testing.assert_array_equal(gusts_of(one, V, FixedIntensity((0.0, 0.0, 0.0), LENGTHS)), 0.0)


def test_derivatives_at_repeated_times_are_finite(gusts_of, key):
    gusts, slope = jax.jit(
        lambda V: jax.jvp(lambda V: gusts_of(key, V, FIXED), (V,), (jnp.ones(()),))
    )(jnp.array(V))
    assert np.isfinite(slope).all()
    assert np.any(slope != 0, axis=0).all()
    np.testing.assert_array_equal(gusts[-1], gusts[19])


def test_severities_equal_intensities():
    moderate = as_intensity("moderate")
    assert isinstance(moderate, MilitaryIntensity)
    np.testing.assert_allclose(moderate.wind_at_20ft, 30 * 1852 / 3600, rtol=1e-15)
    np.testing.assert_allclose(moderate.sigma_aloft(7500 * FT) / FT, 10.1, rtol=1e-12)
    with pytest.raises(InputError, match=r"no gust severity 'heavy'.*light, moderate, severe"):
        as_intensity("heavy")


def test_white_gusts_have_their_variance(key):
    many = np.asarray(white_gusts(key, jnp.arange(40_000.0), REPORT_GUSTS))
    assert (many[:, 2:] == 0).all()
    np.testing.assert_allclose(REPORT_GUSTS["gust_u"] / FT, 21.2, rtol=1e-12)
    low, high = chi2.ppf([CHANCE / 4, 1 - CHANCE / 4], 40_000) / 40_000
    power = (many[:, :2] ** 2).mean(axis=0) / (21.2 * FT) ** 2
    assert (power > low).all()
    assert (power < high).all()
    np.testing.assert_array_equal(many, white_gusts(key, jnp.arange(40_000.0), REPORT_GUSTS))


def gust(make=dryden, **changes):
    t = changes.pop("t", T[:4])
    given = {"V": V, "altitude": 100.0, "intensity": "light", "span": SPAN} | changes
    return make(
        jax.random.key(0), t, given.pop("V"), given.pop("altitude"), given.pop("intensity"), **given
    )


REFUSALS = {
    "speed": (lambda: gust(V=0.0), r"speed of 0.0 m/s.*positive speed V"),
    "span": (lambda: gust(von_karman, span=-1.0), r"wing span is -1.0 m.*positive"),
    "time": (lambda: gust(t=jnp.array([0.0, 1.0, 0.5])), r"run backwards.*Sort"),
    "severity": (
        lambda: gust(intensity=FixedIntensity((1.0, -1.0, 1.0), LENGTHS)),
        r"sigma is "
        r".*-1.*zero "
        r"or more",
    ),
    "length": (
        lambda: FixedIntensity((1.0, 1.0, 1.0), (0.0, 1.0, 1.0)),
        r"length scale is "
        r".*0.*positive",
    ),
    "wind": (lambda: MilitaryIntensity(-3.0, 1e-3), r"wind at 20 ft is -3.0.*zero or more"),
    "probability": (lambda: MilitaryIntensity(3.0, 0.5), r"0.5.*1e-6 to 0.2"),
    "band": (lambda: gust(von_karman, highest=-1.0), r"ends at -1.0 Hz.*positive"),
    "count": (lambda: gust(von_karman, count=0), r"0 sinusoids.*at least one"),
    "rate": (lambda: gust(von_karman, t=T[:1]), r"one sample time.*highest"),
    "white": (
        lambda: white_gusts(jax.random.key(0), T, {"gust_v": -1.0}),
        r"'gust_v' is "
        r"-1.0.*zero or more",
    ),
    "name": (lambda: white_gusts(jax.random.key(0), T, {"v": 1.0}), r"no gust 'v'.*gust_u, gust_v"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_invalid_arguments_raise_error(case):
    make, words = REFUSALS[case]
    with pytest.raises(InputError, match=words):
        make()
