// The page to play with: controls, the loop, the scene and the curves.
"use strict";

(async () => {
  const by = (id) => document.getElementById(id);
  const { element, short, clamp } = Armgpi;
  const FRAME_RATE = 100;
  /** A metric as text; less than that is rounding, as in the tables of the command line. */
  const ROUNDING = 1e-12;
  const number = (x) => !Number.isFinite(x) ? "∞" : Math.abs(x) < ROUNDING ? "0" : Math.abs(x) < 1e-3 ? x.toExponential(2) : x.toPrecision(4);

  /** Return the forces of contacts and where they act at the frames; a run has them cut into pieces of n. */
  function touched(result, play, n, every, frames) {
    const { contacts } = play, size = 6 * contacts;
    const forces = new Float32Array(3 * contacts * frames), points = new Float32Array(3 * contacts * frames);
    for (let f = 0; f < frames; f++) {
      for (let i = 0; i < size; i++) {
        const value = result.values[`contacts.${Math.floor(i / n)}`][f * every * n + (i % n)];
        const to = 3 * (contacts * f + Math.floor(i / 6)) + (i % 3);
        // There is no force any more where a run has diverged.
        (i % 6 < 3 ? forces : points)[to] = Number.isFinite(value) ? clamp(value, -1e30, 1e30) : 0;
      }
    }
    return { contacts, forces, points };
  }

  /** Return a run as the scene has it: frames of single precision. */
  function actor(result, play, joints) {
    const n = joints.length;
    const every = Math.max(1, Math.round(1 / (FRAME_RATE * play.dt)));
    const frames = Math.floor(play.steps / every) + 1;
    const names = ["q", "q_ref", "tau"], made = {};
    for (const name of names) made[name] = new Float32Array(frames * n);
    made.saturated = new Uint8Array(frames * n);
    let good = 0;
    for (let f = 0; f < frames; f++) {
      const k = f * every;
      // A pose is held where there is none any more.
      if (Number.isFinite(result.values.q[k * n])) good = k;
      for (let j = 0; j < n; j++) {
        for (const name of names) {
          const value = result.values[name][(name === "q" ? good : k) * n + j];
          made[name][f * n + j] = Number.isFinite(value) ? clamp(value, -1e30, 1e30) : 0;
        }
        const { effort } = joints[j];
        made.saturated[f * n + j] = effort > 0 && Math.abs(result.values.tau[k * n + j]) >= effort * (1 - 1e-9) ? 1 : 0;
      }
    }
    const times = Float32Array.from({ length: frames }, (_, f) => f * every * play.dt);
    const stopped = result.stopped >= 0;
    Object.assign(made, touched(result, play, n, every, frames));
    return { ...made, times, end: stopped ? "diverged" : "finished", t_end: (stopped ? result.stopped : play.steps) * play.dt };
  }

  class Page {
    constructor(meta, array) {
      Object.assign(this, { meta, play: meta.play, joints: meta.arm.joints });
      this.numbers = new PlayNumbers(meta.play, array, this.joints.length);
      this.runner = new PlayRunner();
      this.frozen = null;
      this.result = null;
      this.rows = [];
      this.count = 0;
      this.array = array;
    }

    async begin() {
      await this.runner.load(this.array(this.play.code).slice());
      await new Promise((resolve, reject) => {
        this.runner.request(this.numbers.run(), (result) => { this.result = result; resolve(); }).catch(reject);
      });
      const first = actor(this.result, this.play, this.joints);
      const [own, other] = this.play.colors;
      this.meta.clip = {
        times: first.times, disturbance: new Float32Array(first.q.length), onsets: {}, walls: this.play.walls,
        actors: [{ ...first, label: "now", color: own, plain: true }, { ...first, label: "frozen", color: other, opacity: 0.5, hidden: true }],
      };
      this.scene = new Armgpi.ArmScene(by("scene"), this.meta, this.array);
      this.tool = new PlayTool({ bodies: this.scene.bodies, tip: this.meta.arm.tip });
      this.scene.set_apart(false);
      this.scene.show_actor(1, false);
      this.scene.look_from("iso");
      this.player = new Armgpi.Player(this.scene, by("player"), false);
      Armgpi.switches(this.scene, by("switches"));
      const { play } = this;
      this.curves = new PlayCurves(by("curves"), this.joints, play.dt, play.steps, play.contacts, (time) => { this.player.play(false); this.scene.show(time); });
      this.curves_choices();
      this.curves.layout();
      this.scene.addEventListener("time", (event) => this.curves.tell(event.detail));
      this.panel();
      this.buttons();
      this.copies();
      this.listen_pushes();
      this.shown();
    }

    /** Simulate anew and show it. */
    changed() {
      const begun = performance.now();
      this.mark();
      this.runner.request(this.numbers.run(), (result) => {
        this.result = result;
        this.shown();
        this.count++;
        // The curves are seen a frame earlier than the arm, of which the tool's path is drawn anew.
        requestAnimationFrame(() => {
          this.latency = performance.now() - begun;
          setTimeout(() => { if (this.result === result) this.scene.replace(0, actor(result, this.play, this.joints), this.scene.clip.disturbance); });
        });
      }).catch((error) => { by("busy").textContent = `error: ${error.message || error}`; });
    }

    /** Add to a run where its tool is off its path, and the force of what touches it, at every sample. */
    add_tool({ values }) {
      const n = this.joints.length;
      values.tool_error = this.tool.distances(values, n);
      values.force = contact_forces(values, this.play.contacts, n, values.tool_error.length);
    }

    /** Show the numbers and the curves of the run, and of the frozen one. */
    shown() {
      this.add_tool(this.result);
      const runs = [{ name: "now", ...this.result, color: this.play.colors[0] }];
      if (this.frozen) runs.unshift({ name: "frozen", ...this.frozen.result, color: this.play.colors[1], dash: [5, 3] });
      this.curves.show(runs);
      const n = this.joints.length;
      const units = this.joints.every((joint) => joint.unit === "m") ? ["m s²", "m", "m", "N", "N"] : ["rad s²", "rad", "rad", "N m", "N m"];
      const heads = ["ITAE", "peak error", "final error", "variation", "peak torque", "tool error"];
      units.push("mm", "N", "N");
      if (this.play.contacts) heads.push("peak force", "final force");
      const head = element("tr", {}, element("th", { class: "name" }, ""), ...heads.map((text, i) => element("th", { scope: "col" }, text, element("br"), element("small", {}, units[i]))));
      const rows = runs.map((run) => {
        run.metrics = play_metrics(run.values, n, this.play.dt, run.stopped);
        Object.assign(run.metrics.total, tool_metrics(run.values, run.stopped));
        const { itae, peak, final, variation, torque, tool, press, end } = run.metrics.total;
        const cells = [itae, peak, final, variation, torque, tool, press, end].slice(0, heads.length).map((x) => element("td", {}, number(x)));
        const dot = element("span", { class: "dot", style: `background:${run.color}` });
        const ended = run.stopped >= 0 ? ` diverged at ${short(run.stopped * this.play.dt)} s` : "";
        return element("tr", {}, element("th", { scope: "row", class: "name" }, dot, ` ${run.name}${run.dash ? ", dashed" : ""}${ended}`), ...cells);
      });
      this.metrics = runs[runs.length - 1].metrics;
      by("verdict").replaceChildren(element("table", { class: "data" }, element("thead", {}, head), element("tbody", {}, ...rows)));
      by("busy").textContent = `${short(this.play.steps * this.play.dt, 3)} s simulated in ${this.result.spent.toFixed(0)} ms`;
      if (by("copy").open) this.written();
    }

    // The controls ---------------------------------------------------------------------------------------------

    panel() {
      const groups = {};
      const into = (name) => {
        if (!groups[name]) {
          const open = window.innerWidth >= 860 ? name !== "disturbances" : name === "controller";
          groups[name] = element("details", open ? { open: "" } : {}, element("summary", {}, name));
          by("panel").append(groups[name]);
        }
        return groups[name];
      };
      for (const choice of this.play.choices) into(choice.id.startsWith("plant") ? "plant" : "controller").append(this.choice(choice));
      for (const control of this.play.controls) {
        if (control.group === "pushes") continue;
        into(control.group).append(control.joints.length ? this.joint_sliders(control) : this.slider(control));
      }
      into("pushes").append(...this.pushing());
      this.mark();
    }

    choice(choice) {
      const select = element("select", {
        "aria-label": choice.label, "data-id": choice.id,
        onchange: () => { this.numbers.form[choice.id] = choice.values[select.selectedIndex]; this.changed(); },
      }, ...choice.values.map((value) => element("option", {}, value === "urdf" ? "on" : String(value))));
      const row = element("label", { class: "move", title: choice.text }, element("span", {}, choice.label), select);
      this.rows.push({ row, shown: () => this.numbers.belongs(choice), told: () => {
        select.selectedIndex = choice.values.indexOf(this.numbers.form[choice.id]);
        return this.numbers.form[choice.id] !== choice.value;
      } });
      return row;
    }

    slider(control) {
      const { numbers } = this;
      const said = element("output");
      const input = element("input", {
        type: "range", min: 0, max: control.values.length - 1, step: 1, "aria-label": control.label, "data-id": control.id, title: control.text,
        oninput: () => { numbers.move(control, control.values[Number(input.value)]); this.changed(); },
      });
      const row = element("label", { class: "move", title: control.text }, element("span", {}, control.label), said, input);
      this.rows.push({ row, shown: () => this.useful(control), told: () => {
        const stop = numbers.stop(control);
        input.value = String(Math.max(0, stop));
        const shown = control.stops[stop];
        said.textContent = shown === null || shown === undefined ? (control.id === "plant.encoder_bits" ? "exact" : "as given") : `${Number(shown.toPrecision(4))} ${control.unit}`;
        input.setAttribute("aria-valuetext", said.textContent);
        return JSON.stringify(numbers.moved[control.key]) !== JSON.stringify(control.value);
      } });
      return row;
    }

    joint_sliders(control) {
      const { numbers } = this;
      const rows = this.joints.map((joint, j) => {
        const [low, high] = control.joints[j];
        const said = element("output");
        const input = element("input", {
          type: "range", min: low, max: high, step: "any", "aria-label": `${control.label}, ${joint.name}`, "data-id": `${control.id}.${j}`,
          oninput: () => {
            const value = numbers.moved[control.key].slice();
            value[j] = Number(Number(input.value).toPrecision(4));
            numbers.move(control, value);
            this.changed();
          },
        });
        const unit = control.id.startsWith("plant") ? joint.torque_unit : joint.unit;
        const row = element("label", { class: "move" }, element("span", { title: joint.name }, joint.name), said, input);
        this.rows.push({ row, shown: () => true, told: () => {
          const value = numbers.moved[control.key][j];
          if (document.activeElement !== input) input.value = String(value);
          said.textContent = `${short(value, 3)} ${unit}`;
          return value !== control.value[j];
        } });
        return row;
      });
      return element("div", { class: "joints", title: control.text }, element("small", {}, control.label), ...rows);
    }

    /** Return whether a control does something in the form that is chosen. */
    useful(control) {
      return this.numbers.belongs(control) && !this.numbers.variant().variant.unmoved.includes(control.id);
    }

    /** Show what belongs to the form, and what is not as it was. */
    mark() {
      for (const { row, shown, told } of this.rows) {
        row.hidden = !shown();
        if (!row.hidden) row.classList.toggle("changed", told());
      }
    }

    curves_choices() {
      const box = by("choices");
      const toggle = (label, set, key) => {
        const input = element("input", { type: "checkbox", checked: set.has(key), onchange: () => { if (input.checked) set.add(key); else set.delete(key); this.curves.layout(); } });
        box.append(element("label", { title: label }, input, ` ${label}`));
      };
      for (const { name, title } of this.curves.quantities) toggle(title || name, this.curves.chosen, name);
      box.append(element("span", { class: "clock" }, "|"));
      this.joints.forEach((joint, j) => toggle(joint.name, this.curves.shown, j));
      box.append(element("button", { type: "button", onclick: () => this.curves.zoom([0, this.play.steps * this.play.dt]) }, "whole time"));
      if (this.joints.length > 4) box.classList.add("many");
    }

    buttons() {
      const freeze = element("button", { type: "button", id: "freeze", onclick: () => this.freeze(!this.frozen) }, "Freeze for comparison");
      const reset = element("button", { type: "button", id: "reset", onclick: () => this.reset() }, "Reset");
      by("buttons").append(freeze, reset);
    }

    /** Keep this run to compare others with, or let it go. */
    freeze(on) {
      this.frozen = on ? { result: this.result, yaml: this.numbers.yaml() } : null;
      by("freeze").textContent = on ? "Let the frozen one go" : "Freeze for comparison";
      if (on) this.scene.replace(1, actor(this.result, this.play, this.joints), this.scene.clip.disturbance);
      this.scene.show_actor(1, on);
      this.shown();
    }

    reset() {
      for (const choice of this.play.choices) this.numbers.form[choice.id] = choice.value;
      for (const control of this.play.controls) this.numbers.moved[control.key] = control.value;
      this.pushes_shown();
      this.changed();
    }

    // Pushes ---------------------------------------------------------------------------------------------------

    pushing() {
      this.force = element("input", { type: "range", min: 1, max: 200, step: 1, value: 20, "aria-label": "force of a push" });
      this.force.value = "20";
      const said = element("output", {}, "20 N");
      this.force.addEventListener("input", () => { said.textContent = `${this.force.value} N`; });
      this.link = element("select", { "aria-label": "part that is pushed" }, ...this.meta.arm.bodies.map((_, i) => element("option", { value: String(i) }, i ? this.name(i) : "base")));
      this.link.selectedIndex = this.meta.arm.bodies.length - 1;
      const push = element("button", { type: "button", id: "push", onclick: () => this.push_part(this.link.selectedIndex) }, "Push");
      this.list = element("ul", { class: "pushes" });
      const clear = element("button", { type: "button", onclick: () => { this.without_pushes(); this.changed(); } }, "No pushes");
      return [
        element("small", {}, "Click on the arm: it is pushed there, away from you, at the time shown, for 0.2 s."),
        element("label", { class: "move" }, element("span", {}, "force"), said, this.force),
        element("div", { class: "row" }, this.link, push, clear), this.list,
      ];
    }

    name(body) {
      const { kind, coordinate } = this.meta.arm.bodies[body];
      return kind === "" ? "base" : `after ${this.joints[coordinate].name}`;
    }

    /** Return the controls of the pushes, two for each. */
    push_controls() {
      const mine = this.play.controls.filter((control) => control.group === "pushes");
      return Array.from({ length: mine.length / 2 }, (_, i) => [mine[2 * i], mine[2 * i + 1]]);
    }

    without_pushes() {
      for (const pair of this.push_controls()) for (const control of pair) this.numbers.moved[control.key] = control.value;
      this.pushes_shown();
    }

    pushes_shown() {
      const texts = [];
      for (const [amplitude, onset] of this.push_controls()) {
        const value = this.numbers.moved[amplitude.key];
        if (!value.some((x) => x !== 0)) continue;
        texts.push(element("li", {}, `at ${short(this.numbers.moved[onset.key])} s: ${value.map((x) => short(-x, 2)).join(", ")} ${this.joints[0].torque_unit}`));
      }
      this.list.replaceChildren(...texts);
    }

    /** Push a body at a point along a direction, both in the frame of the base. */
    push(body, point, direction) {
      const T = this.scene.THREE, { bodies } = this.scene;
      const upright = this.scene.viewer.scene.matrixWorld.clone().invert();
      const force = direction.clone().normalize().multiplyScalar(Number(this.force.value));
      const torque = new Array(this.joints.length).fill(0);
      for (let i = body; i > 0; i = bodies[i].parent) {
        const matrix = this.scene.robots[0].nodes[i].object.matrixWorld.clone().premultiply(upright);
        const origin = new T.Vector3().setFromMatrixPosition(matrix);
        const axis = bodies[i].axis.clone().transformDirection(matrix);
        const along = bodies[i].kind === "prismatic" ? axis.dot(force) : axis.dot(point.clone().sub(origin).cross(force));
        torque[bodies[i].coordinate] += bodies[i].ratio * along;
      }
      // A load opposes the motors; three digits can be read and are the same everywhere.
      const amplitude = torque.map((x) => (Math.abs(x) < 1e-6 ? 0 : Number((-x).toPrecision(3))));
      if (!amplitude.some((x) => x !== 0)) return;
      const pairs = this.push_controls();
      const free = pairs.find(([control]) => !this.numbers.moved[control.key].some((x) => x !== 0)) || pairs[(this.turn = ((this.turn || 0) + 1) % pairs.length)];
      this.numbers.moved[free[0].key] = amplitude;
      this.numbers.moved[free[1].key] = Number(this.scene.time.toFixed(3));
      this.pushes_shown();
      this.changed();
    }

    push_part(body) {
      const T = this.scene.THREE;
      const robot = this.scene.robots[0];
      robot.root.object.updateWorldMatrix(true, true);
      const geometry = this.scene.geometry(body, "coarse");
      geometry.computeBoundingBox();
      const upright = this.scene.viewer.scene.matrixWorld.clone().invert();
      const point = geometry.boundingBox.getCenter(new T.Vector3()).applyMatrix4(robot.nodes[body].object.matrixWorld).applyMatrix4(upright);
      const camera = this.scene.viewer.camera;
      camera.updateMatrixWorld();
      const direction = new T.Vector3(0, 0, -1).transformDirection(camera.matrixWorld).transformDirection(upright);
      this.push(body, point, direction);
    }

    /** A click on the arm pushes it; dragging turns the camera. */
    listen_pushes() {
      const T = this.scene.THREE;
      const canvas = this.scene.viewer.renderer.domElement;
      let from = null;
      canvas.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; });
      // The camera's controls capture the pointer: where it is let go, the canvas is not told.
      document.addEventListener("pointerup", (event) => {
        const still = from && Math.hypot(event.clientX - from[0], event.clientY - from[1]) <= 5;
        from = null;
        if (!still) return;
        const box = canvas.getBoundingClientRect();
        const at = new T.Vector2((2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height);
        const { camera } = this.scene.viewer;
        camera.updateMatrixWorld();
        const robot = this.scene.robots[0];
        robot.root.object.updateWorldMatrix(true, true);
        const ray = new T.Raycaster();
        ray.setFromCamera(at, camera);
        const [hit] = ray.intersectObjects(robot.meshes, false);
        if (!hit) return;
        const upright = this.scene.viewer.scene.matrixWorld.clone().invert();
        this.push(robot.meshes.indexOf(hit.object), hit.point.clone().applyMatrix4(upright), ray.ray.direction.clone().transformDirection(upright));
      });
    }

    // What is taken along --------------------------------------------------------------------------------------

    copies() {
      const box = by("copy");
      this.text = element("textarea", { readonly: "", spellcheck: "false", "aria-label": "the experiment as text" });
      this.kind = "command";
      const kinds = { command: "Command line", yaml: "YAML", python: "Python" };
      const buttons = Object.entries(kinds).map(([kind, label]) => element("button", { type: "button", "data-kind": kind, onclick: () => { this.kind = kind; this.written(); } }, label));
      const copy = element("button", { type: "button", onclick: async () => {
        this.text.select();
        try { await navigator.clipboard.writeText(this.text.value); } catch { document.execCommand("copy"); }
        copy.textContent = "Copied";
        setTimeout(() => { copy.textContent = "Copy"; }, 1500);
      } }, "Copy");
      const beside = [];
      if (this.play.urdf) {
        const [name, text] = this.play.urdf;
        const save = () => { const link = element("a", { href: URL.createObjectURL(new Blob([text])), download: name }); link.click(); };
        beside.push(element("button", { type: "button", onclick: save }, `Save ${name}, to lie beside it`));
      }
      box.append(element("div", { class: "row buttons" }, ...buttons, copy, ...beside), this.text);
      box.addEventListener("toggle", () => this.written());
      this.written();
    }

    written() {
      const beside = this.play.urdf ? `# needs ${this.play.urdf[0]} beside it: save it by the button above\n` : "";
      this.text.value = beside + this.numbers[this.kind]();
    }
  }

  try {
    const { meta, array } = await Armgpi.unpack();
    const page = new Page(meta, array);
    await page.begin();
    window.armgpi = { ready: true, error: null, scene: page.scene, player: page.player, page };
  } catch (error) {
    Armgpi.complain(error);
    throw error;
  }
})();
