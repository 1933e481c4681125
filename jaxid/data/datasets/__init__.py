"""Measured sets that others have used too, split as their makers split them; the files are not part of jaxid."""

from .base import DataSet as DataSet
from .cascaded_tanks import cascaded_tanks as cascaded_tanks
from .emps import emps as emps
from .emps import emps_closed_loop as emps_closed_loop
from .silverbox import silverbox as silverbox
