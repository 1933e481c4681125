"""Loaders of published measured data sets with their official split; jaxid does not include the
files.
"""

from .base import DataSet as DataSet
from .cascaded_tanks import cascaded_tanks as cascaded_tanks
from .emps import emps as emps
from .emps import emps_closed_loop as emps_closed_loop
from .silverbox import silverbox as silverbox
