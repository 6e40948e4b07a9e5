// The generated loop: its numbers, its run by WebAssembly, in a worker where there are such.
//
// `PlayLoop` runs; it is written so that a worker can be made of its text. `PlayNumbers` turns what the
// controls say into the numbers of a run.
"use strict";

/** Run the loops of a module. */
class PlayLoop {
  /** Take in the module's code. */
  async load(code) {
    const compiled = await WebAssembly.compile(code);
    // What a C library would ask of a system, which none of this does.
    const imports = {};
    for (const { module, name } of WebAssembly.Module.imports(compiled)) {
      imports[module] = imports[module] || {};
      imports[module][name] = () => 0;
    }
    const { exports } = await WebAssembly.instantiate(compiled, imports);
    if (exports._initialize) exports._initialize();
    this.exports = exports;
  }

  /** Return what a run gives: a name -> numbers (samples, joints), when it diverged (-1), and its time [ms]. */
  run({ form, names, n, steps, shared, start, draws, table, width, kernels, divergence }) {
    const begun = performance.now();
    const { memory, __heap_base: base } = this.exports;
    const samples = steps + 1;
    let end = base.value;
    const room = (bytes) => {
      const at = (end + 63) & ~63;
      end = at + bytes;
      return at;
    };
    const job = room(120), ended = room(8), list = room(4 * names.length), drawn = room(16 * draws.length + 8), seeds = room(8 * draws.length + 8);
    const numbers = room(8 * shared.length + 8), none = room(64), rows = room(table ? table.byteLength : 8);
    const state = room(8 * (start.length + names.length * n + 1));
    const outs = names.map(() => room(8 * samples * n));
    const missing = end - memory.buffer.byteLength;
    if (missing > 0) memory.grow(Math.ceil(missing / 65536));
    const view = new DataView(memory.buffer);
    const floats = (at, count) => new Float64Array(memory.buffer, at, count);
    floats(numbers, shared.length).set(shared);
    floats(state, start.length + names.length * n).fill(0).set(start);
    if (table) floats(rows, table.length).set(table);
    draws.forEach(([seed, stream, offset], d) => {
      [stream, offset].forEach((x, i) => view.setBigUint64(drawn + 16 * d + 8 * i, BigInt(x), true));
      view.setBigUint64(seeds + 8 * d, BigInt(seed), true);
    });
    outs.forEach((at, i) => view.setUint32(list + 4 * i, at, true));
    view.setBigInt64(ended, -1n, true);
    kernels.forEach((kernel, call) => this.exports.choose(call, kernel));
    const call = (k0, k1, final) => {
      const first = table ? rows + 8 * width * k0 : rows;
      [state, numbers, none, first, drawn, seeds, list, none, ended].forEach((at, i) => view.setUint32(job + 4 * i, at, true));
      [1, 1, 0, k0, k1, 1, final].forEach((x, i) => view.setBigInt64(job + 40 + 8 * i, BigInt(x), true));
      view.setFloat64(job + 96, divergence, true);
      view.setBigInt64(job + 112, 0n, true);  // records doubles
      this.exports[`run_${form}`](job, 0n, 1n);
    };
    call(0, steps, 0);
    call(steps, steps + 1, 1);
    const stopped = Number(view.getBigInt64(ended, true));
    const values = {};
    names.forEach((name, i) => {
      const found = floats(outs[i], samples * n).slice();
      // What was there before is of another run.
      if (stopped >= 0) found.fill(NaN, stopped * n);
      values[name] = found;
    });
    return { values, stopped, spent: performance.now() - begun };
  }
}

