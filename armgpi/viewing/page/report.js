// The report: plots of every joint beside the scene, with one time for both.
"use strict";

(async () => {
  const by = (id) => document.getElementById(id);
  const { element } = Armgpi;
  /** Return a name that is no longer than a width [letters], its middle left out. */
  const shortened = (name, most) => {
    const letters = Array.from(name);
    const kept = Math.max(8, most) - 1;
    if (letters.length <= kept + 1) return name;
    return `${letters.slice(0, Math.ceil(kept / 2)).join("")}…${letters.slice(letters.length - Math.floor(kept / 2)).join("")}`;
  };

  /** Curves of runs of which thinned lines are there, a cell for every quantity and joint. */
  class Plots extends Curves {
    constructor(meta, array, box) {
      const { span } = meta.plots;
      super(box, span, 1e-6 * (span[1] - span[0]), () => {});
      Object.assign(this, { meta, array });
      this.joints = new Set(meta.plots.joints.map((_, j) => j));
      this.runs = new Set(meta.plots.runs.map((_, i) => i));
    }

    content() {
      const chosen = [...this.joints].sort((a, b) => a - b);
      const drawn = (traces) => traces
        .filter(({ run }) => run < 0 || this.runs.has(run))
        .map((trace) => ({ ...trace, x: this.array(trace.x), y: this.array(trace.y) }));
      const tool = this.meta.plots.tool.map(({ name, unit, traces }, row) => {
        const lines = drawn(traces);
        return {
          heading: row ? "" : "Tool", title: `${name} [${unit}]`,
          lines: (pixels) => lines.map((line) => this.line(line, pixels)),
          says: (time) => lines.map(({ x, y }) => y[Math.max(0, Plots.after(x, time) - 1)]),
          levels: [], onset: null,
        };
      });
      return tool.concat(this.meta.plots.quantities.flatMap((quantity) => chosen.map((j, row) => {
        const lines = drawn(quantity.traces.filter(({ joint }) => joint === j));
        const unit = quantity.units[j];
        return {
          heading: row ? "" : quantity.name,
          title: unit ? `${this.meta.plots.joints[j]} [${unit}]` : this.meta.plots.joints[j],
          lines: (pixels) => lines.map((line) => this.line(line, pixels)),
          says: (time) => lines.filter(({ run }) => run >= 0).map(({ x, y }) => y[Math.max(0, Plots.after(x, time) - 1)]),
          levels: quantity.levels[j] || [], onset: quantity.onsets[j] ?? null,
        };
      })));
    }

    /** Return a line's points from the one before the stretch that is shown to the one after it. */
    line({ x, y, color, dash }, pixels) {
      const [begin, end] = this.range;
      const first = Math.max(0, Plots.after(x, begin) - 1), last = Math.min(x.length, Plots.after(x, end) + 1);
      const points = y.subarray(first, last);
      const places = Float64Array.from(x.subarray(first, last), (time) => (pixels * (time - begin)) / (end - begin));
      const good = points.filter(Number.isFinite);
      const low = good.reduce((a, b) => Math.min(a, b), Infinity), high = good.reduce((a, b) => Math.max(a, b), -Infinity);
      return { points, places, count: points.length, low, high, color, dash };
    }

    /** Return how many of ascending times are not after one. */
    static after(x, time) {
      let low = 0, high = x.length;
      while (low < high) {
        const middle = (low + high) >> 1;
        if (x[middle] <= time) low = middle + 1; else high = middle;
      }
      return low;
    }

    /** Zoom in or out around the cursor. */
    scale(factor) {
      const [begin, end] = this.span, [low, high] = this.range;
      const about = this.time >= low && this.time <= high ? this.time : (low + high) / 2;
      this.zoom([Math.max(begin, about - (about - low) * factor), Math.min(end, about + (high - about) * factor)]);
    }
  }

  /** Return a piece of a rollout's line: its colour and its dashes. */
  function sample({ color, dash }) {
    let at = 0;
    const parts = (dash.length ? dash : [1, 0]).map((length, i) => `${i % 2 ? "transparent" : color} ${at}px ${(at += length)}px`);
    return element("span", { class: "sample", style: `background:repeating-linear-gradient(90deg,${parts})` });
  }

  function choices(plots, box) {
    const group = (title, names, chosen, runs) => {
      const boxes = names.map((name, i) => {
        const input = element("input", {
          type: "checkbox", checked: true,
          onchange: () => { if (input.checked) chosen.add(i); else chosen.delete(i); plots.layout(); },
        });
        return element("label", { title: name }, input, " ", ...(runs ? [sample(runs[i]), " "] : []), shortened(name, 36));
      });
      box.append(element("fieldset", {}, element("legend", {}, title), ...boxes));
    };
    if (plots.meta.plots.runs.length > 1) {
      group("rollouts", plots.meta.plots.runs.map((r) => r.label), plots.runs, plots.meta.plots.runs);
    }
    group("joints", plots.meta.plots.joints, plots.joints, null);
  }

  function download(meta) {
    const button = by("download");
    if (!button) return;
    button.addEventListener("click", () => {
      const bytes = Uint8Array.from(atob(by("armgpi-file").textContent.trim()), (c) => c.charCodeAt(0));
      const url = URL.createObjectURL(new Blob([bytes], { type: "application/x-netcdf" }));
      const link = element("a", { href: url, download: meta.file });
      link.click();
      setTimeout(() => URL.revokeObjectURL(url), 10000);
    });
  }

  try {
    const { meta, array } = await Armgpi.unpack();
    const plots = new Plots(meta, array, by("plots"));
    choices(plots, by("choices"));
    plots.layout();
    by("zoom").append(
      element("button", { type: "button", onclick: () => plots.scale(0.5) }, "zoom in"),
      element("button", { type: "button", onclick: () => plots.scale(2) }, "zoom out"),
      element("button", { type: "button", onclick: () => plots.zoom(plots.span) }, "whole time"),
      element("small", {}, "drag to zoom, double-click for all, click to go there")
    );
    download(meta);
    window.armgpi = { ready: true, error: null, plots, scene: null, player: null };
    if (meta.arm) {
      try {
        const scene = new Armgpi.ArmScene(by("scene"), meta, array);
        const player = new Armgpi.Player(scene, by("player"), false);
        Armgpi.switches(scene, by("switches"));
        Armgpi.gauges(scene, by("gauges"));
        scene.addEventListener("time", (event) => plots.tell(event.detail));
        plots.tell(scene.time);
        plots.seek = (time) => { player.play(false); scene.show(time); };
        const still = () => { by("still").src = scene.picture(); };
        window.addEventListener("beforeprint", still);
        window.armgpi.scene = scene;
        window.armgpi.player = player;
        setTimeout(still, 500);
      } catch (error) {
        // Without 3D the plots and tables still serve.
        by("scene").append(element("p", { class: "complaint", role: "alert" }, `The animation cannot be shown: ${error.message || error}`));
        window.armgpi.error = String(error);
      }
    } else {
      by("scene").append(element("p", { class: "complaint" }, meta.no_arm));
      by("scene").parentElement.style.height = "auto";
      for (const empty of document.querySelectorAll(".stage .controls, #gauges")) empty.hidden = true;
    }
  } catch (error) {
    Armgpi.complain(error);
    throw error;
  }
})();
