"""Methods of `Problem`, each compiled as one program.

Called by themselves they compile every operation on its own, more than a hundred of them.
"""

import equinox as eqx

from jaxid.estimation.problem import Problem

cost = eqx.filter_jit(Problem.cost)
evaluate = eqx.filter_jit(Problem.evaluate)
linearise = eqx.filter_jit(Problem.linearise)
outputs = eqx.filter_jit(Problem.outputs)
residuals = eqx.filter_jit(Problem.residuals)
sensitivities = eqx.filter_jit(Problem.sensitivities)