/** Runs loops one after the other, in a worker if it can; of those that wait the last one alone. */
class PlayRunner {
  async load(code) {
    this.waiting = null;
    this.busy = false;
    const text = `"use strict"; ${PlayLoop.toString()}
      const loop = new PlayLoop();
      onmessage = async ({ data }) => {
        try {
          if (data.code) { await loop.load(data.code); postMessage({ loaded: true }); return; }
          const result = loop.run(data);
          postMessage(result, Object.values(result.values).map((x) => x.buffer));
        } catch (error) { postMessage({ error: String(error) }); }
      };`;
    try {
      this.worker = new Worker(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
      const answer = await this.asked({ code });
      if (answer.error) throw new Error(answer.error);
    } catch (error) {
      // Some browsers have no workers for files: the page then waits for the loop.
      this.worker = null;
      this.loop = new PlayLoop();
      await this.loop.load(code);
    }
  }

  asked(message) {
    return new Promise((resolve, reject) => {
      this.worker.onmessage = (event) => resolve(event.data);
      this.worker.onerror = (event) => reject(new Error(event.message || "no worker can be started"));
      this.worker.postMessage(message);
    });
  }

  /** Run, and tell `done` the result; requests that came before and still wait are left out. */
  async request(message, done) {
    this.waiting = { message, done };
    if (this.busy) return;
    this.busy = true;
    while (this.waiting) {
      const { message: now, done: tell } = this.waiting;
      this.waiting = null;
      const result = this.worker ? await this.asked(now) : this.loop.run(now);
      if (result.error) throw new Error(result.error);
      tell(result);
    }
    this.busy = false;
  }
}

/** The experiment that the controls describe, and the numbers of its loop. */
class PlayNumbers {
  constructor(play, array, n) {
    this.play = play;
    this.array = array;
    this.n = n;
    this.form = {};
    this.moved = {};
    for (const choice of play.choices) this.form[choice.id] = choice.value;
    play.controls.forEach((control, i) => {
      control.key = `${control.id} ${control.only ? control.only[1] : ""}`;
      control.index = i;
      this.moved[control.key] = control.value;
    });
  }

  /** Return whether a choice or a control belongs to the form that is chosen. */
  belongs(one) {
    if (!one.only || one.only.length === 0) return true;
    if (!("key" in one)) return one.only.includes(this.form["controllers.0"]);
    return this.form[one.only[0].join(".")] === one.only[1];
  }

  variant() {
    const fits = ({ form }) => Object.entries(form).every(([id, value]) => this.form[id] === value);
    const index = this.play.variants.findIndex(fits);
    return { index, variant: this.play.variants[index] };
  }

  /** Return the controls of the form by their ids. */
  controls() {
    const found = {};
    for (const control of this.play.controls) if (this.belongs(control)) found[control.id] = control;
    return found;
  }

  /** Return the place of a control's value on its slider, -1 where it has none. */
  stop(control) {
    const wanted = JSON.stringify(this.moved[control.key]);
    return control.values.findIndex((value) => JSON.stringify(value) === wanted);
  }

  /** Move a control; what cannot be moved together goes back. */
  move(control, value) {
    this.moved[control.key] = value;
    const other = control.excludes && this.controls()[control.excludes];
    if (other) this.moved[other.key] = other.value;
  }

  /** Return the experiment as plain data, every key filled in. */
  experiment() {
    const { play } = this;
    const config = JSON.parse(JSON.stringify(play.config));
    config.controllers = [JSON.parse(JSON.stringify(play.sections[this.form["controllers.0"]]))];
    const put = (path, value, whole) => {
      const last = path[path.length - 1], name = path[path.length - 2];
      const above = path.slice(0, -2).reduce((section, step) => section[step], config);
      if (path.length === 1) { config[last] = value; return; }
      if (whole && !value) { above[name] = null; return; }
      if (whole && above[name] === null) above[name] = { ...whole };
      above[name][last] = value;
    };
    for (const choice of play.choices.slice(1)) if (this.belongs(choice)) put(choice.path, this.form[choice.id]);
    for (const control of Object.values(this.controls())) put(control.path, this.moved[control.key], control.whole);
    config.plant.loads = config.plant.loads.filter((load) => !Array.isArray(load.amplitude) || load.amplitude.some((x) => x !== 0));
    if (config.plant.friction === "none") config.robot.friction = play.friction;
    return config;
  }

