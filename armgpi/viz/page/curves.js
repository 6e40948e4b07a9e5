// Curves over time on canvases: drawn anew in a few milliseconds, all with one time.
"use strict";

/** Return the figures of a run: sums over its joints, or the largest of them. */
function play_metrics(values, n, dt, stopped) {
  const { q, q_ref, tau_command: asked, tau } = values;
  const samples = q.length / n;
  const none = () => new Float64Array(n);
  const each = { itae: none(), peak: none(), final: none(), variation: none(), torque: none() };
  for (let k = 0, i = 0; k < samples; k++) {
    const weight = k * dt * (k === 0 || k === samples - 1 ? 0.5 : 1) * dt;
    for (let j = 0; j < n; j++, i++) {
      const e = Math.abs(q[i] - q_ref[i]), t = tau[i];
      each.itae[j] += e * weight;
      if (e > each.peak[j]) each.peak[j] = e;
      each.final[j] = e;
      if (k > 0) each.variation[j] += Math.abs(t - tau[i - n]);
      if (Math.abs(t) > each.torque[j]) each.torque[j] = Math.abs(t);
    }
  }
  const sum = (x) => x.reduce((a, b) => a + b, 0), most = (x) => Math.max(...x);
  const total = stopped >= 0
    ? { itae: Infinity, peak: Infinity, final: Infinity, variation: Infinity, torque: most(each.torque) }
    : { itae: sum(each.itae), peak: most(each.peak), final: most(each.final), variation: sum(each.variation), torque: most(each.torque) };
  return { each, total, asked };
}

class PlayCurves {
  /** Draw into `box` the quantities of joints; `seek` is told a time that is clicked. */
  constructor(box, joints, dt, steps, colors, seek) {
    Object.assign(this, { box, joints, dt, steps, colors, seek });
    this.quantities = [
      { name: "error", unit: "unit", of: (v, i) => v.q[i] - v.q_ref[i] },
      { name: "torque", unit: "torque_unit", of: (v, i) => v.tau[i] },
      { name: "position", unit: "unit", of: (v, i) => v.q[i], reference: (v, i) => v.q_ref[i] },
      { name: "omega_c", title: "ω", unit: "rad/s", of: (v, i) => (v.omega_c ? v.omega_c[i] : NaN) },
    ];
    this.chosen = new Set(["error", "torque"]);
    this.shown = new Set(joints.map((_, j) => j));
    this.runs = [];
    this.range = [0, steps * dt];
    this.time = 0;
    this.cells = [];
    new ResizeObserver(() => this.draw()).observe(box);
  }

  /** Show runs, each values by their names and the index of its colour. */
  show(runs) {
    this.runs = runs;
    this.draw();
  }

  /** Make the cells anew: a row for each joint, a column for each quantity. */
  layout() {
    const { element } = Armgpi;
    this.box.textContent = "";
    this.cells = [];
    const quantities = this.quantities.filter(({ name }) => this.chosen.has(name));
    this.box.style.setProperty("--columns", String(Math.max(1, quantities.length)));
    [...this.shown].sort((a, b) => a - b).forEach((j) => {
      for (const quantity of quantities) {
        const canvas = element("canvas", { role: "img", "aria-label": `${quantity.name} of ${this.joints[j].name}` });
        const cursor = element("div", { class: "cursor" }), said = element("output", { class: "said" });
        const unit = this.joints[j][quantity.unit] || quantity.unit;
        const title = element("span", { class: "title" }, `${this.joints[j].name} · ${quantity.title || quantity.name} [${unit}]`);
        const cell = element("div", { class: "curve" }, title, canvas, cursor, said);
        const one = { j, quantity, canvas, cursor, said, cell };
        this.listen(one);
        this.cells.push(one);
        this.box.append(cell);
      }
    });
    this.draw();
  }

  /** Click goes to a time, dragging zooms, a double click shows all. */
  listen({ canvas }) {
    let from = null;
    const at = (event) => {
      const box = canvas.getBoundingClientRect();
      const share = (event.clientX - box.left - 46) / Math.max(1, box.width - 50);
      return this.range[0] + Math.min(1, Math.max(0, share)) * (this.range[1] - this.range[0]);
    };
    canvas.addEventListener("pointerdown", (event) => { from = { x: event.clientX, time: at(event) }; });
    canvas.addEventListener("pointerup", (event) => {
      if (!from) return;
      if (event.pointerType === "mouse" && Math.abs(event.clientX - from.x) > 12) this.zoom([from.time, at(event)].sort((a, b) => a - b));
      else this.seek(at(event));
      from = null;
    });
    canvas.addEventListener("dblclick", () => this.zoom([0, this.steps * this.dt]));
  }

  zoom(range) {
    if (range[1] - range[0] < 5 * this.dt) return;
    this.range = range;
    this.draw();
  }

