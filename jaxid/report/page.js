"use strict";
// Closed parts of the page are opened for print. Panels of the figures are zoomed: a panel is
// described by `Panel` of inline_svg.py, and panels of a figure with the same range of x are zoomed
// together in x. Without this script, figures are static.

const FINEST = 1 / 500; // smallest range, as a share of the full one (chosen)
const CLICK = 4; // largest movement of a click, in points (chosen)
const TALL = 0.2; // height of a selection that also zooms y, as a share of the panel (chosen)

/** Return labelled values in a range, about `count` of them, at steps of 1, 2 or 5 times ten^n. */
function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((each) => each * power >= rough * (1 - 1e-9));
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) {
    found.push({ value: k * step, label: (k * step).toFixed(decimals).replace("-", "−") });
  }
  return found;
}

/** Return a range inside the full one, moved rather than cut, and not below the finest. */
function inside([low, high], full) {
  const whole = full[1] - full[0];
  const width = Math.min(Math.max(high - low, whole * FINEST), whole);
  const middle = (low + high) / 2;
  const start = Math.min(Math.max(middle - width / 2, full[0]), full[1] - width);
  return width === whole ? full : [start, start + width];
}

/** Return scale and shift that bring drawn positions from the full range to a part of it. */
function transform(full, range, [start, end]) {
  const scale = (full[1] - full[0]) / (range[1] - range[0]);
  const shift = ((full[0] - range[0]) / (range[1] - range[0])) * (end - start);
  return { scale, shift: start - scale * start + shift };
}

class Panel {
  constructor({ id, box, x, y }) {
    this.group = document.getElementById(id);
    this.edges = { x: [box[0], box[2]], y: [box[1], box[3]] };
    this.full = { x, y };
    this.range = { x, y };
    const drawn = [...this.group.querySelectorAll("[clip-path]")];
    this.marks = drawn.filter((each) => !each.closest("[id*='tick_']")).map(clipped);
    this.ticks = { x: this.tickMarks("x"), y: this.tickMarks("y") };
    this.notes = [...this.group.children].filter((each) => this.isNote(each));
  }

  tickMarks(name) {
    return [...this.group.querySelectorAll(`[id*="-${name}tick_"]`)];
  }

  /** Whether an element is a text inside the panel, which does not move with the lines. */
  isNote(element) {
    const text = element.querySelector("text");
    const top = this.edges.y[1];
    return /-text_\d+$/.test(element.id) && text && Number(text.getAttribute("y")) > top;
  }

  value(name, position) {
    const [start, end] = this.edges[name];
    const [low, high] = this.range[name];
    return low + ((position - start) / (end - start)) * (high - low);
  }

  contains(point) {
    const { x, y } = this.edges;
    return x[0] <= point.x && point.x <= x[1] && y[1] <= point.y && point.y <= y[0];
  }

  show(name, range) {
    this.range = { ...this.range, [name]: inside(range, this.full[name]) };
    const [x, y] = ["x", "y"].map((each) =>
      transform(this.full[each], this.range[each], this.edges[each]),
    );
    const matrix = `matrix(${x.scale} 0 0 ${y.scale} ${x.shift} ${y.shift})`;
    const zoomed = x.scale !== 1 || y.scale !== 1;
    this.marks.forEach((mark) => {
      mark.setAttribute("transform", matrix);
      mark.setAttribute("vector-effect", zoomed ? "non-scaling-stroke" : "none");
    });
    this.notes.forEach((note) => note.toggleAttribute("hidden", zoomed));
    this.showTicks(name);
  }

  showTicks(name) {
    const [originals, range] = [this.ticks[name], this.range[name]];
    if (originals.length === 0) return;
    const isFull = range === this.full[name];
    const parent = originals[0].parentNode;
    parent.querySelectorAll(".tick").forEach((each) => each.remove());
    originals.forEach((each) => each.toggleAttribute("hidden", !isFull));
    if (isFull) return;
    const [start, end] = this.edges[name];
    const use = originals[0].querySelector("use");
    for (const { value, label } of ticks(...range, Math.max(originals.length, 3))) {
      const position = start + ((value - range[0]) / (range[1] - range[0])) * (end - start);
      parent.prepend(tick(originals[0], name, position - Number(use.getAttribute(name)), label));
    }
  }
}

/** Put an element into a group that is clipped in its place, so that the element can move. */
function clipped(element) {
  const group = document.createElementNS(element.namespaceURI, "g");
  group.setAttribute("clip-path", element.getAttribute("clip-path"));
  element.removeAttribute("clip-path");
  element.replaceWith(group);
  group.append(element);
  return element;
}

/** Return a copy of a tick with its grid line, moved, and labelled if the original is. */
function tick(original, name, shift, label) {
  const copy = original.cloneNode(true);
  copy.querySelectorAll("defs").forEach((each) => each.remove());
  [copy, ...copy.querySelectorAll("[id]")].forEach((each) => each.removeAttribute("id"));
  copy.removeAttribute("hidden");
  copy.classList.add("tick");
  copy.setAttribute("transform", name === "x" ? `translate(${shift} 0)` : `translate(0 ${shift})`);
  const text = copy.querySelector("text");
  if (text) text.textContent = label;
  return copy;
}

