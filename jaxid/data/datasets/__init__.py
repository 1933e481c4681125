"""Loaders of published measured data sets with their official split; jaxid does not include the
files.
"""

from .base import DataSet as DataSet
from .cascaded_tanks import cascaded_tanks as cascaded_tanks
from .emps import emps as emps
from .emps import emps_closed_loop as emps_closed_loop
from .f16_vibration import f16_vibration as f16_vibration
from .nonlinear_benchmarks import from_benchmarks as from_benchmarks
from .silverbox import silverbox as silverbox
from .wiener_hammerstein import wiener_hammerstein as wiener_hammerstein
