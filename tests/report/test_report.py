"""The report of a small study: the figures, the page and the folder, as a user meets them."""

import base64
import dataclasses
import hashlib
import itertools
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import equinox as eqx
import html5lib
import numpy as np
import pytest
from notebook_cells import assert_has_printed_lines
from spring_study import HOSTILE, make_study

from jaxid._foundation.checks import InputError
from jaxid.loop import RandomForces
from jaxid.loop.outcome import Outcome
from jaxid.report import figures, gallery, html, views, words, write_json, write_study
from jaxid.report.tables import decided

VOID = {"meta", "br", "img", "link", "input", "hr"}


class Page(HTMLParser):
    """Collects text, tags and addresses, and fails on a tag that is not closed in its turn."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.text, self.tags, self.addresses, self.open = "", [], [], []
        self.feed(text)
        self.close()
        assert not self.open, f"not closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.addresses += [
            value
            for name, value in attrs
            if name in ("src", "href", "xlink:href", "srcset", "data", "action")
        ]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open, f"{tag} is closed and was not open"
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data if self.open[-1:] not in (["style"], ["script"]) else ""


@pytest.fixture(scope="session")
def study():
    return make_study()


@pytest.fixture(scope="session")
def drawn(study):
    return gallery.gallery(study)


@pytest.fixture(scope="session")
def page(study, drawn):
    return html(study, "A <script>spring</script>", drawn)


def test_a_study_plots_its_first_test_set(study):
    ours, first = study.plot(), figures.prediction(study, "quick")
    second = study.plot(case=1)
    lines = [[line.get_ydata() for line in figure.axes[0].lines] for figure in (ours, first)]
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(*lines, strict=True))
    assert not np.array_equal(second.axes[0].lines[0].get_ydata(), lines[0][0], equal_nan=True)
    with pytest.raises(InputError, match="There is no test set 'none'"):
        study.plot("none")


def test_a_study_is_shown_as_its_print(study):
    assert_has_printed_lines(study)


@pytest.fixture
def quick(monkeypatch, drawn):
    """Figures become bytes without being painted, and a folder is written with those drawn once."""
    monkeypatch.setattr("jaxid.report.folder.gallery", lambda study: drawn)
    monkeypatch.setattr(gallery, "inline_svg", lambda figure, name, label: "<svg></svg>")
    monkeypatch.setattr(gallery.Picture, "png", b"png")


def test_a_study_is_a_labelled_dataset(study):
    dataset = study.to_xarray()
    after = study.after.tests["quick"]
    np.testing.assert_array_equal(dataset["predicted"].sel(side="after"), after.y)
    assert list(dataset["output"].values) == ["x", "tilt"]
    rms = dataset["rms"].sel(output="x")
    assert float(rms.sel(side="after")) < float(rms.sel(side="before"))
    assert dataset.attrs == {"test": "quick", "outcome": study.outcome.value}
    with pytest.raises(InputError, match="There is no test set 'none'"):
        study.to_xarray("none")


def lines(figure):
    return [line for ax in figure.axes for line in ax.lines]


def test_page_is_complete_and_states_effect_and_errors(study, page):
    parsed = Page(page)
    text = " ".join(parsed.text.split())
    assert words.raised(study.verdict) in text
    assert "x³ in the equation of v" in text
    for needed in (
        *study.outputs,
        *study.tests,
        "How to read this page",
        words.OUTCOMES[Outcome.EXPLAINED],
        "deg",
        "1/s²",
    ):
        assert needed in text, needed
    gain, error = (
        float(study.after.estimate.values[-1]),
        float(study.after.estimate.corrected_errors[-1]),
    )
    assert words.with_error(gain, error) in text
    assert f"{np.degrees(study.before.rms['quick']['tilt']):.4g}" in text
    assert all(
        candidate.verdict in text
        for candidate in study.rounds[0].candidates
        if candidate.cost_fall is not None
    )


@pytest.fixture(scope="session")
def tree(page):
    """The elements of the page, read by a parser of the HTML standard that reports every error."""
    parser = html5lib.HTMLParser(namespaceHTMLElements=False)
    root = parser.parse(page)
    assert parser.errors == []
    return root


def test_page_is_valid_html_whose_contents_lead_to_its_sections(tree):
    ids = [element.get("id") for element in tree.iter() if element.get("id")]
    assert len(set(ids)) == len(ids)
    links = [a.get("href") for a in tree.find(".//nav").iter("a")]
    sections = [f"#{element.get('id')}" for element in tree.iter("h2")]
    assert links == sections
    levels = [int(e.tag[1]) for e in tree.iter() if e.tag in ("h1", "h2", "h3")]
    assert levels[0] == 1
    assert all(later <= level + 1 for level, later in itertools.pairwise(levels))


def test_page_can_be_read_without_seeing_it(tree):
    """Language, title, texts of pictures, heads of tables, and the keyboard scrolls wide parts."""
    assert tree.get("lang") == "en"
    assert tree.find(".//title").text
    pictures = tree.findall(".//{*}svg")
    assert len(pictures) >= 6
    assert all(e.get("role") == "img" and e.get("aria-label") for e in pictures)
    assert all(head.get("scope") in ("row", "col") for head in tree.iter("th"))
    scrolled = [e for e in tree.iter("div") if e.get("class") == "scroll"]
    assert len(scrolled) > len(pictures)
    assert all(element.get("tabindex") == "0" for element in scrolled)


def test_colours_of_text_have_contrast(page):
    """At least 4.5 to 1 on white (WCAG 2.2, criterion 1.4.3)."""
    style = page[: page.index("</style>")]
    known = dict(re.findall(r"--(\w+): (#[0-9a-f]{3,6})", style[: style.index("}")]))
    used = set(re.findall(r"[{; ]color: var\(--(\w+)\)", style))
    assert {"ink", "quiet", "before", "after"} <= used
    for name in used:
        digits = known[name][1:]
        digits = "".join(2 * digit for digit in digits) if len(digits) == 3 else digits
        parts = np.array([int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)])
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        luminance = float(linear @ [0.2126, 0.7152, 0.0722])
        assert 1.05 / (luminance + 0.05) >= 4.5, name


def test_page_has_no_external_files_and_escapes_given_text(page):
    parsed = Page(page)
    assert parsed.tags.count("script") == 1  # of the page itself
    assert "b" not in parsed.tags
    assert "link" not in parsed.tags
    assert HOSTILE in parsed.text
    assert len(parsed.addresses) >= 6
    assert all(address.startswith("#") for address in parsed.addresses)
    assert set(re.findall(r"url\(.", page)) == {"url(#"}
    assert "@import" not in page


def test_security_policy_permits_script_of_page_alone(tree):
    (policy,) = (e.get("content") for e in tree.iter("meta") if e.get("http-equiv"))
    digest = hashlib.sha256(tree.find(".//script").text.encode()).digest()
    assert f"script-src 'sha256-{base64.b64encode(digest).decode()}'" in policy
    assert "default-src 'none'" in policy


@pytest.mark.parametrize("outcome", Outcome)
def test_page_describes_every_outcome(study, drawn, outcome, quick):
    has_effects = outcome in (Outcome.EXPLAINED, Outcome.PROXIES)
    changed = {} if has_effects else {"effects": (), "descriptions": (), "after": study.before}
    parsed = Page(html(dataclasses.replace(study, outcome=outcome, **changed), drawn=drawn))
    assert words.OUTCOMES[outcome] in parsed.text
    assert ("No effect was added" in parsed.text) == (not has_effects)


def test_page_qualifies_errors_under_random_forces(study, drawn, quick):
    note = "does not contain the motion that the random forces cause"
    random = dataclasses.replace(study, noise_model=RandomForces({"v": 0.1}, {}, 1.0))
    for shown, expected in ((study, False), (random, True)):
        assert (note in " ".join(Page(html(shown, drawn=drawn)).text.split())) is expected
        assert (note in str(shown)) is expected


def test_page_and_json_state_that_the_search_was_stopped(study, drawn, quick):
    stopped = dataclasses.replace(study, interrupted=True)
    for one in (study, stopped):
        assert ("The search was stopped" in html(one, drawn=drawn)) is one.interrupted
        assert json.loads(one.to_json())["interrupted"] is one.interrupted


def test_page_names_test_set_that_decided(study, drawn, quick):
    shown = dataclasses.replace(study, check=study.tests["quick"])
    text = Page(html(shown, drawn=drawn)).text
    assert "but quick, which decided" in " ".join(text.split())


def test_diverging_test_set_is_not_the_check_set(study):
    nothing = dict.fromkeys(study.outputs, np.nan)
    rounds = tuple(
        dataclasses.replace(entry, errors=entry.errors | {"check": nothing})
        for entry in study.rounds
    )
    rms = dict.fromkeys(study.tests, nothing)
    diverged = dataclasses.replace(
        study, rounds=rounds, before=dataclasses.replace(study.before, rms=rms)
    )
    assert decided(diverged) == ()


def test_prediction_figure_has_panel_per_channel(study):
    figure = figures.prediction(study, "quick", 1)
    assert len(figure.axes) == 2
    assert [ax.get_ylabel() for ax in figure.axes] == ["x [m]", "tilt [deg]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    measured, before, after = figure.axes[1].lines
    assert np.all(np.isfinite(before.get_ydata()))
    assert np.all(np.isfinite(after.get_ydata()))
    z = np.asarray(study.tests["quick"].channel("tilt"))[1]
    np.testing.assert_allclose(measured.get_ydata(), np.degrees(z), rtol=1e-12)


def test_residuals_figure_omits_window(study):
    figure = figures.residuals(study, "quick")
    assert len(figure.axes) == 6
    after = np.asarray(study.after.tests["quick"].residuals)[0, 20:, 0]
    shown = figure.axes[1].lines[0].get_ydata()
    assert np.all(np.isnan(shown[:20]))  # the window in which the initial state is fitted
    np.testing.assert_allclose(shown[20:], after, rtol=1e-12)
    correlation = figure.axes[2].lines[1].get_ydata()
    assert np.all(np.abs(correlation) <= 1)


def test_errors_figure_has_panel_per_channel_and_logarithmic_axis_for_large_ratio(study):
    figure = figures.errors(study)
    assert [ax.get_title(loc="left") for ax in figure.axes] == ["x [m]", "tilt [deg]"]
    widths = [patch.get_width() for patch in figure.axes[0].patches]
    expected = [side.rms[test]["x"] for test in study.tests for side in (study.before, study.after)]
    np.testing.assert_allclose(widths, expected)
    assert {ax.get_xscale() for ax in figure.axes} == {"linear"}
    far = {
        test: {name: 1e3 * value for name, value in rms.items()}
        for test, rms in study.before.rms.items()
    }
    far["quick"] = {"x": np.inf, "tilt": np.nan}
    far = dataclasses.replace(study, before=dataclasses.replace(study.before, rms=far))
    figure = figures.errors(far)
    assert {ax.get_xscale() for ax in figure.axes} == {"log"}
    assert "diverged" in [text.get_text() for text in figure.axes[0].texts]
    tests = {
        name: eqx.tree_at(lambda p: p.scored, one, one.scored.at[..., 1].set(False))
        for name, one in far.before.tests.items()
    }
    figure = figures.errors(
        dataclasses.replace(far, before=dataclasses.replace(far.before, tests=tests))
    )
    assert "not measured" in [text.get_text() for text in figure.axes[1].texts]


def test_ranking_figure_marks_added_candidate(study):
    entry = study.rounds[0]
    (ax,) = figures.ranking(dataclasses.replace(entry, threshold=9.0)).axes
    assert ax.get_xscale() == "log"
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert {"x³ in v", "x² in v", "bias of x"} <= set(names)
    widths = [patch.get_width() for patch in ax.patches]
    assert widths == sorted(widths, reverse=True)
    colours = [patch.get_facecolor() for patch in ax.patches]
    added = colours.pop(names.index("x³ in v"))
    assert added not in colours
    assert len(set(colours)) == 1
    assert any(np.all(np.asarray(line.get_xdata()) == 9.0) for line in ax.lines)


@pytest.mark.parametrize("place", [3, 14])
def test_ranking_figure_has_the_winner_whatever_its_score(study, place):
    one = dataclasses.replace(study.rounds[0].candidates[0], instead_of=(), cost_fall=None)
    candidates = tuple(
        dataclasses.replace(one, name=f"c{k}", score=100.0 - k, added=k == place) for k in range(15)
    )
    entry = dataclasses.replace(study.rounds[0], candidates=candidates)
    figure = figures.ranking(entry)
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names == [*(f"c{k}" for k in range(11)), "c11" if place == 3 else "c14"]
    colours = [patch.get_facecolor() for patch in figure.axes[0].patches]
    assert colours.count(colours[names.index(f"c{place}")]) == 1


def test_ranking_figure_of_candidates_without_score_gives_no_warning(study):
    entry = study.rounds[0]
    blank = tuple(
        dataclasses.replace(candidate, score=0.0, cost_fall=None) for candidate in entry.candidates
    )
    (ax,) = figures.ranking(dataclasses.replace(entry, candidates=blank)).axes
    assert ax.get_xscale() == "log"
    assert len(ax.patches) == len(blank)


def test_axis_of_diverging_prediction_keeps_range_of_measurements(study):
    wild = {
        name: dataclasses.replace(
            prediction, y=prediction.y.at[:, 100:].set(1e200).at[:, 150:].set(np.nan)
        )
        for name, prediction in study.before.tests.items()
    }
    far = dataclasses.replace(study, before=dataclasses.replace(study.before, tests=wild))
    low, high = figures.prediction(far, "quick").axes[0].get_ylim()
    z = np.asarray(study.tests["quick"].z)[0, :, 0]
    assert high - low < 3 * np.ptp(z)
    for figure in (figures.prediction(far, "quick"), figures.residuals(far, "quick")):
        figure.canvas.draw()


def test_long_record_is_thinned_or_cut_with_note(study, monkeypatch):
    monkeypatch.setattr(views, "LIMIT", 150)
    thinned = views.view(study, "quick")
    assert thinned.t.size == 100
    assert thinned.time_label == "time [s]: one sample in 2 of 200 is drawn"
    monkeypatch.setattr(views, "LIMIT", 50)
    cut = views.view(study, "quick")
    assert cut.t.size == 50
    np.testing.assert_allclose(np.diff(cut.t), 0.1)
    assert (
        "a typical stretch, 50 of 200 samples"
        in figures.prediction(study, "quick").axes[-1].get_xlabel()
    )


def test_unknown_set_or_record_raises_error(study):
    with pytest.raises(InputError, match="quick"):
        figures.prediction(study, "quik")
    with pytest.raises(InputError, match="2 records"):
        figures.residuals(study, "quick", 2)


def test_folder_contains_page_json_and_figures(study, tmp_path):
    folder = write_study(study, tmp_path / "deep" / "out", "Spring")
    assert folder == tmp_path / "deep" / "out"
    names = sorted(path.name for path in folder.iterdir())
    assert [name for name in names if not name.endswith(".png")] == ["study.html", "study.json"]
    assert (
        len(names) == 2 + 13
    )  # errors, place, three predictions, records of four sets, residuals of two, two rounds
    assert all(
        (folder / name).read_bytes().startswith(b"\x89PNG")
        for name in names
        if name.endswith(".png")
    )
    assert json.loads((folder / "study.json").read_text())["effects"] == ["x^3 in v"]
    page = (folder / "study.html").read_text(encoding="utf-8")
    assert "<title>Spring</title>" in page
    assert '<tr class="added"><td>equation v</td>' in page  # where it sits, among the first
    assert [path.name for path in folder.parent.iterdir()] == ["out"]


def test_every_record_is_drawn_in_small_panels(study, drawn):
    for role, count in (("training", 2), ("check", 1)):
        (picture,) = drawn.records[role]
        assert len(picture.figure.axes) == 3 * count  # one input and two outputs
    overview = next(one for one in drawn.tests["quick"] if one.name.startswith("records"))
    axes = overview.figure.axes
    assert [ax.get_title(loc="left") for ax in axes[:2]] == ["d", "e"]
    assert [ax.get_ylabel() for ax in axes[::2]] == ["force\n[N]", "x\n[m]", "tilt\n[deg]"]
    measured, after = axes[5].lines  # tilt of the second record
    z, y = study.tests["quick"].z[1, :, 1], study.after.tests["quick"].y[1, :, 1]
    known = np.isfinite(measured.get_ydata())
    assert not known[:3].any()  # missing samples are gaps
    assert known[3:].all()
    np.testing.assert_allclose(measured.get_ydata()[3:], np.degrees(z)[3:], rtol=1e-12)
    np.testing.assert_allclose(after.get_ydata(), np.degrees(y), rtol=1e-12)


def test_page_states_which_records_are_not_drawn(study, monkeypatch):
    monkeypatch.setattr(gallery, "RECORDS_IN_FIGURE", 1)
    every = gallery._records(study.tests["quick"], "quick")
    assert [one.name for one in every] == ["records-quick-1", "records-quick-2"]
    assert not any("are not" in one.caption for one in every)
    monkeypatch.setattr(gallery, "MOST_RECORDS", 1)
    (first,) = gallery._records(study.tests["quick"], "quick")
    assert "has 2 records; the first 1 are drawn, and the other 1 are not" in first.caption
    assert "thinned" not in first.caption
    monkeypatch.setattr(gallery, "PANEL_SAMPLES", 199)
    (first,) = gallery._records(study.tests["quick"], "quick")
    assert "Records of more than 199 samples are thinned." in first.caption


def test_existing_folder_is_not_overwritten(study, tmp_path, quick):
    taken = tmp_path / "out"
    taken.mkdir()
    (tmp_path / "out-2").symlink_to(tmp_path / "nowhere")
    assert write_study(study, taken).name == "out-3"
    assert write_study(study, taken).name == "out-4"
    assert list(taken.iterdir()) == []
    with pytest.raises(InputError, match="never overwritten"):
        write_study(study, taken, exist="refuse")
    assert write_study(study, tmp_path / "new", exist="refuse").name == "new"
    with pytest.raises(InputError, match="number"):
        write_study(study, taken, exist="replace")


@pytest.mark.parametrize("where", ["drawing", "writing", "naming"])
def test_failed_report_leaves_no_file(study, tmp_path, quick, monkeypatch, where):
    def fail(*_, **__):
        raise OSError("planted")

    def fail_late(path, content, write=Path.write_bytes):
        write(path, content) if path.name.startswith("study") else fail()

    if where == "drawing":
        monkeypatch.setattr(gallery, "inline_svg", fail)
    elif where == "writing":
        monkeypatch.setattr(Path, "write_bytes", fail_late)
    else:
        monkeypatch.setattr(Path, "rename", fail)
    with pytest.raises(OSError, match="planted"):
        write_study(study, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_existing_json_file_is_not_overwritten(study, tmp_path):
    path = write_json(study, tmp_path / "out.json")
    before = path.read_text()
    assert json.loads(before)["verdict"] == study.verdict
    with pytest.raises(InputError, match="never overwritten"):
        write_json(study, path)
    with pytest.raises(InputError, match="no folder"):
        write_json(study, tmp_path / "none" / "out.json")
    assert path.read_text() == before
    assert [file.name for file in tmp_path.iterdir()] == ["out.json"]


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [
        (-0.598574, 0.00284, "-0.5986 ± 0.0028"),
        (4.3217e-7, 1.04e-8, "(4.32 ± 0.10)·10⁻⁷"),
        (17700.4, 31.0, "17700 ± 31"),
        (1.0, np.nan, "1 (on its bound)"),
        (1.0, np.inf, "1 (not determined by these data)"),
        (3.0, 0.0, "3"),
        (2.5e8, 3e6, "(2.500 ± 0.030)·10⁸"),
        (1.0, 1e-12, "1.000000000 ± 1·10⁻¹²"),
        (2.5e8, 3.14e-6, "(2.500000000 ± 3.1·10⁻¹⁴)·10⁸"),
    ],
)
def test_estimate_is_rounded_to_digits_of_its_error(value, error, expected):
    assert words.with_error(value, error) == expected


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.014213, "0.01421"),
        (0.0, "0"),
        (3.2e-7, "3.2·10⁻⁷"),
        (123456.0, "123456"),
        (np.nan, "not finite"),
    ],
)
def test_number_has_four_digits(value, expected):
    assert words.number(value) == expected
    assert words.number(1.2e7) == "1.2·10⁷"


def test_angle_units_are_displayed_in_degrees():
    assert words.display_unit("rad/s^2")[1] == "deg/s^2"
    assert words.display_unit("rad/s")[0] == pytest.approx(57.29577951308232)
    assert words.display_unit("m/s^2") == (1.0, "m/s^2")
    assert words.display_unit("1/rad") == (1.0, "1/rad")
    assert words.unit_words("kg*m^2/s") == "kg·m²/s"
