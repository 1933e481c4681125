"""Study files: valid files are read, invalid ones are refused with file, section and key."""

import tomllib

import numpy as np
import pytest
import scipy.io

from jaxid._foundation.checks import InputError
from jaxid.data.io.study import read_study

GOOD = """
title = "A spring"

[model]
use = "springs:Spring"
parameters = { k = 1.0, c = 1 }

[free]
parameters = ["k"]
bounds = { k = [0.0, inf] }

[records]
inputs = ["force"]
outputs = ["x"]
time = "s"
units = { x = "mm" }
constants = { mass = 2.0 }
derivatives = { x = "speed" }
train = ["a.csv", "more/b.csv"]
test = { slow = ["c.csv"], fast = ["d.csv"] }

[noise]
x = "0.5 mm"

[loop]
window = 3

[library]
leave_out = ["x^2 in v"]
"""


@pytest.fixture
def folder(tmp_path):
    """Four records of a second, x = 1000 sin(2 pi t) mm."""
    (tmp_path / "more").mkdir()
    t = 0.02 * np.arange(51)
    rows = np.column_stack([t, t, 1000 * np.sin(2 * np.pi * t)])
    for name in ("a", "more/b", "c", "d"):
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="s,force,x", comments="")
    return tmp_path


def read(folder, text):
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return read_study(folder / "study.toml")


def test_study_file_is_read_with_all_sections(folder):
    file = read(folder, GOOD)
    assert (file.title, file.path.name) == ("A spring", "study.toml")
    assert file.model == {"use": "springs:Spring", "parameters": {"k": 1.0, "c": 1}}
    assert file.free == {"parameters": ["k"], "bounds": {"k": [0.0, np.inf]}}
    assert (file.noise, file.loop, file.library) == (
        {"x": "0.5 mm"},
        {"window": 3},
        {"leave_out": ["x^2 in v"]},
    )
    assert [record.names[0] for record in file.train] == ["a", "b"]
    assert file.check is None
    assert {name: part[0].names for name, part in file.test.items()} == {
        "slow": ("c",),
        "fast": ("d",),
    }
    for record in (*file.train, *file.test["slow"]):
        assert (record.outputs, record.output_units) == (("x", "speed"), ("m", "m/s"))
        assert float(record.constants["mass"]) == 2.0
    t, speed = np.asarray(file.train[0].t), np.asarray(file.train[0].channel("speed"))
    # The derivative of a full period of a sine is exact except at the ends.
    np.testing.assert_allclose(
        speed[10:-10], 2 * np.pi * np.cos(2 * np.pi * t)[10:-10], rtol=0.05, atol=0.1
    )


def test_records_are_cut_after_their_derivatives_are_taken(folder):
    uncut, file = read(folder, GOOD), read(folder, GOOD.replace("[noise]", "cut = 0.3\n[noise]"))
    assert [record.names[0] for record in file.train] == [
        f"{name} ({k} of 4)" for name in "ab" for k in (1, 2, 3, 4)
    ]
    assert [record.names[0] for record in file.test["fast"]] == [
        f"d ({k} of 4)" for k in (1, 2, 3, 4)
    ]
    pieces = np.concatenate([np.asarray(record.z) for record in file.train[:4]])
    np.testing.assert_array_equal(pieces, np.asarray(uncut.train[0].z))
    with pytest.raises(InputError, match=r"\[records\] cut: Record 'a': in 50 pieces"):
        read(folder, GOOD.replace("[noise]", "cut = 0.02\n[noise]"))


def test_study_file_needs_only_model_and_records(folder):
    file = read(
        folder,
        "[model]\nuse = "
        '"m:C"\n[records]\ninputs=["force"]\noutputs=["x"]\ntime="s"\ntrain=["a.csv"]\n',
    )
    assert (file.title, file.free, file.noise, file.loop, file.library) == ("study", {}, {}, {}, {})
    assert (file.check, file.test) == (None, None)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[free]", "[fre]", r"study.toml: There is no section 'fre'. Did you mean 'free'"),
        ('title = "A spring"', "title = 5", r"study.toml, title: found 5, and a text is wanted"),
        ('title = "A spring"', "title = ", r"study.toml is not a TOML file: .*line 2"),
        ("[noise]", "noise = 5\n[other]", r"There is no section 'other'"),
        (
            'use = "springs:Spring"',
            "",
            r"study.toml, \[model\]: the key 'use' is missing. Give a "
            r"text",
        ),
        ('use = "springs:Spring"', "use = 3", r"\[model\] use: found 3, and a text is wanted"),
        (
            "parameters = { k",
            "parameter = { k",
            r"\[model\]: There is no key 'parameter'. Did you "
            r"mean 'parameters'",
        ),
        (
            'parameters = ["k"]',
            'parameters = "k"',
            r"\[free\] parameters: found 'k', and a list of "
            r"texts",
        ),
        (
            "[0.0, inf]",
            "[0.0]",
            r"\[free\] bounds: .* a table of pairs is wanted, such as "
            r"bounds = { k = \[0.0, inf\] }",
        ),
        ("window = 3", 'window = "3"', r"\[loop\] window: found '3', and a number is wanted"),
        ("window = 3", "window = true", r"\[loop\] window: found True"),
        ('"0.5 mm"', '"little"', r"\[noise\] x: found 'little'"),
        ("[library]", "[[library]]", r"`library` is .* and a section is wanted"),
        (
            '["a.csv", "more/b.csv"]',
            "[]",
            r"\[records\] train: found \[\], and a list of files is "
            r"wanted",
        ),
        ('"more/b.csv"', '"b.csv"', r"\[records\] train: There is no file .*b.csv"),
        (
            '["d.csv"]',
            '["more/../a.csv"]',
            r"\[records\] test: 'more/../a.csv' is already in "
            r"'train'",
        ),
        ('x = "mm"', 'x = "mn"', r"\[records\] train: .*'mn'"),
        ('x = "speed"', 'y = "speed"', r"\[records\] derivatives: There is no channel 'y'"),
        ('["force"]', '["forces"]', r"\[records\] train: There is no column in a.csv 'forces'"),
    ],
)
def test_invalid_study_file_is_refused_with_section_and_key(old, new, words, folder):
    assert old in GOOD
    with pytest.raises(InputError, match=words):
        read(folder, GOOD.replace(old, new, 1))


