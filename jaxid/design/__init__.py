"""Design of experiments: measures of information, inputs, spectra and experiment points."""

from .approximate import approximate_design
from .design import Comparison, Design
from .dynamic_programming import square_wave_design
from .equation_error import equation_error_information
from .exchange import Allocation, allocate
from .explanations import Explanation, expected_chi_square
from .information import PlannedInformation, compare_inputs, information_of, planned_record
from .input_design import design_input
from .limits import Limits
from .linear.describing_functions import QuasiLinearSpectrum, quasi_linear_spectrum
from .linear.frequency import OptimalSpectrum, optimal_spectrum
from .linear.time_domain import energy_limited_input
from .measures import (
    AbstractMeasure,
    Combination,
    CurveWidth,
    Determinant,
    SmallestEigenvalue,
    SubsetDeterminant,
    Trace,
    curve_width,
)
from .objectives import (
    Discrimination,
    InformationObjective,
    MutualDiscrimination,
    RobustObjective,
)
from .polynomials.experiment_points import (
    Candidates,
    ExperimentPoints,
    at_most,
    candidates,
    optimal_points,
)
from .polynomials.polynomial_terms import (
    PolynomialTerms,
    Visited,
    equal_time,
    half_ranges,
    polynomial_terms,
    sinusoid,
    visited,
)
from .requirements.input_check import check_input
from .requirements.requirements import Check, Criterion, InputCheck, Requirements, Verdict
from .sensors import SensorSet, sensor_sets
from .shapes import AbstractShape, Multisine, Spline, SquareWave, multisine, spline, square_wave
from .signals import (
    InputSignal,
    alternating_pulses,
    combine,
    conventional_inputs,
    multisine_inputs,
    sample_times,
)

__all__ = [
    "AbstractMeasure",
    "AbstractShape",
    "Allocation",
    "Candidates",
    "Check",
    "Combination",
    "Comparison",
    "Criterion",
    "CurveWidth",
    "Design",
    "Determinant",
    "Discrimination",
    "ExperimentPoints",
    "Explanation",
    "InformationObjective",
    "InputCheck",
    "InputSignal",
    "Limits",
    "Multisine",
    "MutualDiscrimination",
    "OptimalSpectrum",
    "PlannedInformation",
    "PolynomialTerms",
    "QuasiLinearSpectrum",
    "Requirements",
    "RobustObjective",
    "SensorSet",
    "SmallestEigenvalue",
    "Spline",
    "SquareWave",
    "SubsetDeterminant",
    "Trace",
    "Verdict",
    "Visited",
    "allocate",
    "alternating_pulses",
    "approximate_design",
    "at_most",
    "candidates",
    "check_input",
    "combine",
    "compare_inputs",
    "conventional_inputs",
    "curve_width",
    "design_input",
    "energy_limited_input",
    "equal_time",
    "equation_error_information",
    "expected_chi_square",
    "half_ranges",
    "information_of",
    "multisine",
    "multisine_inputs",
    "optimal_points",
    "optimal_spectrum",
    "planned_record",
    "polynomial_terms",
    "quasi_linear_spectrum",
    "sample_times",
    "sensor_sets",
    "sinusoid",
    "spline",
    "square_wave",
    "square_wave_design",
    "visited",
]
