"""A linear oscillator with two outputs."""

from jaxid.models import LinearModel

OSCILLATOR = LinearModel(
    [[0.0, 1.0], [-2.0, -0.4]],
    [[0.0], [1.0]],
    [[1.0, 0.0], [0.3, 1.0]],
    [[0.0], [0.0]],
    states=("x", "v"),
    inputs=("f",),
    outputs=("a", "b"),
)
