"""xarray: an exact round trip of records and stacks, and conversion of external datasets."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from record_strategies import alike, assert_same, records

from jaxid._foundation.checks import InputError
from jaxid.data import from_xarray, record, stack, to_xarray


@settings(max_examples=50)
@given(records())
def test_record_round_trip_is_exact(make):
    r = make()
    assert_same(from_xarray(to_xarray(r)), r)


@settings(max_examples=30)
@given(alike(), st.none() | st.integers(9, 11))
def test_stack_round_trip_is_exact(makes, pad_to):
    s = stack([make() for make in makes], pad_to)
    assert_same(from_xarray(to_xarray(s)), s)


def example():
    z = [[0.1, 1.0], [np.nan, 2.0], [0.3, 3.0]]
    units = {"alpha": "rad", "de": "rad"}
    return record(
        [0, 1, 2],
        [1.0, 2.0, 3.0],
        z,
        inputs=("de",),
        outputs=("alpha", "q"),
        units=units,
        name="run",
        constants={"mass": 5.0},
    )


def test_dataset_of_record_has_units_roles_and_coordinates():
    ds = to_xarray(example())
    assert ds["alpha"].dims == ("t",)
    assert ds["alpha"].attrs == {"units": "rad", "role": "output"}
    np.testing.assert_array_equal(ds["alpha"], [0.1, np.nan, 0.3])
    assert float(ds["q"].sel(t=1.0)) == 2.0
    assert (float(ds["mass"]), ds.attrs["name"]) == (5.0, "run")
    two = to_xarray(stack([example(), example().window(0, 2)]))
    assert two["q"].dims == ("case", "row")
    assert list(two["case"].values) == ["run", "run"]
    assert np.isnan(two["q"].values[1, 2])


def test_dataset_of_window_without_a_sample_of_an_output_is_refused():
    run = record(
        [0, 1, 2, 3],
        None,
        [[1.0, 2.0]] * 2 + [[np.nan, 3.0]] * 2,
        inputs=(),
        outputs=("alpha", "q"),
    )
    windows = to_xarray(stack([run, run.window(2, 4)]))
    with pytest.raises(InputError, match="output 'alpha' has no valid sample"):
        from_xarray(windows)


def test_external_dataset_converts_with_units_and_selected_channels():
    ds = xr.Dataset(
        {
            "alpha": ("t", [1.0, 2.0, np.nan], {"units": "deg"}),
            "de": ("t", [0.0, 1.0, 2.0]),
            "note": ((), 3.0),
        },
        coords={"t": ("t", [0.0, 20.0, 40.0], {"units": "ms"})},
    )
    r = from_xarray(ds, inputs=["de"], outputs=["alpha"])
    np.testing.assert_allclose(r.t, [0, 0.02, 0.04], rtol=1e-15)
    np.testing.assert_allclose(r.z[:2, 0], np.deg2rad([1, 2]), rtol=1e-15)
    assert not bool(r.mask[2, 0])
    assert r.constants == {}


def test_invalid_datasets_are_refused_with_reason():
    ds = to_xarray(example())
    with pytest.raises(InputError, match=r"no coordinate 't'.*Rename"):
        from_xarray(ds.rename(t="time"))
    with pytest.raises(InputError, match=r"no variable 'alfa'.*Did you mean 'alpha'"):
        from_xarray(ds, outputs=["alfa"])
    with pytest.raises(InputError, match=r"Channel 'mass'.*same axes"):
        from_xarray(ds, outputs=["mass"])
    bare = xr.Dataset({"y": ("t", [1.0, 2.0])}, coords={"t": [0.0, 1.0]})
    with pytest.raises(InputError, match=r"role 'output'.*Name the channels"):
        from_xarray(bare)
    with pytest.raises(InputError, match=r"input 'de' is NaN at row 1"):
        from_xarray(ds.assign(de=("t", [1.0, np.nan, 1.0], ds["de"].attrs)))
    clash = record([0, 1], None, [1, 2], inputs=(), outputs=("case",))
    with pytest.raises(InputError, match=r"'case'.*Rename"):
        to_xarray(clash)
