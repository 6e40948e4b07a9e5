// Curves over time on canvases: drawn anew in a few milliseconds, all with one time.
"use strict";

/** The tool of an arm: where joint positions put it, in plain numbers, as every sample of a run asks for it. */
class PlayTool {
  constructor({ bodies, tip }) {
    this.chain = [];
    for (let i = tip.body; i >= 0; i = bodies[i].parent) this.chain.unshift(bodies[i]);
    this.offset = tip.placement.slice(12, 15);
  }

  /** Put the position of the tool [m] into `point`, at the joint positions that begin at `at`. */
  position(q, at, point) {
    let [x, y, z] = this.offset;
    for (let i = this.chain.length - 1; i >= 0; i--) {
      const { kind, axis, ratio, offset, coordinate, position, rotation } = this.chain[i];
      const moved = kind === "" ? 0 : ratio * q[at + coordinate] + offset;
      if (kind === "prismatic") {
        x += axis.x * moved; y += axis.y * moved; z += axis.z * moved;
      } else if (kind !== "") {
        const s = Math.sin(moved / 2);
        [x, y, z] = PlayTool.turned(axis.x * s, axis.y * s, axis.z * s, Math.cos(moved / 2), x, y, z);
      }
      [x, y, z] = PlayTool.turned(rotation.x, rotation.y, rotation.z, rotation.w, x, y, z);
      x += position.x; y += position.y; z += position.z;
    }
    point[0] = x; point[1] = y; point[2] = z;
  }

  /** Return how far the tool is from where the reference has it [mm], at every sample. */
  distances({ q, q_ref }, n) {
    const is = [0, 0, 0], wished = [0, 0, 0];
    return Float64Array.from({ length: q.length / n }, (_, k) => {
      this.position(q, k * n, is);
      this.position(q_ref, k * n, wished);
      return 1e3 * Math.hypot(is[0] - wished[0], is[1] - wished[1], is[2] - wished[2]);
    });
  }
}

/** Return a point turned by a quaternion of length 1. */
PlayTool.turned = (a, b, c, w, x, y, z) => {
  const u = 2 * (b * z - c * y), v = 2 * (c * x - a * z), t = 2 * (a * y - b * x);
  return [x + w * u + b * t - c * v, y + w * v + c * u - a * t, z + w * t + a * v - b * u];
};

/** Return the largest force of one of the contacts [N], at every sample; a run has them cut into pieces of n. */
function contact_forces(values, contacts, n, samples) {
  const of = (i, k) => values[`contacts.${Math.floor(i / n)}`][k * n + (i % n)];
  return Float64Array.from({ length: samples }, (_, k) => {
    let most = 0;
    for (let c = 0; c < contacts; c++) most = Math.max(most, Math.hypot(of(6 * c, k), of(6 * c + 1, k), of(6 * c + 2, k)));
    return most;
  });
}

/** Return the figures of the tool: largest distance from its path [mm], largest and last force of a contact [N]. */
function tool_metrics({ tool_error, force }, stopped) {
  if (stopped >= 0) return { tool: Infinity, press: Infinity, end: Infinity };
  const most = (x) => x.reduce((a, b) => Math.max(a, b), 0);
  return { tool: most(tool_error), press: most(force), end: force[force.length - 1] };
}

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

/** Room of an axis beside its curve [px]. */
const LEFT = 46, RIGHT = 4;

class Curves {
  /** Draw cells into `box` over a span of time; `seek` is told a time that is clicked.
   *
   * A class says by `content` which cells there are: each with a title, `lines(width)` (points, their places, and
   * how they look), what to say of a time, and, where there are any, the heading above it, levels and an onset. */
  constructor(box, span, least, seek) {
    Object.assign(this, { box, span, least, seek, range: span, time: span[0], cells: [] });
    new ResizeObserver(() => this.draw()).observe(box);
  }

  /** Make the cells anew. */
  layout() {
    const { element } = Armgpi;
    this.box.textContent = "";
    this.cells = this.content().map((content) => {
      const canvas = element("canvas", { role: "img", "aria-label": content.title });
      const cursor = element("div", { class: "cursor" }), said = element("output", { class: "said" });
      if (content.heading) this.box.append(element("h3", {}, content.heading));
      const style = content.columns ? `grid-column: span ${content.columns}` : "";
      this.box.append(element("div", { class: "curve", style }, element("span", { class: "title", title: content.title }, content.title), canvas, cursor, said));
      const cell = { levels: [], onset: null, ...content, canvas, cursor, said };
      this.listen(cell);
      return cell;
    });
    this.draw();
  }

