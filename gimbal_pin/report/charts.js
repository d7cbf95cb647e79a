"use strict";
// Draws the charts of a page: each `.charts` holds which curves they have and, deflated, a table per chart, as
// charts.py writes them. Where this script does not run, the picture beside them stays.

const ground = document.querySelector(".gimbal-pin") ?? document.body;  // in a notebook it has the colours
const colourOf = name => name.startsWith("--") ? getComputedStyle(ground).getPropertyValue(name) : name;
// Ten characters at most, so that nothing moves while a run plays.
const write = (value, digits) => (value && Math.abs(value) < 1e-3 ? value.toExponential(digits)
  : String(Number(value.toPrecision(5)))).replaceAll("-", "−");
const read = value => value === null ? "–" : write(value, 4);
// Numbers along an axis; the last of them has the unit. Of a logarithmic one those of one digit.
function label(all, unit, isLog) {
  const splits = isLog ? all.map(value => value === Number(value?.toPrecision(1)) ? value : null) : all;
  const last = splits.findLastIndex(value => value !== null);
  return splits.map((value, k) => value === null ? "" : write(value) + (k === last ? unit : ""));
}

// Marks of a logarithmic axis: 1, 2, … 9 of every decade. Those of uPlot need limits that are powers of ten: from
// 0.00338 on they may never end.
function splitDecades(low, high) {
  const splits = [];
  for (let power = Math.floor(Math.log10(low)); 10 ** power <= high; power++)
    for (let digit = 1; digit < 10; digit++) splits.push(Number(`${digit}e${power}`));
  return splits.filter(split => split >= low && split <= high);
}

function add(parent, tag, attributes = {}, text = "") {
  const made = parent.appendChild(document.createElement(tag));
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.textContent = text;
  return made;
}

// A run: the charts that show its time, and the frames that play it.
class Run {
  static named = {};
  static of(clock) { return Run.named[clock] ??= new Run(clock); }
  constructor(clock) {
    this.charts = [];
    this.frames = [...document.querySelectorAll("iframe[data-clock]")].filter(frame => frame.dataset.clock === clock);
  }
  // Moves every cursor to a time; `by`: the chart whose cursor is there already.
  move(time, by) {
    this.time = time;
    for (const chart of this.charts) chart === by ? chart.tell() : chart.mark(time);
  }
  // Takes the frames to a time, but for the one that is there already.
  seek(time, by) {
    for (const frame of this.frames) if (frame !== by) frame.contentWindow.postMessage({ seek: time }, "*");
  }
  zoom(range) {
    this.range = range;
    for (const chart of this.charts) if (!chart.over) chart.zoom(range);
  }
}

class Chart {
  constructor(home, run, what, columns) {
    Object.assign(this, { run, what, over: 0, row: null, isPointed: false, isDragged: false });
    this.t = columns[0].map(since => since + what.start);
    this.abscissae = [this.t, ...columns.slice(1, what.abscissae.length)];
    this.curves = columns.slice(what.abscissae.length);
    this.owners = [...what.curves.keys(), ...what.curves.flatMap((curve, k) => curve.is_banded ? [k, k] : [])];  // of a band's edges
    const box = add(home, "div", { class: "chart" }), top = add(box, "div", { class: "legend" });
    if (what.title) {
      const name = add(top, "b", { class: "joint" });
      add(name, "i", { style: `background:${what.colour}` });
      name.append(what.title);
    }
    add(top, "span", {}, what.label);
    this.values = what.curves.map((curve, k) => {
      const button = add(top, "button", { type: "button", "aria-pressed": "true" });
      add(button, "i", { style: `border-color:${curve.colour.replace(/^--.*/, "var($&)")}` }).classList.toggle("dashed", curve.dashes.length > 0);
      button.append(curve.name);
      button.addEventListener("click", () => {
        const show = button.getAttribute("aria-pressed") !== "true";
        button.setAttribute("aria-pressed", show);
        this.owners.forEach((owner, at) => { if (owner === k) this.plot.setSeries(at + 1, { show }); });
      });
      return add(button, "span");
    });
    this.frame = add(box, "div", { class: "frame-of-curves", role: "slider", tabindex: 0, "aria-valuenow": 0 });
    this.frame.setAttribute("aria-label", [what.title, what.label].filter(Boolean).join(": "));
    this.frame.addEventListener("keydown", event => this.press(event));
    new ResizeObserver(() => this.fit()).observe(this.frame);
  }

  get size() { return { width: this.frame.clientWidth, height: this.frame.clientHeight }; }
  get full() { return [this.x[0], this.x[this.x.length - 1]]; }

  // A chart is drawn once its room is known: in what is folded, when that opens.
  fit() {
    if (!this.frame.clientWidth) return;
    if (this.plot) this.plot.setSize(this.size); else this.draw();
  }

