"""Cells, delimiters and lengths that a program in Python would accept or fail on by accident."""

import numpy as np
import pytest

import jaxid
from jaxid._foundation.checks import InputError
from jaxid.data.build import record as build_record
from jaxid.data.stack import segment


def write(folder, cell="1.0"):
    path = folder / "a.csv"
    path.write_text(f"t,u,x\n0,1,{cell}\n0.1,1,2\n0.2,1,3\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("cell", ["1_000", "\u0661\u0662", "\uff11.5", "0x10", "1\u22122"])
def test_cell_that_is_no_plain_number_raises_error_with_its_line(cell, tmp_path):
    with pytest.raises(InputError, match=r"a\.csv, line 2, column 'x': .* is not a number"):
        jaxid.read_csv(write(tmp_path, cell), inputs=("u",), outputs=("x",))


@pytest.mark.parametrize(("cell", "value"), [("+1e3", 1000.0), (" -.5 ", -0.5), ("1E-2", 0.01)])
def test_cell_with_plain_number_is_read(cell, value, tmp_path):
    record = jaxid.read_csv(write(tmp_path, cell), inputs=("u",), outputs=("x",))
    assert float(record.z[0, 0]) == value


@pytest.mark.parametrize("delimiter", ["", ",,", "\n", '"'])
def test_delimiter_that_is_not_one_character_raises_error(delimiter, tmp_path):
    with pytest.raises(InputError, match="Give one character"):
        jaxid.read_csv(write(tmp_path), inputs=("u",), outputs=("x",), delimiter=delimiter)


@pytest.mark.parametrize("seconds", [1e-9, 1e-300, 5e-324])
def test_pieces_shorter_than_two_samples_raise_error_before_they_are_made(seconds):
    t = 0.1 * np.arange(100)
    record = build_record(t=t, u=t, z=t, inputs=("u",), outputs=("x",))
    with pytest.raises(InputError, match="100 samples make at most 50 pieces"):
        segment(record, seconds)