class Zoom {
  constructor(svg, panels) {
    this.svg = svg;
    this.panels = panels.map((each) => new Panel(each));
    this.selection = document.createElementNS(svg.namespaceURI, "rect");
    this.selection.setAttribute("class", "selection");
    const listen = (name, action) => svg.addEventListener(name, action.bind(this));
    listen("pointerdown", this.begin);
    listen("pointermove", this.move);
    listen("pointerup", this.end);
    listen("pointercancel", this.cancel);
    listen("dblclick", this.reset);
    listen("wheel", this.wheel);
  }

  point(event) {
    const place = new DOMPoint(event.clientX, event.clientY);
    return place.matrixTransform(this.svg.getScreenCTM().inverse());
  }

  panelAt(point) {
    return this.panels.find((panel) => panel.contains(point));
  }

  linked(panel) {
    const [low, high] = panel.full.x;
    return this.panels.filter((each) => each.full.x[0] === low && each.full.x[1] === high);
  }

  showX(panel, range) {
    this.linked(panel).forEach((each) => each.show("x", range));
  }

  reset() {
    for (const panel of this.panels) {
      panel.show("x", panel.full.x);
      panel.show("y", panel.full.y);
    }
  }

  begin(event) {
    const start = this.point(event);
    const panel = event.button === 0 && this.panelAt(start);
    if (!panel) return;
    event.preventDefault();
    this.svg.parentNode.focus({ preventScroll: true });
    this.svg.setPointerCapture(event.pointerId);
    this.drag = { panel, start };
    this.svg.append(this.selection);
    this.move(event);
  }

  /** Return the selected part of the panel, in points. */
  selected(event) {
    const { panel, start } = this.drag;
    const now = this.point(event);
    const part = (name) => {
      const [low, high] = [...panel.edges[name]].sort((a, b) => a - b);
      const ends = [start[name], Math.min(Math.max(now[name], low), high)];
      return ends.sort((a, b) => a - b);
    };
    const [x, y] = [part("x"), part("y")];
    const full = [panel.edges.y[1], panel.edges.y[0]];
    const tall = y[1] - y[0] > Math.max(CLICK, TALL * (full[1] - full[0]));
    return { x, y: tall ? y : full, tall };
  }

  move(event) {
    if (!this.drag) return;
    const { x, y } = this.selected(event);
    const sizes = { x: x[0], y: y[0], width: x[1] - x[0], height: y[1] - y[0] };
    Object.entries(sizes).forEach(([name, size]) => this.selection.setAttribute(name, size));
  }

  end(event) {
    if (!this.drag) return;
    const { panel } = this.drag;
    const { x, y, tall } = this.selected(event);
    this.cancel();
    if (tall) panel.show("y", [panel.value("y", y[1]), panel.value("y", y[0])]);
    if (x[1] - x[0] > CLICK) this.showX(panel, x.map((each) => panel.value("x", each)));
  }

  cancel() {
    this.drag = undefined;
    this.selection.remove();
  }

  wheel(event) {
    const point = this.point(event);
    const panel = event.ctrlKey && this.panelAt(point);
    if (!panel) return;
    event.preventDefault();
    this.scale(panel, 1.25 ** Math.sign(event.deltaY), panel.value("x", point.x));
  }

  /** Scale the range of x about a value. */
  scale(panel, factor, centre) {
    this.showX(panel, panel.range.x.map((end) => centre + factor * (end - centre)));
  }

  /** Keys act on the first panel and those zoomed with it. */
  key(event) {
    const panel = this.panels[0];
    const [low, high] = panel.range.x;
    const step = (high - low) / 4;
    const actions = {
      "+": () => this.scale(panel, 1 / 2, (low + high) / 2),
      "=": () => this.scale(panel, 1 / 2, (low + high) / 2),
      "-": () => this.scale(panel, 2, (low + high) / 2),
      ArrowLeft: () => this.showX(panel, [low - step, high - step]),
      ArrowRight: () => this.showX(panel, [low + step, high + step]),
      0: () => this.reset(),
    };
    const action = actions[event.key];
    if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    action();
  }
}

function start() {
  window.addEventListener("beforeprint", () => {
    for (const part of document.querySelectorAll("details")) part.open = true;
  });
  document.querySelectorAll("svg[data-panels]").forEach((svg) => {
    const panels = JSON.parse(svg.dataset.panels);
    if (panels.length === 0) return;
    const zoom = new Zoom(svg, panels);
    const [frame, hint] = [svg.parentNode, document.getElementById("zoom-hint")];
    frame.addEventListener("keydown", (event) => zoom.key(event));
    frame.setAttribute("aria-describedby", hint.id);
    svg.classList.add("zoomable");
    hint.hidden = false;
  });
}

if (typeof document !== "undefined") start();