  /** Click goes to a time, dragging zooms, a double click shows all. */
  listen({ canvas }) {
    let from = null;
    const at = (event) => {
      const box = canvas.getBoundingClientRect();
      const share = (event.clientX - box.left - LEFT) / Math.max(1, box.width - LEFT - RIGHT);
      return this.range[0] + Math.min(1, Math.max(0, share)) * (this.range[1] - this.range[0]);
    };
    canvas.addEventListener("pointerdown", (event) => { from = { x: event.clientX, time: at(event) }; });
    canvas.addEventListener("pointerup", (event) => {
      if (!from) return;
      if (event.pointerType === "mouse" && Math.abs(event.clientX - from.x) > 12) this.zoom([from.time, at(event)].sort((a, b) => a - b));
      else this.seek(at(event));
      from = null;
    });
    canvas.addEventListener("dblclick", () => this.zoom(this.span));
  }

  zoom(range) {
    if (range[1] - range[0] < this.least) return;
    this.range = range;
    this.draw();
  }

  /** Put the cursors to a time, and say what is there. */
  tell(time) {
    this.time = time;
    const share = (time - this.range[0]) / (this.range[1] - this.range[0]);
    for (const { cursor, said, canvas, says } of this.cells) {
      cursor.hidden = share < 0 || share > 1;
      cursor.style.left = `${LEFT + share * Math.max(1, canvas.clientWidth - LEFT - RIGHT)}px`;
      cursor.style.top = `${canvas.offsetTop}px`;
      said.textContent = says(time).map((x) => Armgpi.short(x)).join(" | ");
    }
  }

  draw() {
    for (const cell of this.cells) this.paint(cell);
    this.tell(this.time);
  }

  paint({ lines: make, levels, onset, canvas }) {
    const width = canvas.clientWidth, height = canvas.clientHeight, ratio = window.devicePixelRatio || 1;
    const pen = width && height ? canvas.getContext("2d") : null;
    if (!pen) return;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const inner = { left: LEFT, top: 4, width: Math.max(1, width - LEFT - RIGHT), height: height - 18 };
    const lines = make(inner.width);
    let low = Math.min(...lines.map((line) => line.low), ...levels), high = Math.max(...lines.map((line) => line.high), ...levels);
    if (!Number.isFinite(low) || !Number.isFinite(high)) [low, high] = [-1, 1];
    const room = 0.06 * (high - low) || Math.max(1e-12, 0.1 * Math.abs(high));
    [low, high] = [low - room, high + room];
    const y = (value) => inner.top + (inner.height * (high - value)) / (high - low);
    this.axes(pen, inner, low, high, y);
    pen.save();
    pen.beginPath();
    pen.rect(inner.left, inner.top, inner.width, inner.height);
    pen.clip();
    const straight = (color, dash, from, to) => this.stroke(pen, { color, dash, width: 1 }, () => { pen.moveTo(...from); pen.lineTo(...to); });
    for (const level of levels) straight("#7f7f7f", [8, 3, 2, 3], [LEFT, y(level)], [width, y(level)]);
    if (onset !== null) {
      const x = LEFT + (inner.width * (onset - this.range[0])) / (this.range[1] - this.range[0]);
      straight("#882255", [2, 2], [x, 0], [x, height]);
    }
    for (const line of lines) {
      this.stroke(pen, line, () => {
        let begun = false;
        for (let i = 0; i < line.count; i++) {
          const value = line.points[i];
          if (!Number.isFinite(value)) { begun = false; continue; }
          const x = inner.left + line.places[i];
          if (begun) pen.lineTo(x, y(value)); else pen.moveTo(x, y(value));
          begun = true;
        }
      });
    }
    pen.restore();
  }

  stroke(pen, { color, dash = [], width = 1.4 }, draw) {
    pen.strokeStyle = color;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.beginPath();
    draw();
    pen.stroke();
    pen.setLineDash([]);
  }

  axes(pen, inner, low, high, y) {
    pen.font = "10px system-ui, DejaVu Sans, sans-serif";
    pen.strokeStyle = "#e3e7eb";
    pen.lineWidth = 1;
    pen.fillStyle = "#5f6b76";
    pen.textAlign = "right";
    const step = Curves.step((high - low) / 4);
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      pen.beginPath();
      pen.moveTo(inner.left, y(value));
      pen.lineTo(inner.left + inner.width, y(value));
      pen.stroke();
      const shown = Math.abs(value) < 1e-9 * step ? 0 : value;
      pen.fillText(Math.abs(shown) < 1e-3 && shown !== 0 ? shown.toExponential(0) : String(Number(shown.toPrecision(3))), inner.left - 4, y(value) + 3);
    }
    pen.textAlign = "center";
    const [begin, end] = this.range, wide = Curves.step((end - begin) / Math.max(2, inner.width / 70));
    for (let t = Math.ceil(begin / wide) * wide; t <= end + 1e-9; t += wide) {
      const x = inner.left + (inner.width * (t - begin)) / (end - begin);
      const unit = t + wide > end + 1e-9 ? " s" : "";
      pen.fillText(String(Number(t.toPrecision(4))) + unit, Math.min(x, inner.left + inner.width - 12), inner.top + inner.height + 12);
    }
  }
}

