"""Array types, written once, so that annotations read as the notation table does.

Axis names: `case` one record of a stack, `time` one sample, `state`, `input`, `output` one channel,
`parameter` one free parameter, `row` and `column` of a matrix without a name of its own.
"""

import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int, PyTree, Scalar

Numbers = Array | np.ndarray  # accepted by entry functions

__all__ = ["Array", "Bool", "Complex", "Float", "Int", "Numbers", "PyTree", "Scalar"]
