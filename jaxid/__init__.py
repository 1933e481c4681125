"""Differentiable system identification: estimate, find the effect that the model lacks, add it.

Call `configure()` before the first array is made: jaxid computes in float64.
"""

from . import batches, data, design, diagnosis, effects, models, structure, study, uncertainty
from ._foundation.checks import InputError
from ._foundation.configuration import configure
from .batches import estimate_many, multi_start
from .data import (
    Record,
    from_xarray,
    read_csv,
    read_mat,
    read_sidpac,
    record,
    segment,
    smoothing,
    split,
    stack,
    to_xarray,
    write_csv,
)
from .diagnosis import predict, prediction_bands, residual_tests
from .effects import Augmented, Effect
from .estimation import (
    AutoregressiveNoise,
    Estimate,
    FilterError,
    FirstOrder,
    Fixed,
    GaussNewton,
    InnovationForm,
    OutputError,
    estimate,
    smooth_states,
)
from .estimation import spectrum_policy as spectrum
from .models import (
    AbstractModel,
    DiagonalNoise,
    FixedNoise,
    Free,
    FullNoise,
    HuberNoise,
    LinearModel,
    Polynomial,
    StudentNoise,
    free,
    load,
    save,
)
from .simulation import RK4, Adaptive, hold, simulate
from .study import (
    Identification,
    LoopOptions,
    Outcome,
    Study,
    advice,
    close_loop,
    consistency,
    identify,
)
from .uncertainty import propagate

__all__ = [  # noqa: RUF022 (grouped by subject)
    # Set-up
    "configure",
    # Modules: the rest of the library, by subject
    "batches",
    "data",
    "design",
    "diagnosis",
    "effects",
    "hold",
    "models",
    "smoothing",
    "spectrum",
    "structure",
    "study",
    "uncertainty",
    # Records
    "Record",
    "record",
    "read_csv",
    "read_mat",
    "read_sidpac",
    "write_csv",
    "from_xarray",
    "to_xarray",
    "stack",
    "split",
    "segment",
    # Models
    "AbstractModel",
    "LinearModel",
    "Polynomial",
    "Free",
    "free",
    "save",
    "load",
    "AutoregressiveNoise",
    "DiagonalNoise",
    "FixedNoise",
    "FullNoise",
    "HuberNoise",
    "StudentNoise",
    # Effects
    "Effect",
    "Augmented",
    # Simulation
    "simulate",
    "RK4",
    "Adaptive",
    # Estimation
    "estimate",
    "estimate_many",
    "multi_start",
    "Estimate",
    "OutputError",
    "FilterError",
    "InnovationForm",
    "FirstOrder",
    "Fixed",
    "smooth_states",
    "GaussNewton",
    "propagate",
    # Diagnosis
    "predict",
    "prediction_bands",
    "residual_tests",
    # Studies
    "advice",
    "close_loop",
    "Study",
    "Outcome",
    "LoopOptions",
    "identify",
    "Identification",
    "consistency",
    # Errors
    "InputError",
]
