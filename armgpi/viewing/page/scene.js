// The scene of an arm in MeshCat's viewer: moved by joint positions, played, stepped and looked at.
//
// Needs MeshCat (its viewer), and the page's data: see armgpi/viewing/page.py for what it holds. Names from files
// come in as text and go out as text: never as HTML.
"use strict";

const Armgpi = (() => {
  const TYPES = { f32: Float32Array, f64: Float64Array, i8: Int8Array, u8: Uint8Array, u16: Uint16Array, u32: Uint32Array };

  /** Return the page's data with its arrays. */
  async function unpack() {
    const meta = JSON.parse(document.getElementById("armgpi-data").textContent);
    const text = document.getElementById("armgpi-arrays").textContent.trim();
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    if (typeof DecompressionStream === "undefined") {
      throw new Error("this browser is too old to unpack the page's data (it lacks DecompressionStream)");
    }
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const whole = await new Response(stream).arrayBuffer();
    const array = (ref) => new TYPES[ref.type](whole, ref.offset, ref.length);
    return { meta, array };
  }

  /** Return an element with attributes and children; text stays text. */
  function element(tag, attributes = {}, ...children) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
      else if (name === "checked" || name === "value" || name === "disabled") made[name] = value;
      else made.setAttribute(name, value);
    }
    made.append(...children);
    return made;
  }

  const clamp = (x, low, high) => Math.min(high, Math.max(low, x));

  /** Return a number with a few digits, as wide as the last one: readings that change must not jump. */
  function short(x, digits = 3) {
    if (!Number.isFinite(x)) return "–";
    const size = Math.abs(x);
    if (size < 1e-9) return "0";
    return size >= 1e4 || size < 1e-3 ? x.toExponential(1) : x.toPrecision(digits);
  }

  class ArmScene extends EventTarget {
    /** Draw the scene into `pane`, an element with a size; see `data` in armgpi/viewing/page.py. */
    constructor(pane, meta, array) {
      super();
      this.meta = meta;
      this.array = array;
      this.time = 0;
      this.exaggeration = 1;
      this.apart = false;
      this.ghosts_wanted = true;
      this.covered = 0;
      this.THREE = MeshCat.THREE;
      this.viewer = new MeshCat.Viewer(pane);
      this.viewer.set_3d_pane_size = () => this.resize(pane);
      this.keep_pace(pane);
      this.bodies = meta.arm.bodies.map((body) => this.prepared(body));
      this.clip = meta.clip ? this.unpacked(meta.clip) : null;
      this.configuration = Float32Array.from(meta.arm.configuration);
      this.size = meta.arm.size;
      this.dress();
      this.robots = [];
      this.ghosts = [];
      const actors = this.clip ? this.clip.actors : [{ color: null }];
      actors.forEach((actor, i) => {
        const color = actors.length > 1 && !actor.plain ? actor.color : null;
        this.robots.push(this.arm(["armgpi", `robot${i}`], color, actor.opacity || 1, i));
        if (this.clip) this.ghosts.push(this.arm(["armgpi", `ghost${i}`], "#667788", 0.25, 0));
      });
      if (this.clip) {
        this.draw_paths();
        this.draw_contacts();
      }
      this.turned = false;
      this.viewer.controls.addEventListener("start", () => { this.turned = true; });
      this.viewer.camera.aspect = Math.max(1, pane.clientWidth) / Math.max(1, pane.clientHeight);
      if (this.robots.length > 1) this.set_apart(true);
      this.look_from("iso");
      if (this.clip) this.show(this.clip.times[0]);
      this.resize(pane);
      new ResizeObserver(() => this.resize(pane)).observe(pane);
    }

    /** Return a body of the arm with what its joint does ready to be computed. */
    prepared(body) {
      const T = this.THREE;
      const matrix = new T.Matrix4().fromArray(body.placement);
      const position = new T.Vector3(), rotation = new T.Quaternion(), scale = new T.Vector3();
      matrix.decompose(position, rotation, scale);
      return { ...body, position, rotation, axis: new T.Vector3(...body.axis) };
    }

    unpacked(clip) {
      const values = (given) => (ArrayBuffer.isView(given) ? given : this.array(given));
      const actors = clip.actors.map((actor) => {
        const arrays = {};
        for (const name of ["q", "q_ref", "tau", "saturated"]) arrays[name] = values(actor[name]);
        if (actor.contacts) for (const name of ["forces", "points"]) arrays[name] = values(actor[name]);
        return { ...actor, ...arrays };
      });
      return { ...clip, times: values(clip.times), disturbance: values(clip.disturbance), actors };
    }

    /** Show another rollout in the place of one, over the same times. */
    replace(i, { q, q_ref, tau, saturated, end, t_end, contacts = 0, forces, points }, disturbance) {
      Object.assign(this.clip.actors[i], { q, q_ref, tau, saturated, end, t_end, contacts, forces, points });
      this.clip.disturbance = disturbance;
      this.scale_arrows();
      this.draw_path(i);
      this.set_apart(this.apart);
      this.show(this.time);
    }

    /** Show one of the rollouts, or do not. */
    show_actor(i, shown) {
      this.clip.actors[i].hidden = !shown;
      this.scale_arrows();
      const robot = this.robots[i];
      for (const thing of [robot.root.object, robot.desired, robot.drawn, robot.bead]) thing.visible = shown;
      this.show(this.time);
    }

    /** Set light, ground, background and axes by the arm's size. */
    dress() {
      const T = this.THREE;
      const viewer = this.viewer;
      viewer.set_property(["Background"], "top_color", [1, 1, 1]);
      viewer.set_property(["Background"], "bottom_color", [0.86, 0.89, 0.93]);
      const scaled = (factor) => new T.Matrix4().makeScale(factor, factor, factor).toArray();
      // Squares of 1, 2 or 5 times a power of ten, about eight of them along the arm.
      const wanted = this.size / 8;
      const power = Math.pow(10, Math.floor(Math.log10(wanted)));
      const square = power * [1, 2, 5, 10].find((factor) => factor * power >= wanted);
      const count = 2 * Math.ceil((1.6 * this.size) / square);
      const grid = new T.GridHelper(count * square, count, 0x8fa0b0, 0xc8d0d8);
      grid.rotateX(Math.PI / 2);
      viewer.set_object(["Grid"], grid);
      viewer.set_transform(["Axes"], scaled(0.4 * this.size));
      viewer.set_transform(["Lights"], scaled(1.5 * this.size));
      viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.5);
      for (const light of ["PointLightNegativeX", "PointLightPositiveX"]) {
        viewer.set_property(["Lights", light, "<object>"], "distance", 20 * this.size);
        viewer.set_property(["Lights", light, "<object>"], "intensity", 0.3);
      }
      viewer.gui.width = 230;
    }

    /** While things move and the machine is too slow for it, draw the arm coarsely: 30 frames a second. */
    keep_pace(pane) {
      this.render = this.viewer.render.bind(this.viewer);
      let last = -1e9, pace = 16, timer = null;
      this.slow = false;
      this.coarse = false;
      this.frames_drawn = 0;
      this.viewer.render = () => {
        const now = performance.now();
        const gap = now - last;
        last = now;
        const moving = gap < 600;
        if (moving) {
          pace += 0.3 * (gap - pace);
          if (pace > 30) this.slow = true;
        }
        if (this.slow && moving && !this.coarse) this.set_coarse(true, pane);
        if (this.coarse) {
          clearTimeout(timer);
          timer = setTimeout(() => { last = -1e9; this.set_coarse(false, pane); }, 700);
        }
        this.frames_drawn++;
        this.render();
      };
    }

    /** Return the scene as a picture, drawn finely on any machine. */
    picture() {
      if (this.coarse) this.set_coarse(false, this.viewer.dom_element);
      const paced = this.viewer.render;
      this.viewer.render = this.render;
      const uri = this.viewer.capture_image();
      this.viewer.render = paced;
      return uri;
    }

    set_coarse(coarse, pane) {
      this.coarse = coarse;
      for (const robot of this.robots || []) {
        robot.meshes.forEach((mesh, i) => (mesh.geometry = this.geometry(i, coarse ? "coarse" : "fine")));
      }
      this.resize(pane);
    }

    /** Put an arm into the scene and return the nodes of its bodies. */
    arm(path, color, opacity, layer) {
      const T = this.THREE;
      const paths = [], meshes = [];
      const nodes = this.bodies.map((body, i) => {
        const own = i === 0 ? [...path, "base"] : [...paths[body.parent], `joint${i}`];
        paths.push(own);
        const material = new T.MeshLambertMaterial({
          side: opacity < 1 ? T.FrontSide : T.DoubleSide, transparent: opacity < 1, opacity, depthWrite: opacity === 1,
          vertexColors: color === null, color: color === null ? 0xffffff : color,
          // Of arms in one place the first one is seen, not a mixture of all.
          polygonOffset: layer > 0, polygonOffsetFactor: layer, polygonOffsetUnits: layer,
        });
        const mesh = new T.Mesh(this.geometry(i, opacity < 1 ? "coarse" : "fine"), material);
        meshes.push(mesh);
        this.viewer.set_object(own, mesh);
        return this.viewer.scene_tree.find(own);
      });
      const root = this.viewer.scene_tree.find(path);
      const rings = opacity === 1 && this.clip ? this.rings(paths) : [];
      return { root, nodes, paths, meshes, rings };
    }

    /** Return the shape of a body, "fine" or "coarse"; made once. */
    geometry(i, detail) {
      this.geometries = this.geometries || {};
      const key = `${i} ${detail}`;
      if (!this.geometries[key]) {
        const T = this.THREE;
        const data = this.bodies[i][detail];
        const geometry = new T.BufferGeometry();
        geometry.setAttribute("position", new T.BufferAttribute(this.array(data.points), 3));
        geometry.setAttribute("normal", new T.BufferAttribute(this.array(data.normals), 3, true));
        geometry.setAttribute("color", new T.BufferAttribute(this.array(data.colors), 3, true));
        geometry.setIndex(new T.BufferAttribute(this.array(data.faces), 1));
        this.geometries[key] = geometry;
      }
      return this.geometries[key];
    }

    /** Put a ring around every joint that shows how much of its torque it uses. */
    rings(paths) {
      const T = this.THREE;
      return this.bodies.map((body, i) => {
        if (i === 0) return null;
        const ring = new T.Mesh(
          new T.TorusGeometry(body.ring, 0.006 * this.size, 6, 32), new T.MeshBasicMaterial({ color: 0x999999 })
        );
        ring.quaternion.setFromUnitVectors(new T.Vector3(0, 0, 1), body.axis);
        this.viewer.set_object([...paths[i], "torque"], ring);
        return ring;
      });
    }

    // Positions of the joints and of what hangs on them ----------------------------------------------------

    /** Put the pose of a body in its parent, at joint positions, into `position` and `rotation`. */
    local(body, configuration, position, rotation) {
      const q = body.kind === "" ? 0 : body.ratio * configuration[body.coordinate] + body.offset;
      position.copy(body.position);
      rotation.copy(body.rotation);
      if (body.kind === "prismatic") {
        position.add(body.axis.clone().multiplyScalar(q).applyQuaternion(body.rotation));
      } else if (body.kind !== "") {
        rotation.multiply(new this.THREE.Quaternion().setFromAxisAngle(body.axis, q));
      }
    }

    /** Move an arm to joint positions. */
    pose(robot, q) {
      robot.nodes.forEach((node, i) => {
        this.local(this.bodies[i], q, node.object.position, node.object.quaternion);
        node.object.updateMatrix();
      });
      this.viewer.set_dirty();
    }

    /** Return where the tool is, as a Vector3, at joint positions. */
    tip(q) {
      const T = this.THREE;
      const tip = this.meta.arm.tip;
      const point = new T.Vector3().setFromMatrixPosition(new T.Matrix4().fromArray(tip.placement));
      const position = new T.Vector3(), rotation = new T.Quaternion();
      for (let i = tip.body; i >= 0; i = this.bodies[i].parent) {
        this.local(this.bodies[i], q, position, rotation);
        point.applyQuaternion(rotation).add(position);
      }
      return point;
    }

    /** Return the frame at or before a time, and how far it is to the next one, 0 to 1. */
    place(time) {
      const times = this.clip.times;
      let low = 0, high = times.length - 1;
      while (high - low > 1) {
        const middle = (low + high) >> 1;
        if (times[middle] <= time) low = middle; else high = middle;
      }
      const span = times[high] - times[low];
      return { frame: low, part: span > 0 ? clamp((time - times[low]) / span, 0, 1) : 0, next: high };
    }

    /** Return positions of an actor at a time: straight between two frames; its error made larger. */
    positions(actor, name, place, exaggeration = 1) {
      const n = this.meta.arm.joints.length;
      const q = new Float32Array(n);
      for (let j = 0; j < n; j++) {
        const between = (values) =>
          values[place.frame * n + j] * (1 - place.part) + values[place.next * n + j] * place.part;
        const reference = between(actor.q_ref);
        q[j] = name === "q_ref" ? reference : reference + exaggeration * (between(actor.q) - reference);
      }
      return q;
    }

    // Paths of the tool --------------------------------------------------------------------------------------

    /** Draw the tool's paths for the exaggeration that is set. */
    draw_paths() {
      this.clip.actors.forEach((_, i) => this.draw_path(i));
    }

    /** Draw the tool's path in one rollout. */
    draw_path(i) {
      const T = this.THREE;
      const thickness = 0.0035 * this.size;
      const actor = this.clip.actors[i];
      const robot = this.robots[i];
      const add = (what, geometry, color) => {
        const object = new T.Mesh(geometry, new T.MeshBasicMaterial({ color, side: T.DoubleSide }));
        object.visible = !actor.hidden;
        this.viewer.set_object(["armgpi", "paths", `${what}${i}`], object);
        return object;
      };
      const desired = this.path(actor, "q_ref", 1, thickness);
      const drawn = this.path(actor, "q", this.exaggeration, thickness);
      robot.drawn_frames = drawn.frames;
      robot.desired = add("desired", this.tube(desired.points, 0.6 * thickness), 0x777777);
      robot.drawn = add("drawn", this.tube(drawn.points, thickness), actor.color);
      robot.bead = add("bead", new T.SphereGeometry(3 * thickness, 12, 8), actor.color);
    }

    /** Return the points of the tool's path that are apart, and the frames that they are of. */
    path(actor, name, exaggeration, apart) {
      const count = this.clip.times.length;
      const every = Math.max(1, Math.ceil(count / 800));
      const points = [], frames = [];
      for (let f = 0; f < count; f += every) {
        const point = this.tip(this.positions(actor, name, { frame: f, next: f, part: 0 }, exaggeration));
        if (points.length && point.distanceTo(points[points.length - 1]) < apart) continue;
        points.push(point);
        frames.push(f);
      }
      return { points, frames };
    }

    /** Return a tube of four sides through points; its triangles are in the order of the points. */
    tube(points, radius) {
      const T = this.THREE;
      const corners = new Float32Array(points.length * 12);
      const faces = new Uint32Array(Math.max(0, points.length - 1) * 24);
      let along = new T.Vector3(0, 0, 1);
      points.forEach((point, i) => {
        const step = points[Math.min(i + 1, points.length - 1)].clone().sub(points[Math.max(i - 1, 0)]);
        if (step.length() > 1e-3 * radius) along = step.normalize();
        const aside = new T.Vector3(0, 0, 1).cross(along);
        if (aside.length() < 0.1) aside.set(1, 0, 0).cross(along);
        aside.normalize();
        const up = along.clone().cross(aside);
        [aside, up, aside.clone().negate(), up.clone().negate()].forEach((offset, k) => {
          point.clone().addScaledVector(offset, radius).toArray(corners, i * 12 + k * 3);
        });
      });
      for (let i = 0; i + 1 < points.length; i++) {
        for (let k = 0; k < 4; k++) {
          const a = 4 * i + k, b = 4 * i + ((k + 1) % 4);
          faces.set([a, b, a + 4, b, b + 4, a + 4], i * 24 + k * 6);
        }
      }
      const geometry = new T.BufferGeometry();
      geometry.setAttribute("position", new T.BufferAttribute(corners, 3));
      geometry.setIndex(new T.BufferAttribute(faces, 1));
      geometry.computeBoundingSphere();
      return geometry;
    }

    // What the user asks for ------------------------------------------------------------------------------

    /** Show a time of the clip, or the configuration when there is none. */
    show(time) {
      if (!this.clip) {
        this.pose(this.robots[0], this.configuration);
        return;
      }
      const times = this.clip.times;
      this.time = clamp(time, times[0], times[times.length - 1]);
      const place = this.place(this.time);
      this.clip.actors.forEach((actor, i) => {
        const robot = this.robots[i];
        const q = this.positions(actor, "q", place, this.exaggeration);
        this.pose(robot, q);
        const reference = this.positions(actor, "q_ref", place);
        this.pose(this.ghosts[i], reference);
        // Where the arm is where it should be, a ghost would be inside it: not worth its time.
        const apart = q.some((value, j) => Math.abs(value - reference[j]) > 1e-3);
        this.ghosts[i].root.object.visible = this.ghosts_wanted && apart && !actor.hidden;
        const shown = robot.drawn_frames.filter((f) => f <= place.frame).length;
        robot.drawn.geometry.setDrawRange(0, 24 * Math.max(0, shown - 1));
        robot.bead.position.copy(this.tip(q));
        this.place_arrows(i, place.frame);
        robot.rings.forEach((ring, b) => ring && this.paint_ring(ring, actor, place.frame, this.bodies[b].coordinate));
      });
      this.dispatchEvent(new CustomEvent("time", { detail: this.time }));
    }

    /** Note the largest force of the rollouts that are shown, which the length of arrows is relative to. */
    scale_arrows() {
      const largest = ({ contacts, forces, hidden }) => (contacts && !hidden ? forces.reduce((most, x) => Math.max(most, Math.abs(x)), 0) : 0);
      this.largest_force = Math.max(1e-9, ...this.clip.actors.map(largest));
    }

    /** Make an arrow for every contact, and draw the walls. */
    draw_contacts() {
      const T = this.THREE;
      this.scale_arrows();
      this.arrows = this.clip.actors.map((actor, i) => Array.from({ length: actor.contacts || 0 }, () => {
        const arrow = new T.ArrowHelper(new T.Vector3(0, 0, 1), new T.Vector3(), 1, 0xcc3311);
        this.robots[i].root.object.add(arrow);
        return arrow;
      }));
      const { points } = this.clip.actors[0];
      for (const { normal, distance, contact } of this.clip.walls || []) {
        const plane = new T.PlaneGeometry(this.size, this.size);
        const look = new T.MeshBasicMaterial({ color: 0x888888, transparent: true, opacity: 0.3, side: T.DoubleSide });
        const wall = new T.Mesh(plane, look), up = new T.Vector3(...normal);
        const point = new T.Vector3(...points.slice(3 * contact, 3 * contact + 3));
        wall.position.copy(point).addScaledVector(up, distance - point.dot(up));
        wall.quaternion.setFromUnitVectors(new T.Vector3(0, 0, 1), up);
        this.robots[0].root.object.add(wall);
      }
    }

    /** Return where the longest arrow of each contact of an arm ends. */
    longest_arrows(i) {
      const T = this.THREE, { contacts = 0, forces, points } = this.clip.actors[i];
      const vector = (values, at) => new T.Vector3(...values.slice(at, at + 3));
      const ends = [];
      for (let c = 0; c < contacts; c++) {
        let longest = new T.Vector3(), where = 0;
        for (let at = 3 * c; at < forces.length; at += 3 * contacts) {
          const force = vector(forces, at);
          if (force.length() > longest.length()) [longest, where] = [force, at];
        }
        const share = longest.length() / this.largest_force;
        if (share > 1e-3) ends.push(vector(points, where).addScaledVector(longest.normalize(), 0.5 * this.size * share));
      }
      return ends;
    }

    /** Put the arrows of an arm's contacts where they act, as long as their forces; half the arm for the largest. */
    place_arrows(i, frame) {
      const T = this.THREE, { contacts, forces, points } = this.clip.actors[i];
      ((this.arrows || [])[i] || []).forEach((arrow, c) => {
        const at = 3 * (frame * contacts + c);
        const force = contacts ? new T.Vector3(...forces.slice(at, at + 3)) : new T.Vector3();
        const share = force.length() / this.largest_force;
        arrow.visible = share > 1e-3;
        if (!arrow.visible) return;
        arrow.position.set(points[at], points[at + 1], points[at + 2]);
        arrow.setDirection(force.normalize());
        arrow.setLength(0.5 * this.size * share, 0.04 * this.size, 0.025 * this.size);
      });
    }

    /** Colour a joint's ring: grey without torque, through orange, to red and thick at the limit. */
    paint_ring(ring, actor, frame, j) {
      const n = this.meta.arm.joints.length;
      const effort = this.meta.arm.joints[j].effort;
      const used = effort > 0 ? clamp(Math.abs(actor.tau[frame * n + j]) / effort, 0, 1) : 0;
      const saturated = actor.saturated[frame * n + j] > 0;
      const pushed = this.clip.disturbance[frame * n + j] !== 0;
      ring.material.color.setHSL(0.09 * (1 - used), saturated ? 1 : used, saturated ? 0.42 : 0.62 - 0.12 * used);
      if (pushed && !saturated) ring.material.color.lerp(new this.THREE.Color(0x882255), 0.6);
      ring.scale.setScalar(saturated ? 1.25 : 1);
    }

    /** Make errors larger by a factor, in the arm and in its path. */
    exaggerate(factor) {
      this.exaggeration = factor;
      this.draw_paths();
      this.set_apart(this.apart);
      this.show(this.time);
    }

    /** Show or hide "ghosts", "paths", "rings" or "robots". */
    toggle(what, visible) {
      if (what === "ghosts") {
        this.ghosts_wanted = visible;
        this.show(this.time);
      }
      if (what === "robots") this.robots.forEach((robot) => (robot.root.object.visible = visible));
      if (what === "paths") this.viewer.scene_tree.find(["armgpi", "paths"]).object.visible = visible;
      if (what === "rings") {
        this.robots.forEach((robot) => robot.rings.forEach((ring) => ring && (ring.visible = visible)));
      }
      this.viewer.set_dirty();
    }

    /** Put the arms of a comparison beside each other, or into one place. */
    set_apart(apart) {
      this.apart = apart;
      const gap = 1.2 * this.size;
      this.robots.forEach((robot, i) => {
        const y = apart ? gap * (i - (this.robots.length - 1) / 2) : 0;
        for (const thing of [robot.root.object, this.ghosts[i].root.object, robot.desired, robot.drawn]) {
          thing.position.y = y;
        }
        // The bead's own position is the tool's: shift what holds it.
        robot.bead.parent.position.y = y;
        for (const object of [robot.root.object, this.ghosts[i].root.object, robot.bead.parent]) object.updateMatrix();
        robot.desired.updateMatrix();
        robot.drawn.updateMatrix();
      });
      this.viewer.set_dirty();
    }

    /** Return configurations from all of the clip: where the arm is, and where it should be. */
    random_configurations(actor) {
      const last = this.clip.times.length - 1;
      const found = [];
      for (let k = 0; k <= 24; k++) {
        const frame = Math.round((k * last) / 24);
        for (const name of ["q", "q_ref"]) found.push(this.positions(actor, name, { frame, next: frame, part: 0 }));
      }
      // A joint that slides out of its range and away has left the picture.
      const slides = this.bodies.filter((body) => body.kind === "prismatic").map((body) => body.coordinate);
      const { joints } = this.meta.arm;
      const near = (q) => slides.every((j) => q[j] > joints[j].lower - this.size && q[j] < joints[j].upper + this.size);
      return found.filter((q, i) => i === 0 || near(q));
    }

    /** Look at the arm from "iso", "front", "side" or "top", so that all that it does and its tool's path are in sight. */
    look_from(where) {
      const T = this.THREE;
      this.where = where;
      const points = [];
      const surround = (one) => {
        for (let corner = 0; corner < 8; corner++) {
          points.push(new T.Vector3(
            corner & 1 ? one.max.x : one.min.x, corner & 2 ? one.max.y : one.min.y, corner & 4 ? one.max.z : one.min.z
          ));
        }
      };
      const surround_arm = (robot, q) => {
        this.pose(robot, q);
        robot.root.object.updateWorldMatrix(true, true);
        // MeshCat turns the scene as a whole, from z up to y up.
        const upright = this.viewer.scene.matrixWorld.clone().invert();
        robot.nodes.forEach((node, i) => {
          const geometry = this.geometry(i, "coarse");
          if (!geometry.boundingBox) geometry.computeBoundingBox();
          surround(geometry.boundingBox.clone().applyMatrix4(node.object.matrixWorld.clone().premultiply(upright)));
        });
      };
      this.robots.forEach((robot, r) => {
        for (const q of this.clip ? this.random_configurations(this.clip.actors[r]) : [this.configuration]) surround_arm(robot, q);
        if (this.clip) {
          for (const what of [robot.desired, robot.drawn]) {
            what.geometry.computeBoundingBox();
            surround(what.geometry.boundingBox.clone().translate(what.position));
          }
          points.push(...this.longest_arrows(r).map((end) => end.add(robot.root.object.position)));
        }
      });
      const box = new T.Box3().setFromPoints(points);
      const centre = box.getCenter(new T.Vector3());
      const views = { iso: [1, -0.75, 0.45], front: [1, 0, 0.02], side: [0, -1, 0.02], top: [0.02, 0, 1] };
      const back = new T.Vector3(...views[where]).normalize();
      const right = new T.Vector3(0, 0, 1).cross(back).normalize();
      const up = back.clone().cross(right);
      const camera = this.viewer.camera;
      camera.fov = 35;
      const tall = Math.tan((0.5 * camera.fov * Math.PI) / 180);
      const wide = tall * camera.aspect;
      let distance = 0.1 * this.size;
      for (const point of points) {
        const at = point.sub(centre);
        const need = Math.max(Math.abs(at.dot(right)) / wide, Math.abs(at.dot(up)) / tall);
        distance = Math.max(distance, at.dot(back) + 1.12 * need);
      }
      camera.near = 0.01 * distance;
      camera.far = 100 * distance;
      // MeshCat's camera has its y axis up: its node is turned by a quarter about x.
      const turned = (v) => new T.Vector3(v.x, v.z, -v.y);
      camera.position.copy(turned(centre.clone().addScaledVector(back, distance)));
      this.viewer.controls.target.copy(turned(centre));
      this.viewer.controls.update();
      camera.updateProjectionMatrix();
      if (this.clip) this.show(this.time);
      this.viewer.set_dirty();
    }

    /** Keep the arm out of so many pixels at the picture's left, if that leaves half of it. */
    leave_room(covered, pane) {
      this.covered = covered;
      this.resize(pane);
    }

    /** Fit the picture to its pane. */
    resize(pane) {
      const width = Math.max(1, pane.clientWidth), height = Math.max(1, pane.clientHeight);
      const left = this.covered <= 0.5 * width ? this.covered : 0;
      const camera = this.viewer.camera;
      // What the camera is aimed at fills the picture's part that is free.
      camera.setViewOffset(width - left, height, -left, 0, width, height);
      const aspect = camera.aspect;
      this.viewer.renderer.setPixelRatio((this.coarse ? 0.5 : 1) * window.devicePixelRatio);
      this.viewer.renderer.setSize(width, height);
      // Until the user has turned the camera, the arm stays in sight.
      const reshaped = this.fitted && Math.abs(this.fitted - aspect) > 0.02;
      if (reshaped && !this.turned) this.look_from(this.where);
      this.fitted = aspect;
      this.viewer.set_dirty();
    }
  }

  // The controls below the scene ------------------------------------------------------------------------------

  const SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10];

  class Player {
    /** Put buttons for playing `scene` into `box`. */
    constructor(scene, box, autoplay) {
      this.scene = scene;
      this.speed = 1;
      this.playing = false;
      const times = scene.clip.times;
      const [begin, end] = [times[0], times[times.length - 1]];
      this.begin = begin;
      this.end = end;
      this.button = element("button", { type: "button", onclick: () => this.play(!this.playing), title: "Space" }, "▶ Play");
      this.slider = element("input", {
        type: "range", min: begin, max: end, step: "any", value: begin, "aria-label": "time [s]", class: "time",
        oninput: () => { this.play(false); scene.show(Number(this.slider.value)); },
      });
      this.clock = element("output", { class: "clock" });
      const step = (count, label, key) =>
        element("button", { type: "button", title: key, "aria-label": label, onclick: () => this.step(count) }, count < 0 ? "◀|" : "|▶");
      const speeds = element(
        "select",
        { "aria-label": "speed", onchange: (event) => { this.speed = Number(event.target.value); } },
        ...SPEEDS.map((s) => element("option", { value: String(s), ...(s === 1 ? { selected: "" } : {}) }, `${s} ×`))
      );
      this.speeds = speeds;
      const ticks = element("div", { class: "onsets", "aria-hidden": "true" });
      // The onsets' marks stand below the slider, where its thumb would be then.
      for (const [joint, onset] of Object.entries(scene.clip.onsets)) {
        const at = end > begin ? (100 * (onset - begin)) / (end - begin) : 0;
        ticks.append(element("span", { style: `left:${at}%`, title: `disturbance of ${joint} sets in at ${short(onset)} s` }));
      }
      box.append(
        element("div", { class: "row" }, this.button, step(-1, "one frame back", "←"), step(1, "one frame on", "→"), speeds, this.clock),
        element("div", { class: "timeline" }, this.slider, ticks)
      );
      scene.addEventListener("time", (event) => this.told(event.detail));
      this.told(scene.time);
      document.addEventListener("keydown", (event) => this.key(event));
      if (autoplay && !window.matchMedia("(prefers-reduced-motion: reduce)").matches) this.play(true);
    }

    told(time) {
      this.slider.value = String(time);
      this.clock.textContent = `${time.toFixed(3)} s of ${short(this.end, 4)} s`;
    }

    play(on) {
      if (on === this.playing) return;
      this.playing = on;
      this.button.textContent = on ? "❚❚ Pause" : "▶ Play";
      if (!on) return;
      if (this.scene.time >= this.end) this.scene.show(this.begin);
      let last = null;
      const tick = (now) => {
        if (!this.playing) return;
        if (last !== null) {
          const time = this.scene.time + (this.speed * (now - last)) / 1000;
          this.scene.show(time);
          if (time >= this.end) this.play(false);
        }
        last = now;
        if (this.playing) requestAnimationFrame(tick);
      };
      requestAnimationFrame(tick);
    }

    /** Go to the next frame, or the one before. */
    step(count) {
      this.play(false);
      const { frame, part, next } = this.scene.place(this.scene.time);
      const here = part > 0.999 ? next : frame;
      const last = this.scene.clip.times.length - 1;
      const wanted = count < 0 && part > 0.001 && part < 0.999 ? frame : here + count;
      this.scene.show(this.scene.clip.times[clamp(wanted, 0, last)]);
    }

    key(event) {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      if (["INPUT", "SELECT", "TEXTAREA", "BUTTON", "SUMMARY", "A"].includes(event.target.tagName)) return;
      const faster = (by) => {
        this.speeds.selectedIndex = clamp(this.speeds.selectedIndex + by, 0, SPEEDS.length - 1);
        this.speed = SPEEDS[this.speeds.selectedIndex];
      };
      const actions = {
        " ": () => this.play(!this.playing), ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1),
        Home: () => this.scene.show(this.begin), End: () => this.scene.show(this.end),
        "+": () => faster(1), "-": () => faster(-1),
      };
      if (actions[event.key] && !document.activeElement.closest(".plots")) {
        event.preventDefault();
        actions[event.key]();
      }
    }
  }

  /** Put switches for what is shown into `box`. */
  function switches(scene, box) {
    const check = (label, checked, act) =>
      element("label", {}, element("input", { type: "checkbox", checked, onchange: (e) => act(e.target.checked) }), ` ${label}`);
    const row = element("div", { class: "row" });
    if (scene.clip) {
      const factor = element(
        "select",
        { "aria-label": "error shown", onchange: (e) => scene.exaggerate(Number(e.target.value)) },
        ...[1, 3, 10, 30, 100].map((f) => element("option", { value: String(f) }, f === 1 ? "error as it is" : `error ${f} ×`))
      );
      row.append(
        factor,
        check("reference (ghost)", true, (on) => scene.toggle("ghosts", on)),
        check("tool path", true, (on) => scene.toggle("paths", on)),
        check("joint torques", true, (on) => scene.toggle("rings", on))
      );
      if (scene.robots.length > 1) row.append(check("side by side", scene.apart, (on) => { scene.set_apart(on); scene.look_from(scene.where); }));
    }
    for (const view of ["iso", "front", "side", "top"]) {
      row.append(element("button", { type: "button", onclick: () => scene.look_from(view) }, view));
    }
    box.append(row);
  }

  /** Put a table of the joints into `box`: torque as a bar, saturated, external torque. */
  function gauges(scene, box) {
    const n = scene.meta.arm.joints.length;
    const head = element("tr", {}, element("th", { scope: "col" }, "joint"));
    scene.clip.actors.forEach((actor) => {
      const dot = element("span", { class: "dot", style: `background:${actor.color}` });
      head.append(element("th", { scope: "col" }, dot, ` ${actor.label}`, element("br"), element("small", {}, actor.end)));
    });
    const body = element("tbody");
    const cells = [];
    for (let j = 0; j < n; j++) {
      const joint = scene.meta.arm.joints[j];
      const row = element("tr", {}, element("th", { scope: "row", title: joint.name }, joint.name));
      cells.push(
        scene.clip.actors.map(() => {
          const bar = element("i"), text = element("span"), flag = element("b");
          row.append(element("td", {}, element("div", { class: "bar" }, bar), text, flag));
          return { bar, text, flag };
        })
      );
      body.append(row);
    }
    const many = scene.clip.actors.length > 2 ? " many" : "";
    box.append(element("table", { class: `gauges${many}` }, element("thead", {}, head), body));
    const update = () => {
      const { frame } = scene.place(scene.time);
      scene.clip.actors.forEach((actor, i) => {
        for (let j = 0; j < n; j++) {
          const { effort, torque_unit: unit } = scene.meta.arm.joints[j];
          const tau = actor.tau[frame * n + j];
          const used = effort > 0 ? clamp(tau / effort, -1, 1) : 0;
          const cell = cells[j][i];
          cell.bar.style.left = `${50 + 50 * Math.min(0, used)}%`;
          cell.bar.style.width = `${50 * Math.abs(used)}%`;
          const saturated = actor.saturated[frame * n + j] > 0;
          const pushed = scene.clip.disturbance[frame * n + j];
          cell.bar.className = saturated ? "saturated" : "";
          cell.text.textContent = `${short(tau)} ${unit}`;
          cell.flag.textContent = saturated ? " at its limit" : pushed !== 0 ? ` external ${short(pushed, 2)}` : "";
          cell.flag.className = saturated ? "saturated" : "pushed";
        }
      });
    };
    scene.addEventListener("time", update);
    update();
  }

  /** Put what a program says into `box`: texts, and a histogram. */
  function told({ texts, counts }, box) {
    const rows = Object.entries(texts).map(([name, text]) =>
      element("tr", {}, element("th", { scope: "row" }, name), element("td", {}, text))
    );
    const most = Math.max(1, ...Object.values(counts));
    for (const [name, count] of Object.entries(counts)) {
      const bar = element("i");
      bar.style.width = `${(100 * count) / most}%`;
      const cell = element("td", {}, element("div", { class: "bar count" }, bar), `${count}`);
      rows.push(element("tr", {}, element("th", { scope: "row" }, name), cell));
    }
    box.replaceChildren(element("table", { class: "gauges" }, element("tbody", {}, ...rows)));
  }

  /** Put a slider for every joint into `box`. */
  function sliders(scene, box) {
    scene.meta.arm.joints.forEach((joint, j) => {
      const value = element("output");
      const told = () => { value.textContent = `${scene.configuration[j].toFixed(3)} ${joint.unit}`; };
      const slider = element("input", {
        type: "range", min: joint.lower, max: joint.upper, step: "any", value: scene.configuration[j],
        "aria-label": joint.name,
        oninput: () => { scene.configuration[j] = Number(slider.value); told(); scene.show(0); },
      });
      slider.value = String(scene.configuration[j]);
      told();
      box.append(element("label", { class: "joint" }, element("span", { title: joint.name }, joint.name), slider, value));
    });
  }

  /** Say what went wrong where the scene would be. */
  function complain(error) {
    window.armgpi = { ready: false, error: String(error) };
    const pane = document.getElementById("scene");
    if (pane) pane.append(element("p", { class: "complaint", role: "alert" }, `The scene cannot be shown: ${error.message || error}`));
  }

  return { unpack, element, short, clamp, ArmScene, Player, switches, gauges, told, sliders, complain };
})();