def test_study_file_renames_and_reverses_columns(folder):
    columns = 'columns = { s = "s", force = "force", y = "x" }\nsigns = { y = -1 }\ninputs ='
    text = GOOD.replace("inputs =", columns, 1).replace('outputs = ["x"]', 'outputs = ["y"]')
    text = text.replace('{ x = "mm" }', '{ y = "mm" }').replace(
        '{ x = "speed" }', '{ y = "speed" }'
    )
    record, original = (read(folder, content).train[0] for content in (text, GOOD))
    np.testing.assert_array_equal(record.channel("y"), -original.channel("x"))
    assert record.outputs == ("y", "speed")


def test_unit_in_a_title_is_advised_in_toml(folder):
    title = 'x "a" mm'
    for name in ("a", "more/b", "c", "d"):
        lines = (folder / f"{name}.csv").read_text().splitlines()
        header = 's,force,"x ""a"" mm"'
        (folder / f"{name}.csv").write_text("\n".join([header, *lines[1:]]))
    text = GOOD.replace('units = { x = "mm" }', "columns = { x = 'x \"a\" mm' }")
    with pytest.raises(InputError) as error:
        read(folder, text)
    advice = str(error.value).split("`")[1]
    assert advice == 'units = { "x \\"a\\" mm" = "mm" }'
    assert tomllib.loads(advice) == {"units": {title: "mm"}}
    file = read(folder, text.replace("columns", f"{advice}\ncolumns"))
    assert file.train[0].output_units[0] == "m"


def test_missing_study_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="There is no file"):
        read_study(tmp_path / "none.toml")


def test_files_of_several_layouts_and_matlab_are_read_together(folder):
    expected = read(folder, GOOD).train[0].z
    text = (folder / "c.csv").read_text().replace(",", ";").replace(".", ",")
    (folder / "c.csv").write_text("bench 3\n" + text)
    t, _, x = np.loadtxt(folder / "d.csv", delimiter=",", skiprows=1).T
    scipy.io.savemat(folder / "d.mat", {"s": t, "force": t, "x": x})
    layout = 'delimiter = { "c.csv" = ";" }\ndecimal = { "c.csv" = "," }\nskip = { "c.csv" = 1 }\n'
    text = GOOD.replace('"d.csv"', '"d.mat"').replace("constants =", f"{layout}constants =")
    test = read(folder, text).test
    for part in (test["slow"], test["fast"]):
        np.testing.assert_allclose(part[0].z, expected, rtol=0, atol=1e-14)
    with pytest.raises(InputError, match=r"\[records\] skip.*no file.*'e.csv'.*Did you mean"):
        read(folder, text.replace('skip = { "c.csv"', 'skip = { "e.csv"'))
    for key in ('skip = { "d.mat" = 100 }', 'encoding = { "d.mat" = "latin-1" }'):
        name = key.partition(" ")[0]
        lines = text.replace('skip = { "c.csv" = 1 }', "") + "\n"
        with pytest.raises(InputError, match=rf"\[records\] {name}: d.mat: a MATLAB file"):
            read(folder, lines.replace("constants =", f"{key}\nconstants ="))


@pytest.mark.parametrize("key", ["skip = 100", 'delimiter = ";"', "units_row = true"])
def test_layout_for_all_files_is_refused_where_all_are_matlab(key, folder):
    t = 0.1 * np.arange(5)
    scipy.io.savemat(folder / "a.mat", {"t": t, "force": t, "x": t})
    head = '[model]\nuse = "m:C"\n[records]\ninputs=["force"]\noutputs=["x"]\n'
    text = f'{head}train=["a.mat"]\n'
    assert read(folder, text).train[0].t.size == 5
    with pytest.raises(InputError, match=r"\[records\] .*: a.mat: a MATLAB file"):
        read(folder, f"{text}{key}\n")


def test_time_beside_sample_time_is_refused(folder):
    text = GOOD.replace('time = "s"', 'time = "s"\nsample_time = 0.1')
    with pytest.raises(InputError, match=r"a.csv: `time` is 's' and `sample_time` is 0.1"):
        read(folder, text)
