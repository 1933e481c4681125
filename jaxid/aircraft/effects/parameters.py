"""Effects of aircraft: parameters with other values than declared.

These are mass, inertia, centre of gravity, thrust, wind, and the geometry of the instruments.
"""
# Pyright counts equinox's abstract fields as arguments of the constructor; at run time they are
# none.
# pyright: reportCallIssue=false, reportArgumentType=false

from collections.abc import Mapping, Sequence

from ...effects.base import Effect
from ...effects.parameter import STEP_FRACTIONS, ParameterDrift, ParameterShift, ParameterStep

INERTIA = {
    **{name: f"moment of inertia {name}" for name in ("Ix", "Iy", "Iz")},
    "Ixz": "product of inertia Ixz",
}
MORE_INERTIA = {name: f"product of inertia {name}" for name in ("Ixy", "Iyz")}
ACCELEROMETERS = ("ax", "ay", "az")
# chosen: all lever arms of the accelerometers, and the distance of the vanes from the centre of
# gravity, to which their readings are most sensitive
SENSOR_COORDINATES = (
    *("alpha.x", "beta.x"),
    *(f"{channel}.{axis}" for channel in ACCELEROMETERS for axis in "xyz"),
)
# chosen: for each instrument, the angle to which its reading is most sensitive
SENSOR_ANGLES = ("p.theta", "r.theta", "ax.theta", "ay.phi")


def mass_effects(names: Sequence[str]) -> tuple[Effect, ...]:
    """Return all effects on mass, inertia and centre of gravity.

    Args:
        names: names of all parameters.
    """
    return (
        *shifts(names, {"mass": "mass"}, "kg"),
        *changes_of_mass(names, STEP_FRACTIONS),
        *shifts(names, INERTIA | MORE_INERTIA, "kg*m^2"),
        *centre_of_gravity(names, "xyz"),
    )


def air_effects(names: Sequence[str]) -> tuple[Effect, ...]:
    """Return all effects on wind, wind shear and air temperature.

    Args:
        names: names of all parameters.
    """
    steady = {
        f"wind.{name}": f"{word} wind"
        for name, word in (("north", "northward"), ("east", "eastward"))
    }
    shear = {
        f"wind.{name}_shear": f"shear of the {name} wind" for name in ("north", "east", "down")
    }
    return (
        *shifts(names, steady | {"wind.down": "downward wind"}, "m/s"),
        *shifts(names, shear, "1/s"),
        *shifts(names, {"atmosphere.warmer": "temperature of the air"}, "K"),
    )


def shifts(names: Sequence[str], labels: Mapping[str, str], unit: str) -> tuple[Effect, ...]:
    """Return shifts of parameters from their declared values.

    Args:
        names: names of all parameters; others are left out.
        labels: description by dotted name.
        unit: unit of all these parameters.
    """
    return tuple(
        ParameterShift(name, label=description, unit=unit)
        for name, description in labels.items()
        if name in names
    )


def changes_of_mass(names: Sequence[str], moments: Sequence[float]) -> tuple[Effect, ...]:
    """Return a drift of the mass (fuel) and steps of the mass (dropped stores).

    The drift begins at the declared mass at the first training time.

    Args:
        names: names of all parameters.
        moments: initial times of a drop, as fractions of the duration of the records.
    """
    if "mass" not in names:
        return ()
    return (
        ParameterDrift("mass", unit="kg", from_start=True),
        *(ParameterStep("mass", moment, unit="kg") for moment in moments),
    )


def centre_of_gravity(names: Sequence[str], axes: str) -> tuple[Effect, ...]:
    """Return shifts of the centre of gravity.

    Reference point, engines and instruments all move in the opposite direction. A positive gain
    moves them forward, to the right and down, and thus the centre of gravity aft, to the left and
    up.

    Args:
        names: names of all parameters.
        axes: "x", "y", "z".
    """
    shifted = []
    for axis in axes:
        parts = [
            name
            for name in names
            if name.endswith(f".{axis}") and ("position." in name or name.startswith("reference."))
        ]
        if f"reference.{axis}" in parts:
            linked = tuple((name, 1.0) for name in parts if not name.startswith("reference."))
            label = f"position of the centre of gravity along {axis}"
            shifted.append(ParameterShift(f"reference.{axis}", linked, label=label, unit="m"))
    return tuple(shifted)