  // Over another quantity than time the curves are dots, in its order.
  draw() {
    const x = this.abscissae[this.over], isTime = !this.over;
    this.order = Uint32Array.from(x.keys());
    if (!isTime) this.order.sort((a, b) => x[a] - x[b]);
    this.x = Array.from(this.order, row => x[row]);
    this.place = new Uint32Array(x.length);
    this.order.forEach((row, place) => { this.place[row] = place; });
    const paint = curve => () => colourOf(curve.colour), isShown = k => this.plot?.series[k + 1].show ?? true;
    const lines = { stroke: () => colourOf("--line"), width: 1 }, unit = ` ${this.what.abscissae[this.over].split(", ")[1]}`;
    const axis = { stroke: () => colourOf("--muted"), font: "12px system-ui, sans-serif", gap: 3, grid: lines, ticks: lines };
    const scale = which => this.what.log.includes(which) ? { distr: 3 } : {};
    const marks = which => this.what.log.includes(which) ? { splits: (_, __, low, high) => splitDecades(low, high) } : {};
    const count = this.what.curves.length, drawn = this.owners.map(k => this.what.curves[k]).map((curve, at) => ({
      label: curve.name, show: isShown(at), stroke: paint(curve), width: at < count ? curve.width : 0, pxAlign: 0, dash: curve.dashes,
      ...(isTime ? { points: { show: false } } : { paths: () => null, points: { show: true, size: 3.5, width: 0, fill: paint(curve) } }),
    }));
    this.plot?.destroy();
    this.plot = new uPlot({
      ...this.size,
      legend: { show: false },
      padding: [8, 16, 0, 0],
      scales: { x: { time: false, ...scale("x"), ...(x[0] < x[x.length - 1] && { range: (_, first, last) => [first, last] }) }, y: scale("y") },
      axes: [{ ...axis, ...marks("x"), size: 26, values: (_, splits) => label(splits, unit, scale("x").distr) }, { ...axis, ...marks("y"), size: 56, space: 22, values: (_, splits) => label(splits, "") }],
      series: [{}, ...drawn],
      bands: this.owners.slice(count).flatMap((k, at) => at % 2 ? [] : [{ series: [count + at + 2, count + at + 1], fill: () => colourOf(this.what.curves[k].colour) + "40" }]),
      cursor: {
        y: false,
        drag: { setScale: false, click: () => {} },
        move: (plot, left, top) => this.put(plot, left, top),
        dataIdx: () => this.row === null ? null : this.place[this.row],
        bind: {
          mousemove: (plot, target, handle) => event => { this.isPointed = true; handle(event); this.isPointed = false; },
          dblclick: () => () => this.ask(this.full),
        },
      },
      hooks: {
        setCursor: [() => { if (this.isPointed && this.row !== null) this.run.move(this.t[this.row], this); }],
        setSelect: [plot => {
          const { left, width } = plot.select;
          this.isDragged = width > 3;
          if (this.isDragged) this.ask([left, left + width].map(at => plot.posToVal(at, "x")));
          plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        }],
      },
    }, [this.x, ...this.curves.map(values => Array.from(this.order, row => Number.isNaN(values[row]) ? null : values[row]))], this.frame);
    this.plot.over.addEventListener("click", () => {
      if (!this.isDragged && this.row !== null) this.run.seek(this.t[this.row]);
      this.isDragged = false;
    });
    for (const kind of ["touchstart", "touchmove"]) this.plot.over.addEventListener(kind, event => this.touch(event), { passive: true });
    if (isTime && this.run.range) this.zoom(this.run.range);
    if (this.run.time !== undefined) this.mark(this.run.time);
  }

  // One finger moves the cursor; what is under two stays under them, and is so zoomed.
  touch({ targetTouches: [...touches] }) {
    const { plot } = this, { left, top, width } = plot.over.getBoundingClientRect(), at = touches.map(one => one.clientX - left);
    const [turn, back] = plot.scales.x.distr === 3 ? [Math.log, Math.exp] : [x => x, x => x];
    if (at.length === 1) {
      this.isPointed = true;
      plot.setCursor({ left: at[0], top: touches[0].clientY - top });
      this.isPointed = false;
    }
    this.held = at.length === 2 ? this.held ?? at.map(x => turn(plot.posToVal(x, "x"))) : null;
    const each = this.held && (this.held[1] - this.held[0]) / (at[1] - at[0]);
    if (each > 0) this.ask([-at[0], width - at[0]].map(x => back(this.held[0] + each * x)));
  }

