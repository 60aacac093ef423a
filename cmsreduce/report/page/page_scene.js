"use strict";
// The scene as a sketch, and the modes of bodies and of the system on their meshes.
const Scene = (() => {
  const { data, shown, plain } = Style;
  const { Viewer, RAMP, still } = Viewers;
  const scene = data.scene;
  const byId = (id) => document.getElementById(id);
  let viewer = null;

  const placed = (xyz, rotation, translation) => {
    const found = new Float32Array(xyz.length);
    for (let k = 0; k < xyz.length; k += 3) {
      for (let r = 0; r < 3; r += 1) {
        found[k + r] = rotation[3 * r] * xyz[k] + rotation[3 * r + 1] * xyz[k + 1] + rotation[3 * r + 2] * xyz[k + 2] + (translation ? translation[r] : 0);
      }
    }
    return found;
  };

  function mode(body, column, amplitude, into) {
    const levels = Arrays.read(body.shapes);
    const size = Arrays.read(body.scale)[column] * amplitude;
    const many = Arrays.read(body.xyz).length;
    const from = column * many;
    for (let k = 0; k < many; k += 1) into[k] += size * levels[from + k];
    return into;
  }

  function part(b, system, motion) {
    const body = scene.bodies[b];
    const xyz = Arrays.read(body.xyz);
    const turned = (array, move) => (system ? placed(array, system.rotation[b], move ? system.translation[b] : null) : array);
    return { name: body.name, flexible: body.flexible, lines: Arrays.read(body.lines), rest: turned(xyz, true), motion: motion ? turned(motion, false) : null };
  }

  function sketch() {
    const system = scene.systems[Number(byId("sketch-configuration").value)];
    const marks = [
      ...scene.joints.map((joint) => ({ kind: "joint", at: joint.at, axes: joint.axes, body: joint.body, text: joint.name + (joint.free.length ? ` (${joint.free.join(", ")})` : " (locked)") })),
      ...gathered(scene.ports),
    ].map((mark) => ({ ...mark, at: [...placed(mark.at, system.rotation[mark.body], system.translation[mark.body])],
      axes: mark.axes.map((axis) => [...placed(axis, system.rotation[mark.body], null)]) }));
    if (!sketch.viewer) {
      sketch.viewer = new Viewer(byId("sketch"), { described: "Sketch of the scene" });
      tools("sketch", sketch.viewer, "scene");
    }
    sketch.viewer.show(scene.bodies.map((_, b) => part(b, system, null)), marks);
  }

  // Channels at one place share a mark: gyro.rx, gyro.ry and gyro.rz are one gyro.
  function gathered(ports) {
    const found = new Map();
    for (const port of ports) {
      const key = [port.kind, port.body, port.at].join(" ");
      if (!found.has(key)) found.set(key, { ...port, axes: [], names: [] });
      found.get(key).names.push(port.name);
    }
    return [...found.values()].map((mark) => {
      const stems = [...new Set(mark.names.map((name) => name.split(".")[0]))];
      return { ...mark, text: stems.slice(0, 3).join(", ") + (stems.length > 3 ? ` and ${stems.length - 3} more` : "") };
    });
  }

  const whole = () => byId("shape-of").value === "system";
  const system = () => scene.systems[Number(byId("shape-configuration").value)];
  const body = () => scene.bodies[Number(byId("shape-of").value)];

  function listModes() {
    const picker = byId("shape-mode");
    const before = picker.value;
    const label = (number, hz, rest) => `${number}: ${hz === null ? "static" : shown(hz) + " Hz"}${rest}`;
    const options = whole()
      ? system().hz.map((hz, k) => [k, label(k + 1, hz, `, damping ${shown(system().zeta[k])} %`)])
      : body().modes.map((each, k) => [k, label(each.number, each.hz, `, ${each.kind}${each.kept ? ", kept" : ", left out"}`)]);
    picker.replaceChildren(...options.map(([value, text]) => new Option(text, value)));
    byId("shape-configuration").disabled = !whole();
    // The first elastic mode, or the one that was looked at in another configuration.
    const elastic = whole() ? 0 : body().modes.findIndex((each) => each.kind !== "rigid");
    picker.value = whole() && before !== "" && Number(before) < options.length && listModes.was === "system" ? before : String(Math.max(0, elastic));
    listModes.was = byId("shape-of").value;
  }

  function shape() {
    const at = Number(byId("shape-mode").value);
    const parts = whole()
      ? scene.bodies.map((each, b) => {
        const motion = new Float32Array(Arrays.read(each.xyz).length);
        const wide = each.coordinates.length;
        const amplitudes = Arrays.read(system().amplitudes[b]).subarray(at * wide, (at + 1) * wide);
        amplitudes.forEach((amplitude, k) => { if (amplitude) mode(each, each.coordinates[k], amplitude, motion); });
        return part(b, system(), motion);
      })
      : [part(Number(byId("shape-of").value), null, mode(body(), at, 1, new Float32Array(Arrays.read(body().xyz).length)))];
    if (!viewer) {
      viewer = new Viewer(byId("shapes"), { described: "Mode shape", onPlay: (on) => { byId("shape-play").textContent = on ? "⏸ Pause" : "▶ Play"; } });
      tools("shapes", viewer, "mode");
      byId("shape-key").style.background = `linear-gradient(90deg, ${RAMP.join(",")})`;
      if (!still && !document.documentElement.dataset.still) viewer.play(true);
    }
    viewer.show(parts);
    byId("shapes").dataset.mode = byId("shape-mode").selectedOptions[0]?.textContent || "";
  }

  function tools(id, to, name) {
    for (const button of document.querySelectorAll(`[data-viewer="${id}"]`)) {
      const { look, save, zoom } = button.dataset;
      button.addEventListener("click", () => {
        if (look) to.look(look);
        else if (zoom) to.scale(Number(zoom));
        else to.save(save, name);
      });
    }
  }

  function wire() {
    byId("sketch-configuration").addEventListener("change", sketch);
    for (const id of ["shape-of", "shape-configuration"]) byId(id).addEventListener("change", () => { listModes(); shape(); });
    byId("shape-mode").addEventListener("change", shape);
    byId("shape-play").addEventListener("click", () => viewer.play(!viewer.playing));
    byId("shape-swing").addEventListener("input", (event) => { viewer.swing = Number(event.target.value); viewer.draw(); });
    for (const [id, by] of [["shape-before", -1], ["shape-after", 1]]) {
      byId(id).addEventListener("click", () => {
        const picker = byId("shape-mode");
        picker.selectedIndex = Math.max(0, Math.min(picker.options.length - 1, picker.selectedIndex + by));
        shape();
      });
    }
  }

  return { wire, sketch, shapes: () => { listModes(); shape(); } };
})();
