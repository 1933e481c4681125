"""What one record gives a regression: the equations of a model, solved for what they shall explain."""

import equinox as eqx

from .._foundation.types import Array, Bool, Float

Terms = tuple[tuple[str, tuple[str, ...]], ...]


class PseudoMeasurements(eqx.Module):
    """Responses and signals of a record, and which terms each response admits (report section 3.2.2.3, Table 3.2).

    A response is named as the polynomial of the model that it determines, such as `Cm`.

    Args:
        t: time, shape (time,) [s].
        responses: what each regression explains, by name, each of shape (time,).
        signals: the factors of the terms by name, each of shape (time,).
        valid: True where all that is needed was measured, shape (time,).
        candidates: by response, the terms that it admits.
        centred: signals of which a term holds the difference from their mean over the records.
    """

    t: Float[Array, " time"]
    responses: dict[str, Float[Array, " time"]]
    signals: dict[str, Float[Array, " time"]]
    valid: Bool[Array, " time"]
    candidates: Terms = eqx.field(static=True)
    centred: tuple[str, ...] = eqx.field(static=True, default=())
