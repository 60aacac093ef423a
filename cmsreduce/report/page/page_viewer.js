"use strict";
// Bodies in space as points and lines: turned by mouse, touch or keys, moved by a mode, saved as PNG or SVG.
const Viewers = (() => {
  const STEPS = 14;
  // From nearly at rest to the largest motion: darker is more, so that it reads in grey, too.
  const STOPS = [[184, 196, 208], [240, 168, 90], [213, 94, 0], [96, 18, 0]];
  const BODIES = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#333333"];
  const REST = "#c4ccd4";
  const VIEWS = { iso: [0.65, 0.5], x: [0, 0], y: [-Math.PI / 2, 0], z: [-Math.PI / 2, Math.PI / 2] };
  // The largest motion on the screen, as a share of the size of the scene.
  const SWING = 0.12;
  const PERIOD_MS = 2400;
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;

  const RAMP = Array.from({ length: STEPS }, (_, k) => {
    const along = (k / (STEPS - 1)) * (STOPS.length - 1);
    const from = Math.min(Math.floor(along), STOPS.length - 2);
    const mixed = STOPS[from].map((value, c) => Math.round(value + (STOPS[from + 1][c] - value) * (along - from)));
    return `rgb(${mixed.join(",")})`;
  });

  class CanvasPainter {
    constructor(canvas) {
      const ratio = window.devicePixelRatio || 1;
      this.width = canvas.clientWidth || 800;
      this.height = canvas.clientHeight || 500;
      canvas.width = Math.round(this.width * ratio);
      canvas.height = Math.round(this.height * ratio);
      this.to = canvas.getContext("2d");
      this.to.setTransform(ratio, 0, 0, ratio, 0, 0);
      this.to.fillStyle = Style.tinted("#fff");
      this.to.fillRect(0, 0, this.width, this.height);
      this.to.lineCap = "round";
    }

    lines(segments, colour, width) {
      this.to.strokeStyle = Style.tinted(colour);
      this.to.lineWidth = width;
      this.to.beginPath();
      for (const [x, y, u, v] of segments) {
        this.to.moveTo(x, y);
        this.to.lineTo(u, v);
      }
      this.to.stroke();
    }

    shape(points, fill, stroke) {
      this.to.beginPath();
      points.forEach(([x, y], k) => (k ? this.to.lineTo(x, y) : this.to.moveTo(x, y)));
      this.to.closePath();
      this.to.fillStyle = Style.tinted(fill);
      this.to.fill();
      this.to.strokeStyle = Style.tinted(stroke);
      this.to.lineWidth = 1.5;
      this.to.stroke();
    }

    text(x, y, words, colour, bold) {
      this.to.font = `${bold ? "600 " : ""}13px system-ui, sans-serif`;
      this.to.lineWidth = 4;
      this.to.strokeStyle = Style.tinted("rgba(255,255,255,.9)");
      this.to.strokeText(words, x, y);
      this.to.fillStyle = Style.tinted(colour);
      this.to.fillText(words, x, y);
    }

    measure(words) {
      this.to.font = "600 13px system-ui, sans-serif";
      return this.to.measureText(words).width;
    }
  }

  class SvgPainter {
    constructor(width, height, measure) {
      Object.assign(this, { width, height, measure, parts: [] });
    }

    lines(segments, colour, width) {
      const path = segments.map((s) => `M${s[0].toFixed(1)} ${s[1].toFixed(1)}L${s[2].toFixed(1)} ${s[3].toFixed(1)}`).join("");
      if (path) this.parts.push(`<path d="${path}" fill="none" stroke="${colour}" stroke-width="${width}" stroke-linecap="round"/>`);
    }

    shape(points, fill, stroke) {
      const at = points.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" ");
      this.parts.push(`<polygon points="${at}" fill="${fill}" stroke="${stroke}" stroke-width="1.5"/>`);
    }

    text(x, y, words, colour, bold) {
      const plain = words.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
      this.parts.push(`<text x="${x.toFixed(1)}" y="${y.toFixed(1)}" fill="${colour}" font-weight="${bold ? 600 : 400}">${plain}</text>`);
    }

    get document() {
      return `<svg xmlns="http://www.w3.org/2000/svg" width="${this.width}" height="${this.height}" font-family="sans-serif" font-size="13">`
        + `<rect width="100%" height="100%" fill="#fff"/>${this.parts.join("")}</svg>`;
    }
  }

  class Viewer {
    // parts: { name, rest: Float32Array (3 p), motion: Float32Array or null, lines: Uint array (2 l) }
    // marks: { kind: joint | actuator | sensor, at: [x, y, z], text, axes: [[x, y, z], ...] }
    constructor(canvas, { onPlay = () => {}, described = "" } = {}) {
      Object.assign(this, { canvas, onPlay, parts: [], marks: [], playing: false, swing: 1, phase: 1 });
      canvas.tabIndex = 0;
      canvas.setAttribute("role", "application");
      canvas.setAttribute("aria-label", `${described}. Arrow keys turn it, plus and minus zoom, Home resets, space plays`);
      this.look("iso");
      this.listen();
      new ResizeObserver(() => this.draw()).observe(canvas);
    }

    show(parts, marks = []) {
      const first = this.parts.length === 0;
      Object.assign(this, { parts, marks });
      const low = [Infinity, Infinity, Infinity];
      const high = [-Infinity, -Infinity, -Infinity];
      for (const part of parts) {
        for (let k = 0; k < part.rest.length; k += 1) {
          low[k % 3] = Math.min(low[k % 3], part.rest[k]);
          high[k % 3] = Math.max(high[k % 3], part.rest[k]);
        }
      }
      this.middle = low.map((value, k) => (value + high[k]) / 2);
      this.radius = Math.hypot(...low.map((value, k) => high[k] - value)) / 2 || 1;
      this.largest = 0;
      for (const part of parts) {
        for (let k = 0; part.motion && k < part.motion.length; k += 3) {
          this.largest = Math.max(this.largest, Math.hypot(part.motion[k], part.motion[k + 1], part.motion[k + 2]));
        }
      }
      if (first) this.fit();
      this.draw();
    }

    look(name) {
      [this.yaw, this.pitch] = VIEWS[name];
      this.fit();
      this.draw();
    }

    // Fill the picture from where it is looked at; turning it afterwards does not change its size.
    fit() {
      this.zoom = 1;
      this.pan = [0, 0];
      if (!this.parts.length || !this.canvas.clientWidth) return;
      const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
      const low = [Infinity, Infinity];
      const high = [-Infinity, -Infinity];
      for (const part of this.parts) {
        this.projected(part.rest, null, width, height).forEach((value, k) => {
          low[k % 2] = Math.min(low[k % 2], value);
          high[k % 2] = Math.max(high[k % 2], value);
        });
      }
      const grow = Math.min((0.8 * width) / Math.max(high[0] - low[0], 1), (0.78 * height) / Math.max(high[1] - low[1], 1));
      this.zoom = Math.max(0.2, Math.min(40, grow));
      this.pan = [width / 2 - (low[0] + high[0]) / 2, height / 2 - (low[1] + high[1]) / 2].map((shift) => shift * this.zoom);
    }

    play(on) {
      if (on === this.playing) return;
      this.playing = on;
      this.onPlay(on);
      if (!on) {
        this.phase = 1;
        this.draw();
        return;
      }
      const started = performance.now();
      const step = (now) => {
        if (!this.playing) return;
        this.phase = Math.cos(((now - started) / PERIOD_MS) * 2 * Math.PI);
        this.draw();
        requestAnimationFrame(step);
      };
      requestAnimationFrame(step);
    }

    projected(points, motion, width, height) {
      const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
      const scale = (0.46 * Math.min(width, height * 1.25) * this.zoom) / this.radius;
      const gain = motion && this.largest ? (this.swing * SWING * 2 * this.radius * this.phase) / this.largest : 0;
      const found = new Float32Array((points.length / 3) * 2);
      for (let k = 0, j = 0; k < points.length; k += 3, j += 2) {
        const x = points[k] - this.middle[0] + (gain ? gain * motion[k] : 0);
        const y = points[k + 1] - this.middle[1] + (gain ? gain * motion[k + 1] : 0);
        const z = points[k + 2] - this.middle[2] + (gain ? gain * motion[k + 2] : 0);
        const ahead = cy * x + sy * y;
        found[j] = width / 2 + this.pan[0] + scale * (cy * y - sy * x);
        found[j + 1] = height / 2 + this.pan[1] - scale * (cp * z - sp * ahead);
      }
      return found;
    }

    draw(painter) {
      if (!this.parts.length || (!painter && !this.canvas.clientWidth)) return;
      const to = painter || new CanvasPainter(this.canvas);
      const taken = [];
      const labels = [];
      this.parts.forEach((part, number) => {
        const rest = this.projected(part.rest, null, to.width, to.height);
        const join = (at) => {
          const found = [];
          for (let k = 0; k < part.lines.length; k += 2) {
            const [a, b] = [2 * part.lines[k], 2 * part.lines[k + 1]];
            found.push([at[a], at[a + 1], at[b], at[b + 1]]);
          }
          return found;
        };
        if (!part.motion) {
          const colour = BODIES[number % BODIES.length];
          to.lines(join(rest), colour, 1.6);
          if (!part.lines.length || part.flexible === false) this.dots(to, rest, colour);
          let high = 0;
          for (let k = 2; k < rest.length; k += 2) if (rest[k + 1] < rest[high + 1]) high = k;
          labels.push({ x: rest[high], y: rest[high + 1] - 8, text: part.name, colour, bold: true });
          return;
        }
        to.lines(join(rest), REST, 1);
        const moved = this.projected(part.rest, part.motion, to.width, to.height);
        const size = (k) => Math.hypot(part.motion[3 * k], part.motion[3 * k + 1], part.motion[3 * k + 2]) / (this.largest || 1);
        const sorted = Array.from({ length: STEPS }, () => []);
        join(moved).forEach((segment, k) => {
          const mean = (size(part.lines[2 * k]) + size(part.lines[2 * k + 1])) / 2;
          sorted[Math.min(STEPS - 1, Math.floor(mean * STEPS))].push(segment);
        });
        sorted.forEach((segments, k) => to.lines(segments, RAMP[k], 1.4 + (1.2 * k) / STEPS));
        if (!part.lines.length || part.flexible === false) this.dots(to, moved, RAMP[STEPS - 4]);
      });
      for (const mark of this.marks) this.mark(to, mark, labels);
      for (const label of labels) this.label(to, label, taken);
    }

    dots(to, at, colour) {
      for (let k = 0; k < at.length; k += 2) {
        to.shape([[at[k] - 2, at[k + 1] - 2], [at[k] + 2, at[k + 1] - 2], [at[k] + 2, at[k + 1] + 2], [at[k] - 2, at[k + 1] + 2]], colour, colour);
      }
    }

    mark(to, mark, labels) {
      const along = 0.16 * this.radius;
      const ends = mark.axes.flatMap((axis) => [...mark.at.map((v, k) => v - along * axis[k]), ...mark.at.map((v, k) => v + along * axis[k])]);
      const [x, y] = this.projected(mark.at, null, to.width, to.height);
      const tips = this.projected(ends, null, to.width, to.height);
      const segments = [];
      for (let k = 0; k < tips.length; k += 4) segments.push([tips[k], tips[k + 1], tips[k + 2], tips[k + 3]]);
      to.lines(segments, "#1f2328", 1.4);
      const r = 6;
      const round = Array.from({ length: 20 }, (_, k) => [x + r * Math.cos((k * Math.PI) / 10), y + r * Math.sin((k * Math.PI) / 10)]);
      const forms = {
        joint: [round, "#fff"],
        actuator: [[[x, y - r], [x + r, y + r], [x - r, y + r]], "#E69F00"],
        sensor: [[[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r]], "#56B4E9"],
      };
      to.shape(...forms[mark.kind], "#1f2328");
      labels.push({ x, y: y + 4, text: mark.text, colour: "#1f2328", beside: true });
    }

    // A label gives way to those before it: beside its point where there is room, else above or below.
    label(to, { x, y, text, colour, bold, beside }, taken) {
      const width = to.measure(text);
      const tries = [];
      for (let k = 0; k < 9; k += 1) {
        const shift = (k % 2 ? 1 : -1) * Math.ceil(k / 2) * 16;
        tries.push([beside ? x + 12 : x - width / 2, y + shift], [beside ? x - 12 - width : x + 14, y + shift]);
      }
      const free = tries.find(([left, base]) => left > 2 && left + width < to.width - 2 && base > 14 && base < to.height - 4
        && taken.every((box) => left > box[2] || left + width < box[0] || base - 13 > box[3] || base + 3 < box[1]));
      const [left, base] = free || tries[0];
      taken.push([left, base - 13, left + width, base + 3]);
      to.text(left, base, text, colour, bold);
    }

    turn(right, up) {
      this.yaw += right;
      this.pitch = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, this.pitch + up));
      this.draw();
    }

    scale(by) {
      const zoom = Math.max(0.2, Math.min(40, this.zoom * by));
      this.pan = this.pan.map((shift) => (shift * zoom) / this.zoom);
      this.zoom = zoom;
      this.draw();
    }

    listen() {
      const { canvas } = this;
      const keys = {
        ArrowLeft: () => this.turn(-0.1, 0), ArrowRight: () => this.turn(0.1, 0),
        ArrowUp: () => this.turn(0, 0.1), ArrowDown: () => this.turn(0, -0.1),
        "+": () => this.scale(1.15), "=": () => this.scale(1.15), "-": () => this.scale(1 / 1.15),
        Home: () => this.look("iso"), " ": () => this.play(!this.playing),
      };
      canvas.addEventListener("keydown", (event) => {
        if (!keys[event.key]) return;
        event.preventDefault();
        keys[event.key]();
      });
      canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
      canvas.addEventListener("pointermove", (event) => {
        if (!event.buttons) return;
        if (event.shiftKey || event.buttons === 2) {
          this.pan = [this.pan[0] + event.movementX, this.pan[1] + event.movementY];
          this.draw();
        } else {
          this.turn(-event.movementX / 180, event.movementY / 180);
        }
      });
      // The page scrolls over a picture that nobody has chosen.
      canvas.addEventListener("wheel", (event) => {
        if (document.activeElement !== canvas) return;
        event.preventDefault();
        this.scale(Math.exp(-event.deltaY / 500));
      }, { passive: false });
    }

    save(kind, name) {
      const link = document.createElement("a");
      if (kind === "png") {
        this.draw();
        link.href = this.canvas.toDataURL("image/png");
      } else {
        const ruler = new CanvasPainter(document.createElement("canvas"));
        const to = new SvgPainter(this.canvas.clientWidth, this.canvas.clientHeight, (words) => ruler.measure(words));
        this.draw(to);
        link.href = URL.createObjectURL(new Blob([to.document], { type: "image/svg+xml" }));
      }
      link.download = `${name}.${kind}`;
      link.click();
    }
  }

  return { Viewer, RAMP, still };
})();
