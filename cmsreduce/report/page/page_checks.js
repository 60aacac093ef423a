"use strict";
// Checks of the reduction: static loads, zeros, steps in time, the controller.
const Checks = (() => {
  const { data, styles, AXIS, decades, figure, COLOURS, plain, line, titled, chosen, draw } = Style;
  const PLACES = [["antiresonance, on the imaginary axis", "circle"], ["on the real axis", "diamond"], ["off both axes", "square"]];
  const said = (id, text) => { document.getElementById(id).textContent = text; };
  const per = (value) => (value === null ? "no value" : `${figure(value, 3)} %`);
  const part = (where, from, count) => Arrays.read(where).subarray(from, from + count);
  const level = (value, text, axis = "y", log = true) => ({
    shape: { type: "line", xref: "paper", x0: 0, x1: 1, yref: axis, y0: value, y1: value, line: { color: styles.limit, width: 1.5 } },
    annotation: { xref: "paper", x: 1, xanchor: "right", yref: axis, y: log ? Math.log10(value) : value, yanchor: "bottom", showarrow: false, text },
  });

  function statics() {
    // Smaller values are rounding.
    const floor = 1e-12;
    const bodies = [...new Set(data.statics.map((row) => row[0]))];
    const traces = bodies.map((body, b) => {
      const rows = data.statics.filter((row) => row[0] === body);
      return { type: "bar", orientation: "h", name: plain(body), y: rows.map((row) => plain(`${body}: ${row[1]}`)), x: rows.map((row) => Math.max(row[2] || 0, floor)),
        text: rows.map((row) => (row[2] < floor ? "none" : per(row[2]))), textposition: "outside", cliponaxis: false,
        marker: { color: COLOURS[b % 6], pattern: { shape: ["", "/", "x", ".", "\\", "-"][b % 6], bgcolor: COLOURS[b % 6], fgcolor: "#fff", solidity: 0.2 } },
        hovertemplate: "%{y}: %{text}<extra></extra>" };
    });
    const limit = data.static_limit;
    const known = [...traces.flatMap((trace) => trace.x), limit || floor];
    const low = Math.log10(Math.max(floor, Math.min(...known))) - (Math.min(...known) > floor ? 1 : 0);
    draw("static-lack", traces, { showlegend: bodies.length > 1, bargap: 0.35,
      shapes: limit ? [{ type: "line", yref: "paper", y0: 0, y1: 1, x0: limit, x1: limit, line: { color: styles.limit, width: 1.5 } }] : [],
      annotations: limit ? [{ yref: "paper", y: 1, yanchor: "bottom", x: Math.log10(limit), showarrow: false, text: `limit ${limit} %` }] : [],
      xaxis: titled("missing strain energy, %", { type: "log", exponentformat: "power", dtick: 2, range: [low, Math.max(low + 6, Math.log10(Math.max(...known)) + 1.2)] }),
      yaxis: { ...AXIS, type: "category", autorange: "reversed", automargin: true } });
  }

  function zeros() {
    const found = data.zeros[chosen("zero-configuration")];
    const channel = chosen("zero-channel");
    const before = (side) => found.counts.slice(0, channel).reduce((sum, counts) => sum + counts[side], 0);
    const read = (name, side) => Array.from(part(found[name], before(side), found.counts[channel][side]));
    const [full, reduced] = [read("full", 0), read("reduced", 1)].map((logs) => logs.map((value) => 10 ** value));
    const places = [read("full_place", 0), read("reduced_place", 1)];
    const floor = 1e-8;
    const miss = read("miss", 0).map((value) => Math.max(100 * 10 ** value, floor));
    const sides = [[full, places[0], "full", styles.full.colour, "-open"], [reduced, places[1], "reduced", styles.models[0].colour, ""]];
    const traces = sides.flatMap(([hz, where, side, colour, open]) => PLACES.flatMap(([place, symbol], p) => {
      const at = hz.flatMap((_, k) => (where[k] === p ? [k] : []));
      if (!at.length && p > 0) return [];
      return [{ x: at.map((k) => hz[k]), y: at.map(() => side), name: `${side}, ${place}`, mode: "markers", hovertemplate: `${side}: %{x:.6~g} Hz, ${place}<extra></extra>`,
        marker: { symbol: symbol + open, size: 11, color: colour, line: { width: 2, color: colour } } }];
    }));
    const judged = read("judged", 0);
    for (const [flag, name] of [[1, "distance from its partner"], [0, "from the nearest: beyond the band, or hidden by damping"]]) {
      const at = full.flatMap((_, k) => (judged[k] === flag ? [k] : []));
      if (!at.length) continue;
      const y = at.map((k) => miss[k]);
      const fill = flag ? styles.models[0].colour : "#fff";
      traces.push({ x: at.map((k) => full[k]), y, yaxis: "y2", name, mode: "markers", marker: { size: flag ? 9 : 7, symbol: flag ? "diamond" : "circle", color: fill, line: { width: 1, color: flag ? styles.ink : "#8c959f" } },
        error_y: { type: "data", symmetric: false, array: y.map(() => 0), arrayminus: y.map((value) => value - floor), color: flag ? styles.models[0].colour : "#d0d7de", thickness: flag ? 2 : 1, width: 0 },
        hovertemplate: "%{x:.6~g} Hz: zero of the reduced system %{y:.3~g} % off<extra></extra>" });
    }
    const lone = full.flatMap((hz, k) => (judged[k] === 1 && !Number.isFinite(miss[k]) ? [hz] : []));
    const band = data.band[1];
    const known = miss.filter((value) => Number.isFinite(value));
    const limit = data.zero_limit ? level(data.zero_limit, `limit ${data.zero_limit} %`, "y2") : null;
    const top = Math.max(1e-4, data.zero_limit || 0, ...known);
    if (lone.length) {
      traces.push({ x: lone, y: lone.map(() => top), yaxis: "y2", name: "no partner", mode: "markers", marker: { symbol: "x", size: 11, color: COLOURS[1] },
        hovertemplate: "%{x:.6~g} Hz: the reduced system has no such zero<extra></extra>" });
    }
    draw("zeros", traces, {
      shapes: [{ type: "line", yref: "paper", y0: 0, y1: 1, x0: band, x1: band, line: { color: styles.limit, width: 1.2, dash: "dot" } }, ...(limit ? [limit.shape] : [])],
      annotations: [{ yref: "paper", y: 1, yanchor: "top", x: Math.log10(band), xanchor: "right", text: "end of the band", showarrow: false }, ...(limit ? [limit.annotation] : [])],
      showlegend: true,
      xaxis: titled("frequency of the zero, Hz", { ...decades([...full, ...reduced, band], 1.2), anchor: "y2" }),
      yaxis: { ...AXIS, type: "category", categoryarray: ["reduced", "full"], categoryorder: "array", range: [-0.6, 1.6], domain: [0.62, 1], automargin: true },
      yaxis2: titled("distance, %", { type: "log", exponentformat: "power", domain: [0, 0.5], dtick: 2, range: [Math.log10(Math.min(top, ...known)) - 0.5, Math.log10(top) + 0.7] }),
    });
    const worst = found.worst[channel];
    const lost = worst && worst[1] ? `; ${worst[1]} of the full system's ${worst[1] === 1 ? "has" : "have"} no partner` : "";
    said("zero-worst", worst === null ? "No mode joins this pair." : `${worst[2]} zeros in the band that damping does not hide, off by ${per(worst[0])} at most${lost}.`);
  }

  function steps() {
    const found = data.steps[chosen("step-configuration")];
    const channel = chosen("step-channel");
    const time = Arrays.read(found.time);
    const size = Arrays.read(found.scale)[channel];
    const [full, apart] = ["full", "apart"].map((name) => part(found[name], channel * time.length, time.length));
    const x = Array.from(time);
    const name = data.channels[channel];
    const high = full.reduce((top, value) => Math.max(top, Math.abs(value)), 0) || 1;
    const curve = (y, more) => ({ x, y: Array.from(y), mode: "lines", hovertemplate: "%{y:.4~g}", ...more });
    draw("steps", [
      curve(full.map((value) => size * value), { name: "full", line: line(styles.full) }),
      curve(full.map((value, k) => size * (value + apart[k])), { name: plain(data.models[0]), line: line(styles.models[0]) }),
      curve(apart.map((value) => (100 * value) / high), { name: "error", yaxis: "y2", showlegend: false, hovertemplate: "%{y:.3~g} %", line: { ...line(styles.models[0]), width: 1.6, dash: "solid" } }),
    ], {
      hovermode: "x unified",
      xaxis: titled("time, s", { anchor: "y2", hoverformat: ".4~g" }),
      yaxis: titled("elastic response", { domain: [0.36, 1], exponentformat: "power", zeroline: true, zerolinecolor: "#8c959f" }),
      yaxis2: titled("error, %", { domain: [0, 0.28], zeroline: true, zerolinecolor: "#8c959f" }),
    });
    document.getElementById("steps").setAttribute("aria-label", `Response of ${name.output} to a step on ${name.input}, full and reduced, and below it the error`);
    said("step-error", size === 0 ? "This pair is silent." : `Step on ${name.input}, ${name.output}: off by ${per(found.rms[channel])} root mean square, ${per(found.peak[channel])} at most.`);
  }

  function controller() {
    const found = data.margins[chosen("margin-configuration")];
    const hz = Array.from(Arrays.read(found.hz));
    const [spillover, borne] = ["spillover", "borne"].map((name) => Array.from(Arrays.read(found[name]), (value) => 10 ** value));
    const ratio = spillover.map((value, k) => value / borne[k]);
    const at = ratio.reduce((best, value, k) => (value > ratio[best] ? k : best), 0);
    const curve = (y, name, style, more) => ({ x: hz, y, name, mode: "lines", line: style, hovertemplate: "%{y:.3~g}", ...more });
    const mark = (y, more) => ({ x: [hz[at]], y: [y[at]], name: "worst frequency", mode: "markers", legendgroup: "worst", hovertemplate: "worst: %{x:.5~g} Hz, %{y:.3~g}",
      marker: { symbol: "diamond", size: 12, color: COLOURS[1], line: { width: 1, color: styles.ink } }, ...more });
    const one = level(1, "no proof above 1", "y2");
    draw("controller-margin", [
      curve(borne, "margin of the reduced loop", line(styles.full)),
      curve(spillover, "spillover of the modes left out", { color: COLOURS[0], width: 2, dash: "dash" }),
      mark(spillover),
      curve(ratio, "quotient", { color: COLOURS[0], width: 2 }, { yaxis: "y2", showlegend: false }),
      mark(ratio, { yaxis: "y2", showlegend: false }),
    ], {
      hovermode: "x unified", shapes: [one.shape], annotations: [one.annotation],
      xaxis: titled("frequency, Hz", { ...decades(hz), anchor: "y2", hoverformat: ".5~g" }),
      yaxis: titled("singular values", { type: "log", exponentformat: "power", domain: [0.42, 1], dtick: 2 }),
      yaxis2: titled("quotient", { type: "log", exponentformat: "power", domain: [0, 0.34], dtick: 2,
        range: [Math.log10(Math.min(...ratio)) - 0.2, Math.max(0, Math.log10(ratio[at])) + 0.9] }),
    });
    const growing = found.unstable === null ? "; the reduced loop has no real state space to count its roots by" : found.unstable ? `; the reduced loop has ${found.unstable === 1 ? "an unstable root" : `${found.unstable} unstable roots`}` : "; the reduced loop is stable";
    said("margin-worst", `The quotient is ${figure(found.ratio, 3)} at ${figure(found.worst_hz, 5)} Hz, the worst${growing}: the full loop is ${found.proven ? "proven stable" : "not proven stable"}.`);
  }

  return { statics, zeros, steps, controller };
})();