  /** Return what the loop's run is given. */
  run() {
    const { play } = this;
    const { index, variant } = this.variant();
    const controls = this.controls();
    const numbers = this.array(variant.numbers).slice();
    const place = (ids) => ids.reduce((at, id) => at * controls[id].values.length + Math.max(0, this.stop(controls[id])), 0);
    const moved = (id) => JSON.stringify(controls[id].value) !== JSON.stringify(this.moved[controls[id].key]);
    const put = ({ controls: ids, at, values, unless: [own, other] }, target) => {
      // Of two tables with controls that exclude each other the one that is moved counts.
      if (other && moved(other) && !moved(own)) return;
      const all = this.array(values), from = place(ids) * at.length;
      at.forEach((to, i) => { target[to] = all[from + i]; });
    };
    for (const table of variant.tables) put(table, numbers);
    for (const move of variant.moves) {
      const value = this.moved[controls[move.control].key];
      move.at.forEach((at, i) => {
        const one = move.joint[i] < 0 ? value : value[move.joint[i]];
        const signed = move.factor[i] < 0 ? -one : one;
        numbers[at] = move.constant[i] === 0 ? signed : signed + move.constant[i];
      });
    }
    if (variant.tape) PlayNumbers.worked_out(variant.tape, numbers);
    const { layout, draws } = variant;
    const shared = Float64Array.from(layout.shared, (at) => numbers[at]), start = numbers.subarray(variant.shared);
    const kernels = [];
    for (const table of variant.arms) put(table, kernels);
    return {
      form: index, names: layout.names, n: this.n, steps: play.steps, shared, start, draws,
      table: variant.table ? this.array(variant.table) : null, width: layout.table, kernels, divergence: play.divergence,
    };
  }

  /** Return the experiment without what need not be said. */
  short() {
    const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
    const without = (section, defaults) =>
      Object.fromEntries(Object.entries(section).filter(([key, value]) => !(key in defaults) || !same(value, defaults[key])));
    const { defaults } = this.play;
    const config = without(this.experiment(), defaults);
    for (const key of ["robot", "plant", "reference"]) config[key] = without(config[key] || {}, defaults[key]);
    config.controllers = config.controllers.map((section) => {
      const left = without(section, defaults.controllers[section.type]);
      if (left.label === section.type) delete left.label;
      return left;
    });
    for (const key of Object.keys(config)) if (same(config[key], {})) delete config[key];
    return config;
  }

  yaml() {
    return PlayNumbers.yaml(this.short(), "");
  }

  python() {
    const label = this.experiment().controllers[0].label || this.form["controllers.0"];
    return [
      "import armgpi", "from armgpi import config", "", `EXPERIMENT = """`, `${this.yaml().replace(/\\/g, "\\\\")}"""`, "",
      `experiment = config.build(*config.parse(EXPERIMENT, "played"))`,
      `rollout = armgpi.simulate(`, `    experiment.plant,`, `    experiment.controllers[${JSON.stringify(label)}],`,
      `    experiment.reference,`, `    experiment.t_final,`, `    backend="compiled",`, `)`, `print(armgpi.metrics.itae(rollout))`, "",
    ].join("\n");
  }

  command() {
    return `cat > played.yaml <<'EOF'\n${this.yaml()}EOF\narmgpi run --config played.yaml --backend compiled --out played\n`;
  }
}

/** Work numbers out of others: sums, differences, products and quotients in the order of the tape. */
PlayNumbers.worked_out = (tape, shared) => {
  const values = [];
  for (const [operation, i, j] of tape.steps) {
    const a = values[i], b = values[j];
    if (operation === "place") values.push(shared[i]);
    else if (operation === "number") values.push(i);
    else values.push(operation === "+" ? a + b : operation === "-" ? a - b : operation === "*" ? a * b : a / b);
  }
  for (const [from, to] of tape.outputs) shared[to] = values[from];
};

/** Return plain data as YAML. */
PlayNumbers.yaml = (data, indent) => {
  const scalar = (x) => (typeof x === "string" ? JSON.stringify(x) : x === null ? "null" : String(x));
  const flat = (x) => (Array.isArray(x) ? `[${x.map(flat).join(", ")}]` : scalar(x));
  const simple = (x) => x === null || typeof x !== "object" || (Array.isArray(x) && x.every((y) => y === null || typeof y !== "object" || (Array.isArray(y) && simple(y))));
  const lines = [];
  for (const [key, value] of Object.entries(data)) {
    const name = /^[A-Za-z_][\w-]*$/.test(key) ? key : JSON.stringify(key);
    if (simple(value)) lines.push(`${indent}${name}: ${flat(value)}`);
    else if (Array.isArray(value)) {
      lines.push(`${indent}${name}:`);
      for (const item of value) {
        if (simple(item)) lines.push(`${indent}  - ${flat(item)}`);
        else lines.push(`${indent}  - ${PlayNumbers.yaml(item, `${indent}    `).trim()}`);
      }
    } else lines.push(`${indent}${name}:\n${PlayNumbers.yaml(value, `${indent}  `).trimEnd()}`);
  }
  return `${lines.join("\n")}\n`;
};
