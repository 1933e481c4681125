"""Identification settings of each of the report's cases: the report's choices and our own.

From the report: the propagated motion (section 6.2.3.1), the fitted outputs (those whose noise its
tables list), the omission of the equation of u in the coupled case (6.4.4), and the bias of beta in
lateral cases 1 to 3 (Tables 6.5, 6.8, 6.10; Tables 6.14 and 6.16 have none). Levels, rules and
constants are those of `IdentifyOptions`, which are the report's.

Our own, because the report gives no setting:

- Initial states are estimated, except for the speed along x and the heading: the outputs hardly
  depend on these, and they start at the measured values.
- The instruments of the model are the report's before a flight draws its errors: the analyst knows
  that the vanes are 34 ft ahead of the centre of gravity, and does not know a flight's errors of
  scale, bias, place and axis. The square of the speed is measured with a scale error of 1 %, which
  every coefficient shares; the axes of accelerometers and gyros are off by 0.6 deg, which puts 1 %
  of CZ into CX and CY.
- Surfaces, thrust and altitude are known: Table 6.6 has no errors for them. Angular accelerations
  are recorded, as in the report.
- Each flight draws new errors of its instruments, from the seed and the number of its case.
- Lateral 3 is also identified by filter error. The gusts of its flight are white at the samples and
  linear between them, which has the spectrum at low frequency of a process of first order with half
  the sample time as correlation time; their deviation is estimated. The noise of the sensors is
  as in Table 6.6.
"""

from typing import NamedTuple

import jax
from jaxtyping import Array

from jaxid.aircraft.air.turbulence import REPORT_GUST
from jaxid.aircraft.flight.report_cases import CASES, EXAMPLES, REPORT_SAMPLE_TIME
from jaxid.aircraft.instruments.noise_levels import BASE as BASE_LEVEL
from jaxid.estimation import FilterError, FirstOrder, Fixed
from jaxid.simulation import RK4

BIAS = "instruments.bias."


class Setting(NamedTuple):
    """Propagated states, fitted outputs and estimated parameters of a case.

    Attributes:
        states: group of states of `IdentificationModel`.
        outputs: channels that maximum likelihood fits.
        initial: states whose initial value is estimated.
        add: parameters in addition to terms and constants.
        leave_out: responses whose equation is left out.
        measured: inputs in addition to those that `from_aircraft` takes, such as a thrust that
            differs from flight to flight.
        smoothed: channels that a spline smooths first.
    """

    states: str
    outputs: tuple[str, ...]
    initial: tuple[str, ...]
    add: tuple[str, ...] = ()
    leave_out: tuple[str, ...] = ()
    measured: tuple[str, ...] = ()
    smoothed: tuple[str, ...] = ()


LATERAL = Setting("lateral", ("beta", "ay", "p", "r"), ("v", "p", "r", "phi"), (BIAS + "beta",))
LONGITUDINAL = Setting("longitudinal", ("alpha", "ax", "az", "q"), ("w", "q", "pitch"))
COUPLED = Setting(
    "coupled",
    ("alpha", "beta", "ay", "az", "p", "q", "r"),
    ("v", "w", "p", "q", "r", "phi", "pitch"),
    leave_out=("CX",),
)
SETTINGS = {
    **dict.fromkeys(("lateral 1", "lateral 2", "lateral 3"), LATERAL),
    "lateral 4": LATERAL._replace(add=()),
    **dict.fromkeys(("longitudinal 1", "longitudinal 2"), LONGITUDINAL),
    **dict.fromkeys(("coupled 1", "coupled 2"), COUPLED),
}


FILTER_SUBSTEPS = 4  # of RK4 between samples: half of the correlation time (chosen)


def gust_filter(setting: Setting = LATERAL) -> FilterError:
    """Return filter error with a lateral gust, for lateral 3.

    Args:
        setting: setting of the case.
    """
    return FilterError(
        process={"gust_v": FirstOrder(REPORT_GUST, Fixed(REPORT_SAMPLE_TIME / 2.0))},
        noise={name: Fixed(BASE_LEVEL.noise[name]) for name in setting.outputs},
        stepper=RK4(FILTER_SUBSTEPS),
    )


def key_of(case: str, seed: int) -> Array:
    """Return the random key of a flight.

    Args:
        case: name in `CASES` or `EXAMPLES`.
        seed: of the benchmark.
    """
    return jax.random.fold_in(jax.random.key(seed), list(CASES | EXAMPLES).index(case))
