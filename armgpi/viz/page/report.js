// The report: plots of every joint beside the scene, with one time for both.
"use strict";

(async () => {
  const by = (id) => document.getElementById(id);
  const { element, clamp } = Armgpi;
  // Plotly reads some HTML in names: show all of it to the letter.
  const plain = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;").replace(/%\{/g, "%&#123;");

  /** Return a name that is no longer than a width [letters], its middle left out. */
  const shortened = (name, most) => {
    const letters = Array.from(name);
    const kept = Math.max(8, most) - 1;
    if (letters.length <= kept + 1) return name;
    return `${letters.slice(0, Math.ceil(kept / 2)).join("")}…${letters.slice(letters.length - Math.floor(kept / 2)).join("")}`;
  };

  class Plots {
    constructor(meta, array, box) {
      this.meta = meta;
      this.array = array;
      this.joints = new Set(meta.plots.joints.map((_, j) => j));
      this.runs = new Set(meta.plots.runs.map((_, i) => i));
      this.range = null;
      this.time = null;
      this.seek = () => {};
      this.panes = meta.plots.quantities.map((quantity) => {
        const pane = element("div", { class: "plot" });
        const cursor = element("div", { class: "cursor" });
        box.append(element("h3", {}, quantity.name), pane);
        return { quantity, pane, cursor };
      });
    }

    /** Draw every quantity of the joints and rollouts that are chosen. */
    draw() {
      for (const one of this.panes) {
        const width = one.pane.clientWidth;
        const [traces, layout] = this.figure(one.quantity, width);
        const known = Boolean(one.pane._fullLayout);
        // Where a page is resized or printed, Plotly takes the height from here.
        one.pane.style.height = `${layout.height}px`;
        Plotly.react(one.pane, traces, layout, {
          responsive: true, displaylogo: false, scrollZoom: false,
          modeBarButtonsToRemove: ["select2d", "lasso2d"], showEditInChartStudio: false, showSendToCloud: false,
          displayModeBar: width < 600 ? false : "hover",  // it would cover the names; zoom has buttons of its own
        });
        one.drawn_for = width;
        if (!known) {
          one.pane.append(one.cursor);
          one.pane.on("plotly_relayout", (change) => this.zoomed(one, change));
          one.pane.on("plotly_click", (event) => this.seek(event.points[0].x));
          one.pane.on("plotly_afterplot", () => this.place(one));
        }
      }
    }

    figure(quantity, width) {
      const joints = this.meta.plots.joints;
      const chosen = [...this.joints].sort((a, b) => a - b);
      const traces = [];
      const gap = 34, tall = 96, top = 22, bottom = 36;
      const rows = Math.max(1, chosen.length);
      const height = top + bottom + rows * tall + (rows - 1) * gap;
      const inner = height - top - bottom;
      const layout = {
        height, margin: { l: 62, r: 12, t: top, b: bottom }, showlegend: false, hovermode: "x unified",
        font: { size: 11, color: "#1b2127", family: "system-ui, DejaVu Sans, sans-serif" },
        paper_bgcolor: "#fff", plot_bgcolor: "#fff", dragmode: "zoom", annotations: [], shapes: [],
        xaxis: { title: { text: "time [s]", standoff: 6 }, anchor: rows > 1 ? `y${rows}` : "y", gridcolor: "#e3e7eb", zeroline: false, range: this.range || this.meta.plots.span, unifiedhovertitle: { text: "%{x:.4g} s" } },
      };
      chosen.forEach((j, row) => {
        const axis = row === 0 ? "" : String(row + 1);
        const high = 1 - (row * (tall + gap)) / inner;
        const unit = quantity.units[j];
        layout[`yaxis${axis}`] = {
          domain: [clamp(high - tall / inner, 0, 1), high], title: { text: unit ? `[${plain(unit)}]` : "", standoff: 4 },
          gridcolor: "#e3e7eb", zerolinecolor: "#9aa5b1", anchor: "x", exponentformat: "e", nticks: 4, automargin: false,
        };
        layout.annotations.push({
          // Beside Plotly's buttons where they are; a letter is about 7 pixels wide.
          text: plain(shortened(joints[j], (width - (width < 600 ? 80 : 260)) / 7)), x: 0, xref: "paper", xanchor: "left", y: high, yref: "paper", yanchor: "bottom", showarrow: false, font: { size: 12 },
        });
        const yaxis = `y${axis}`;
        for (const trace of quantity.traces) {
          if (trace.joint !== j || (trace.run >= 0 && !this.runs.has(trace.run))) continue;
          const count = this.array(trace.x).length;
          traces.push({
            x: this.array(trace.x), y: this.array(trace.y), xaxis: "x", yaxis, type: "scatter", mode: count > 1 ? "lines" : "markers", name: plain(trace.name),
            line: { color: trace.color, width: 1.4, dash: trace.dash, shape: "linear" }, hovertemplate: `%{y:.4g}${unit ? " " + plain(unit) : ""}`, connectgaps: false,
          });
        }
        for (const level of quantity.levels[j] || []) {
          layout.shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, yref: yaxis, y0: level, y1: level, line: { color: "#7f7f7f", width: 1, dash: "dashdot" } });
        }
        const onset = quantity.onsets[j];
        if (onset !== null && onset !== undefined) {
          layout.shapes.push({ type: "line", xref: "x", x0: onset, x1: onset, yref: `${yaxis} domain`, y0: 0, y1: 1, line: { color: "#882255", width: 1, dash: "dot" } });
        }
      });
      return [traces, layout];
    }

    /** Show the same stretch of time in every plot. */
    zoomed(source, change) {
      let range = null;
      if ("xaxis.range[0]" in change) range = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
      else if (Array.isArray(change["xaxis.range"])) range = change["xaxis.range"];
      else if (!change["xaxis.autorange"]) return;
      if (range && this.range && range[0] === this.range[0] && range[1] === this.range[1]) return;
      if (!range && !this.range) return;
      this.zoom(range, source);
    }

    zoom(range, source = null) {
      this.range = range;
      for (const one of this.panes) {
        if (one !== source || !range) Plotly.relayout(one.pane, { "xaxis.range": range || this.meta.plots.span });
      }
    }

    /** Zoom in or out around the cursor. */
    scale(factor) {
      const [begin, end] = this.meta.plots.span;
      const [low, high] = this.range || this.meta.plots.span;
      const about = this.time !== null && this.time >= low && this.time <= high ? this.time : (low + high) / 2;
      const range = [Math.max(begin, about - (about - low) * factor), Math.min(end, about + (high - about) * factor)];
      this.zoom(range[0] <= begin && range[1] >= end ? null : range);
    }

    /** Put the cursors to a time. */
    tell(time) {
      this.time = time;
      this.panes.forEach((one) => this.place(one));
    }

    place({ pane, cursor }) {
      const layout = pane._fullLayout;
      if (!layout || this.time === null) return;
      const axis = layout.xaxis;
      const x = axis.l2p(this.time);
      cursor.style.display = x >= 0 && x <= axis._length ? "block" : "none";
      cursor.style.left = `${axis._offset + x}px`;
      cursor.style.top = `${layout.margin.t}px`;
      cursor.style.bottom = `${layout.margin.b}px`;
    }
  }

  function choices(plots, box) {
    const group = (title, names, chosen, color) => {
      const boxes = names.map((name, i) => {
        const input = element("input", {
          type: "checkbox", checked: true,
          onchange: () => { if (input.checked) chosen.add(i); else chosen.delete(i); plots.draw(); },
        });
        const dot = color ? [element("span", { class: "dot", style: `background:${color[i]}` }), " "] : [];
        return element("label", { title: name }, input, " ", ...dot, shortened(name, 36));
      });
      box.append(element("fieldset", {}, element("legend", {}, title), ...boxes));
    };
    if (plots.meta.plots.runs.length > 1) {
      group("rollouts", plots.meta.plots.runs.map((r) => r.label), plots.runs, plots.meta.plots.runs.map((r) => r.color));
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
    plots.draw();
    window.addEventListener("resize", () => {
      if (plots.panes.some((one) => Math.abs(one.drawn_for - one.pane.clientWidth) > 60)) plots.draw();
    });
    by("zoom").append(
      element("button", { type: "button", onclick: () => plots.scale(0.5) }, "zoom in"),
      element("button", { type: "button", onclick: () => plots.scale(2) }, "zoom out"),
      element("button", { type: "button", onclick: () => plots.zoom(null) }, "whole time"),
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
