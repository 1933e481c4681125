"""A static model of two parameters, for closed forms of ordinary least squares."""

import jax

from jaxid.models import AbstractModel


class Line(AbstractModel):
    """A static model: `y = slope u + level`."""

    slope: jax.Array
    level: jax.Array
    states, inputs, outputs = (), ("u",), ("y",)

    def rhs(self, t, x, u):
        return x

    def output(self, t, x, u):
        return self.slope * u + self.level
