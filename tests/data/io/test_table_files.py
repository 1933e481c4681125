"""Tables from files: values in SI, errors for every gap of the grid."""

import numpy as np
import pytest

from jaxid._foundation.checks import InputError
from jaxid.data.io.table import read_table

GOOD = "alpha_deg,beta_deg,Cm,origin\n-10,0,1,M:a\n-10,5,2,\n20,0,3,R:b\n20,5,4,R:c\n"


@pytest.fixture
def read(tmp_path):
    def reader(text, **options):
        path = tmp_path / "Cm.csv"
        path.write_text(text, encoding="utf-8")
        return read_table(path, **({"axes": ("alpha", "beta"), "value": "Cm"} | options))

    return reader


def test_table_file_is_read_in_si_with_origin(read):
    grid = read(GOOD)
    np.testing.assert_allclose(
        grid.knots, [np.deg2rad([-10.0, 20.0]), np.deg2rad([0.0, 5.0])], rtol=1e-15
    )
    assert (grid.axes, grid.units, grid.unit) == (("alpha", "beta"), ("rad", "rad"), "")
    assert grid.values.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    assert grid.origin.tolist() == [["M:a", ""], ["R:b", "R:c"]]


def test_axes_are_in_requested_order(read):
    assert read(GOOD, axes=("beta", "alpha")).values.tolist() == [[1.0, 3.0], [2.0, 4.0]]


def test_rows_are_accepted_in_any_order_with_increasing_knots(read):
    header, a, b, c, d = GOOD.splitlines()
    assert read("\n".join([header, a, c, b, d])).values.tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_table_file_has_units_of_values_and_axes_without_unit(read):
    grid = read(
        "altitude_ft,mach,idle_lbf,mil_lbf\n0,0,0,1\n0,1,0,2\n1000,0,0,3\n1000,1,0,4\n",
        axes=("altitude", "mach"),
        value="mil",
    )
    assert (grid.units, grid.unit, grid.origin) == (("m", ""), "N", None)
    np.testing.assert_allclose(grid.knots[0], [0.0, 304.8], rtol=1e-15)
    np.testing.assert_allclose(grid.values[1, 1], 4 * 4.4482216152605, rtol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (GOOD, "", r"Cm.csv is empty"),
        (GOOD, "alpha_deg,beta_deg,Cm\n", r"Cm.csv has a header and no row below it"),
        (
            "beta_deg",
            "gamma_deg",
            r"Cm.csv has no column 'beta', nor one such as 'beta_deg'.*alpha_deg, gamma_deg, Cm, "
            r"origin",
        ),
        ("Cm,", "CM,", r"Cm.csv has no column 'Cm'"),
        ("origin", "alpha_rad", r"Cm.csv: more than one column can be 'alpha'"),
        (
            "alpha_deg",
            "alpha_dge",
            r"(?s)Cm.csv: .*'alpha_dge'.*'dge' is not known.*Did you mean "
            r".*'deg'",
        ),
        ("20,5,4", "20,5,x", r"Cm.csv, line 5, column 'Cm': 'x' is not a finite number"),
        ("20,5,4", "20,5,", r"Cm.csv, line 5, column 'Cm': '' is not a finite number"),
        ("20,5,4", "20,5,nan", r"Cm.csv, line 5, column 'Cm': 'nan' is not a finite number"),
        ("20,5,4", "20,inf,4", r"Cm.csv, line 5, column 'beta_deg': 'inf' is not a finite number"),
        (
            "20,5,4",
            "20,0,4",
            r"Cm.csv, line 5: the grid point alpha_deg 20, beta_deg 0 is already in line 4. "
            r"Remove one",
        ),
        (
            "20,5,4,R:c\n",
            "",
            r"Cm.csv: 1 of 4 grid points are missing; the first, alpha_deg 20, beta_deg 5, .* "
            r"after line 4",
        ),
        (
            "-10,0,1,M:a\n-10,5,2,\n",
            "30,0,1,\n30,5,2,\n",
            r"line 4, column 'alpha_deg': .*20 comes "
            r"after 30. Sort",
        ),
        ("20,0,3,R:b\n20,5,4,R:c\n", "", r"column 'alpha_deg': there is one knot, -10"),
        ("20,5,4,R:c", "20,5,4", r"Cm.csv, line 5: 3 cells, and the header has 4"),
    ],
)
def test_invalid_table_files_are_refused_with_row_and_remedy(read, old, new, words):
    with pytest.raises(InputError, match=words):
        read(GOOD.replace(old, new))


def test_missing_table_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="There is no file"):
        read_table(tmp_path / "none.csv", axes=("alpha",), value="Cm")