def thrust(names: Sequence[str], measured: bool = False) -> tuple[Effect, ...]:
    """Return effects on total thrust, thrust asymmetry, thrust line and angular momentum.

    The asymmetry of a single engine is a lateral offset of its thrust line; with more engines the
    first gains thrust and the last loses it. If the engines share a constant thrust, this thrust is
    shifted. If the thrust is measured, its error is a scale error of the input and is not among
    these effects.

    Args:
        names: names of all parameters.
        measured: True if the thrust of all engines is an input.
    """
    total = shifts(names, {"thrust": "thrust"}, "N")
    if not (total or measured):
        total = all_engines(names, "share", "thrust", "")
    shares = _engines(names, "share")
    asymmetry: tuple[Effect, ...] = ()
    if len(shares) > 1:
        asymmetry = (ParameterShift(shares[0], ((shares[-1], -1.0),), label="symmetry of thrust"),)
    elif shares:
        asymmetry = shifts(
            names, {"engines.0.position.y": "sideways position of the thrust line"}, "m"
        )
    return (
        *total,
        *asymmetry,
        *all_engines(names, "position.z", "height of the thrust line", "m"),
        *all_engines(names, "momentum", "angular momentum of the engines", "kg*m^2/s"),
    )


def sensor_positions(names: Sequence[str], which: Sequence[str]) -> tuple[Effect, ...]:
    """Return shifts of the positions of instruments.

    Args:
        names: names of all parameters.
        which: channels and coordinates, such as "alpha.x".
    """
    labels = {name: f"position of the sensor of {name.replace('.', ' along ')}" for name in which}
    return _in_instruments(names, "position", labels, "m")


def accelerometer_packages(names: Sequence[str]) -> tuple[Effect, ...]:
    """Return shifts of all accelerometers together, one along each axis.

    Accelerometers are often mounted in one package, whose position is off as a whole. Without two
    accelerometers that have a position along an axis there is no such shift.

    Args:
        names: names of all parameters.
    """
    packages = []
    for axis in "xyz":
        entries = (f"instruments.position.{channel}.{axis}" for channel in ACCELEROMETERS)
        first, *others = [name for name in entries if name in names] or [""]
        if others:
            linked = tuple((name, 1.0) for name in others)
            label = f"position of all accelerometers along {axis}"
            packages.append(ParameterShift(first, linked, label=label, unit="m"))
    return tuple(packages)


def sensor_misalignments(names: Sequence[str], which: Sequence[str]) -> tuple[Effect, ...]:
    """Return misalignments of the axes of instruments.

    Args:
        names: names of all parameters.
        which: channels and angles, such as "p.theta".
    """
    labels = {name: f"axis of the sensor of {name.replace('.', ' in ')}" for name in which}
    return _in_instruments(names, "misalignment", labels, "rad")


def _in_instruments(
    names: Sequence[str], part: str, labels: Mapping[str, str], unit: str
) -> tuple[Effect, ...]:
    """Return shifts of one kind of instrument parameter, each located at its sensor."""
    return tuple(
        ParameterShift(
            f"instruments.{part}.{name}",
            label=description,
            unit=unit,
            channel=name.partition(".")[0],
        )
        for name, description in labels.items()
        if f"instruments.{part}.{name}" in names
    )


def all_engines(names: Sequence[str], part: str, label: str, unit: str) -> tuple[Effect, ...]:
    """Return a common shift of one parameter of all engines.

    Args:
        names: names of all parameters.
        part: name of the parameter within an engine.
        label: description of the parameter.
        unit: unit of the parameter.
    """
    first, *others = _engines(names, part) or ("",)
    if not first:
        return ()
    linked = tuple((name, 1.0) for name in others)
    return (ParameterShift(first, linked, label=label, unit=unit),)


def _engines(names: Sequence[str], part: str) -> tuple[str, ...]:
    """Return the dotted names of one parameter of all engines."""
    return tuple(
        name for name in names if name.startswith("engines.") and name.endswith(f".{part}")
    )


def instrument_entries(names: Sequence[str], part: str) -> tuple[str, ...]:
    """Return the entries of one kind of instrument parameter, such as "alpha.x".

    Args:
        names: names of all parameters.
        part: kind of parameter, such as "position".
    """
    prefix = f"instruments.{part}."
    return tuple(name.removeprefix(prefix) for name in names if name.startswith(prefix))