  /** Put the cursors to a time, and say what is there. */
  tell(time) {
    this.time = time;
    const n = this.joints.length;
    const k = Math.round(time / this.dt);
    const share = (time - this.range[0]) / (this.range[1] - this.range[0]);
    for (const { j, quantity, cursor, said, canvas } of this.cells) {
      cursor.hidden = share < 0 || share > 1;
      cursor.style.left = `${46 + share * Math.max(1, canvas.clientWidth - 50)}px`;
      said.textContent = this.runs.map(({ values }) => Armgpi.short(quantity.of(values, k * n + j))).join(" | ");
    }
  }

  draw() {
    for (const cell of this.cells) this.paint(cell);
    this.tell(this.time);
  }

  paint({ j, quantity, canvas }) {
    const width = canvas.clientWidth, height = canvas.clientHeight, ratio = window.devicePixelRatio || 1;
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const inner = { left: 46, top: 4, width: Math.max(1, width - 50), height: height - 18 };
    const lines = [];
    for (const { values, color } of this.runs) {
      if (quantity.reference && lines.length === 0) lines.push({ ...this.line(values, quantity.reference, j, inner.width), color: "#7f7f7f" });
      lines.push({ ...this.line(values, quantity.of, j, inner.width), color });
    }
    let low = Math.min(...lines.map((line) => line.low)), high = Math.max(...lines.map((line) => line.high));
    if (!Number.isFinite(low) || !Number.isFinite(high)) [low, high] = [-1, 1];
    const room = 0.06 * (high - low) || Math.max(1e-12, 0.1 * Math.abs(high));
    [low, high] = [low - room, high + room];
    const y = (value) => inner.top + (inner.height * (high - value)) / (high - low);
    this.axes(pen, inner, low, high, y);
    for (const line of lines) {
      pen.strokeStyle = line.color;
      pen.lineWidth = 1.3;
      pen.beginPath();
      let begun = false;
      for (let i = 0; i < line.count; i++) {
        const value = line.points[i];
        if (!Number.isFinite(value)) { begun = false; continue; }
        const x = inner.left + line.places[i];
        if (begun) pen.lineTo(x, y(value)); else pen.moveTo(x, y(value));
        begun = true;
      }
      pen.stroke();
    }
  }

  axes(pen, inner, low, high, y) {
    pen.font = "10px system-ui, DejaVu Sans, sans-serif";
    pen.strokeStyle = "#e3e7eb";
    pen.lineWidth = 1;
    pen.fillStyle = "#5f6b76";
    pen.textAlign = "right";
    const step = PlayCurves.step((high - low) / 3);
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      pen.beginPath();
      pen.moveTo(inner.left, y(value));
      pen.lineTo(inner.left + inner.width, y(value));
      pen.stroke();
      const shown = Math.abs(value) < 1e-9 * step ? 0 : value;
      pen.fillText(Math.abs(shown) < 1e-3 && shown !== 0 ? shown.toExponential(0) : String(Number(shown.toPrecision(3))), inner.left - 4, y(value) + 3);
    }
    pen.textAlign = "center";
    const [begin, end] = this.range, wide = PlayCurves.step((end - begin) / Math.max(2, inner.width / 70));
    for (let t = Math.ceil(begin / wide) * wide; t <= end + 1e-9; t += wide) {
      const x = inner.left + (inner.width * (t - begin)) / (end - begin);
      pen.fillText(String(Number(t.toPrecision(4))), Math.min(x, inner.left + inner.width - 8), inner.top + inner.height + 12);
    }
  }

  /** Return a line's points: of each pixel's samples the first, the lowest, the highest. */
  line(values, of, j, pixels) {
    const n = this.joints.length;
    const first = Math.max(0, Math.floor(this.range[0] / this.dt)), last = Math.min(this.steps, Math.ceil(this.range[1] / this.dt));
    const span = (this.range[1] - this.range[0]) / this.dt, begin = this.range[0] / this.dt;
    const each = Math.max(1, Math.floor((last - first) / pixels));
    const points = new Float64Array(2 * Math.ceil((last - first + 1) / each) + 2), places = new Float64Array(points.length);
    let count = 0, low = Infinity, high = -Infinity;
    for (let k = first; k <= last; k += each) {
      let least = NaN, most = NaN, at_least = k, at_most = k;
      for (let i = k; i < k + each && i <= last; i++) {
        const value = of(values, i * n + j);
        if (!(value >= least)) { if (value === value) { least = value; at_least = i; } }
        if (!(value <= most)) { if (value === value) { most = value; at_most = i; } }
      }
      if (least < low) low = least;
      if (most > high) high = most;
      const pair = at_least <= at_most ? [[at_least, least], [at_most, most]] : [[at_most, most], [at_least, least]];
      for (const [i, value] of each === 1 ? pair.slice(0, 1) : pair) {
        places[count] = (pixels * (i - begin)) / span;
        points[count++] = value;
      }
    }
    return { points, places, count, low, high };
  }
}

/** Return 1, 2 or 5 times a power of ten near a number. */
PlayCurves.step = (about) => {
  const power = Math.pow(10, Math.floor(Math.log10(about)));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= about * 0.999);
};