/** Curves of runs of which every sample is there. */
class PlayCurves extends Curves {
  constructor(box, joints, dt, steps, contacts, seek) {
    super(box, [0, steps * dt], 5 * dt, seek);
    Object.assign(this, { joints, dt, steps, runs: [] });
    this.quantities = [
      { name: "error", unit: "unit", of: (v, i) => v.q[i] - v.q_ref[i] },
      { name: "torque", unit: "torque_unit", of: (v, i) => v.tau[i] },
      { name: "position", unit: "unit", of: (v, i) => v.q[i], reference: (v, i) => v.q_ref[i] },
      { name: "omega_c", title: "ω", unit: "rad/s", of: (v, i) => (v.omega_c ? v.omega_c[i] : NaN) },
      { name: "tool error", unit: "mm", of_tool: (v, k) => v.tool_error[k] },
    ];
    if (contacts) this.quantities.push({ name: "contact force", unit: "N", of_tool: (v, k) => v.force[k] });
    this.chosen = new Set(contacts ? ["error", "torque", "tool error", "contact force"] : ["error", "torque"]);
    this.shown = new Set(joints.map((_, j) => j));
  }

  /** Show runs, each values by their names and the index of its colour. */
  show(runs) {
    this.runs = runs;
    this.draw();
  }

  /** Return the cells: those of the tool, then a row for each joint, a column for each quantity. */
  content() {
    const chosen = this.quantities.filter(({ name }) => this.chosen.has(name));
    const of_tool = chosen.filter((quantity) => quantity.of_tool), of_joints = chosen.filter((quantity) => quantity.of);
    const columns = Math.max(1, of_joints.length), n = this.joints.length;
    this.box.style.setProperty("--columns", String(columns));
    const share = Math.max(1, Math.floor(columns / Math.max(1, of_tool.length)));
    const tool = of_tool.map((quantity, i) => ({
      ...this.cell(`tool · ${quantity.name} [${quantity.unit}]`.replace("tool · tool", "tool ·"), quantity.of_tool, null, (k) => k),
      columns: i === of_tool.length - 1 ? Math.max(1, columns - share * i) : share,
    }));
    return [...tool, ...[...this.shown].sort((a, b) => a - b).flatMap((j) => of_joints.map(({ name, title, unit, of, reference }) =>
      this.cell(`${this.joints[j].name} · ${title || name} [${this.joints[j][unit] || unit}]`, of, reference, (k) => k * n + j)))];
  }

  /** Return a cell: `of` a run's values at an index, which `at` makes of a sample, and maybe its reference. */
  cell(title, of, reference, at) {
    return {
      title,
      lines: (pixels) => this.lines(of, reference, at, pixels),
      says: (time) => this.runs.map(({ values }) => of(values, at(Math.round(time / this.dt)))),
    };
  }

  lines(of, reference, at, pixels) {
    const own = this.runs.map(({ values, color, dash }) => ({ ...this.line(values, of, at, pixels), color, dash }));
    return reference && this.runs.length ? [{ ...this.line(this.runs[0].values, reference, at, pixels), color: "#7f7f7f" }, ...own] : own;
  }

  /** Return a line's points: of each pixel's samples the first, the lowest, the highest. */
  line(values, of, at, pixels) {
    const first = Math.max(0, Math.floor(this.range[0] / this.dt)), last = Math.min(this.steps, Math.ceil(this.range[1] / this.dt));
    const span = (this.range[1] - this.range[0]) / this.dt, begin = this.range[0] / this.dt;
    const each = Math.max(1, Math.floor((last - first) / pixels));
    const points = new Float64Array(2 * Math.ceil((last - first + 1) / each) + 2), places = new Float64Array(points.length);
    let count = 0, low = Infinity, high = -Infinity;
    for (let k = first; k <= last; k += each) {
      let least = NaN, most = NaN, at_least = k, at_most = k;
      for (let i = k; i < k + each && i <= last; i++) {
        const value = of(values, at(i));
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
Curves.step = (about) => {
  const power = Math.pow(10, Math.floor(Math.log10(about)));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= about * 0.999);
};