  // The cursor stands on a sample: the one nearest to the pointer, or the one of the run's time.
  put(plot, left, top) {
    if (this.isPointed && left >= 0) this.row = this.order[this.over ? this.nearestDot(plot, left, top) : plot.posToIdx(left)];
    const at = this.row === null ? -10 : plot.valToPos(this.abscissae[this.over][this.row], "x");
    return at < 0 || at > plot.over.clientWidth ? [-10, -10] : [at, top];
  }
  nearestDot(plot, left, top) {
    const curves = plot.data.filter((_, k) => k && plot.series[k].show);
    let best = plot.posToIdx(left), least = Infinity;
    this.x.forEach((x, place) => curves.forEach(values => {
      if (values[place] === null) return;
      const far = Math.hypot(plot.valToPos(x, "x") - left, plot.valToPos(values[place], "y") - top);
      if (far < least) [best, least] = [place, far];
    }));
    return best;
  }
  mark(time) {
    const { t } = this, step = (t[t.length - 1] - t[0]) / Math.max(t.length - 1, 1);
    const after = Math.min(t.findIndex(one => one >= time) >>> 0, t.length - 1), before = Math.max(after - 1, 0);
    const row = time - t[before] < t[after] - time ? before : after;
    this.row = Math.abs(t[row] - time) > 2 * step ? null : row;
    this.plot?.setCursor({ left: 0, top: 0 }, false);
    this.tell();
  }
  tell() {
    const values = this.curves.map(values => this.row === null || Number.isNaN(values[this.row]) ? null : values[this.row]);
    this.values.forEach((place, k) => { place.textContent = this.row === null ? "" : read(values[k]); });
    if (this.row === null) return;
    const x = this.abscissae[this.over][this.row];
    this.frame.setAttribute("aria-valuenow", x);
    const said = this.what.curves.map((curve, k) => `${curve.name} ${read(values[k])}`);
    this.frame.setAttribute("aria-valuetext", `${read(x)}: ${said.join(", ")}`);
  }

  ask(range) { if (this.over) this.zoom(range); else this.run.zoom(range); }
  zoom([min, max]) {
    const [first, last] = this.plot ? this.full : [0, 0];
    if (min < last && max > first) this.plot.setScale("x", { min: Math.max(min, first), max: Math.min(max, last) });
  }
  press(event) {
    const { min, max } = this.plot.scales.x, place = this.row === null ? 0 : this.place[this.row], last = this.x.length - 1;
    const step = event.shiftKey ? 10 : 1, middle = this.x[place];
    const moves = { ArrowLeft: place - step, ArrowRight: place + step, Home: 0, End: last };
    const about = share => [middle - share * (middle - min), middle + share * (max - middle)];
    const acts = {
      "+": () => this.ask(about(0.5)), "-": () => this.ask(about(2)), 0: () => this.ask(this.full),
      Enter: () => { if (this.row !== null) this.run.seek(this.t[this.row]); },
    };
    if (event.key in moves) this.run.move(this.t[this.order[Math.min(Math.max(moves[event.key], 0), last)]]);
    else if (event.key in acts) acts[event.key]();
    else return;
    event.preventDefault();
  }
}

async function inflate(packed) {
  const bytes = Uint8Array.from(atob(packed), letter => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
}

async function build(home) {
  const charts = JSON.parse(home.dataset.charts), values = new Float32Array(await inflate(home.dataset.deflated));
  home.closest("figure").classList.add("live");
  const tools = add(home, "div", { class: "tools" }), grid = add(home, "div", { class: "grid" });
  let first = 0;
  const own = charts.map(what => {
    const count = what.abscissae.length + what.curves.reduce((sum, curve) => sum + (curve.is_banded ? 3 : 1), 0), over = what.abscissae[0];
    const columns = Array.from({ length: count }, () => Float64Array.from(values.subarray(first, first += what.rows)));
    return new Chart(grid, Run.of(home.dataset.clock + (over === "time, s" ? "" : over)), what, columns);
  });
  const choices = own[0].what.abscissae, turned = own.filter(chart => chart.what.abscissae.length > 1);
  if (turned.length) {
    const select = add(add(tools, "label", {}, "over "), "select");
    for (const name of choices) add(select, "option", {}, name.split(",")[0]);
    select.addEventListener("change", () => turned.forEach(chart => {
      chart.over = select.selectedIndex;
      if (chart.plot) chart.draw();
    }));
  }
  add(tools, "button", { type: "button" }, "Show all").addEventListener("click", () => own.forEach(chart => chart.ask([-Infinity, Infinity])));
  const scene = own[0].run.frames.length ? ", a click or Enter moves the scene" : "";
  add(tools, "span", {}, `Drag or pinch to zoom; arrow keys move the cursor, + − 0 zoom${scene}.`);
  for (const chart of own) chart.run.charts.push(chart);
}

const built = Promise.all([...document.querySelectorAll(".charts:empty")].map(build));

// A frame that plays takes the run's other frames along, and its cursors unless a reader points at one.
window.addEventListener("message", event => {
  const frame = [...document.querySelectorAll("iframe[data-clock]")].find(one => one.contentWindow === event.source);
  if (!frame || !Number.isFinite(event.data.time)) return;
  const run = Run.of(frame.dataset.clock);
  run.seek(event.data.time, frame);
  if (!run.charts.some(chart => chart.frame.matches(":hover"))) run.move(event.data.time);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const run of Object.values(Run.named)) for (const chart of run.charts) chart.plot?.redraw();
});
