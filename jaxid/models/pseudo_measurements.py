"""Data of a regression from one record: the equations of a model, pointwise or in weak form."""

import equinox as eqx

from .._foundation.types import Array, Bool, Float

Terms = tuple[tuple[str, tuple[str, ...]], ...]


class PseudoMeasurements(eqx.Module):
    """Responses and signals of a record, and the candidate terms of each response (report section
    3.2.2.3, Table 3.2).

    The name of a response is the name of the polynomial that it determines, such as `Cm`.

    Args:
        t: time, shape (time,) [s].
        responses: dependent variable of each regression by name, each of shape (time,).
        signals: the factors of the terms by name, each of shape (time,).
        valid: True where all required channels were measured, shape (time,).
        candidates: candidate terms by response.
        centred: signals that enter the terms as differences from their mean over the records.
        known: part of a response that the polynomial does not have, such as wind-tunnel tables,
            each of shape (time,); the regression takes the rest. Zero where it is absent.
    """

    t: Float[Array, " time"]
    responses: dict[str, Float[Array, " time"]]
    signals: dict[str, Float[Array, " time"]]
    valid: Bool[Array, " time"]
    candidates: Terms = eqx.field(static=True)
    centred: tuple[str, ...] = eqx.field(static=True, default=())
    known: dict[str, Float[Array, " time"]] = eqx.field(default_factory=dict)

    def unknown(self, name: str) -> Float[Array, " time"]:
        """Return a response without its known part.

        Args:
            name: response.
        """
        response = self.responses[name]
        return response - self.known[name] if name in self.known else response


class WeakMeasurements(eqx.Module):
    """Equations of a record for a regression in weak form, without derivatives of its channels.

        multiplier_c c = sum_d (d/dt)^d part_cd      for each response c

    Args:
        t: time, shape (time,) [s].
        multipliers: multiplier of each response, shape (time,).
        parts: signals by order of the derivative, from zero, of each response; each of shape
            (time,). For a pitching moment: all moments except the angular acceleration's, and
            the angular momentum.
        signals: the factors of the terms by name, each of shape (time,).
        valid: True where all required channels were measured, shape (time,).
        candidates: candidate terms by response.
        centred: signals that enter the terms as differences from their mean over the records.
    """

    t: Float[Array, " time"]
    multipliers: dict[str, Float[Array, " time"]]
    parts: dict[str, tuple[Float[Array, " time"], ...]]
    signals: dict[str, Float[Array, " time"]]
    valid: Bool[Array, " time"]
    candidates: Terms = eqx.field(static=True)
    centred: tuple[str, ...] = eqx.field(static=True, default=())
