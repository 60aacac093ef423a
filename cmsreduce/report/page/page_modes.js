"use strict";
// Influence and effective mass of the modes of each body, MAC, gains, completeness, projection, timings.
const Modes = (() => {
  const { data, styles, AXIS, decades, figure, COLOURS, DASHES, plain, titled, chosen, draw, element } = Style;
  const SYMBOLS = ["circle", "square", "diamond", "triangle-up", "triangle-down", "cross"];
  const MOTIONS = ["x", "y", "z", "rx", "ry", "rz"];
  const GREYS = { colorscale: [[0, "#ffffff"], [0.25, "#cfe1ef"], [0.6, "#5a9bc8"], [1, "#08306b"]] };

  function sigma(place) {
    const part = data.components[place];
    const target = document.getElementById("sigma-" + place);
    // It gave way to a sentence when the page was opened.
    if (target === null) return;
    if (part.sigma.every((value) => value === null)) {
      target.replaceWith(element("p", "The modes of this body were not ranked.", "quiet"));
      return;
    }
    const ranked = chosen("order") === 1;
    const rank = [];
    part.sigma.map((_, k) => k).sort((a, b) => part.sigma[b] - part.sigma[a]).forEach((k, at) => { rank[k] = at + 1; });
    const along = ranked ? rank : part.number;
    const said = (k) => `mode ${part.number[k]}, ${part.hz[k]} Hz, ${part.kind[k]}`
      + (part.cluster[k] ? `<br>cluster ${part.cluster[k]}` : "") + (part.edge[k].length ? `<br>on the edge: ${plain(part.edge[k].join(", "))}` : "");
    const bars = (kept) => {
      const at = part.kept.flatMap((flag, k) => (flag === kept ? [k] : []));
      return {
        type: "bar", name: kept ? "kept" : "left out", x: at.map((k) => along[k]), y: at.map((k) => part.sigma[k]),
        text: at.map(said), textposition: "none", hovertemplate: "%{text}<br>sigma %{y:.4~g}<extra></extra>",
        marker: kept ? { color: "#0072B2" } : { color: "#fff", line: { color: "#8c959f", width: 1 }, pattern: { shape: "/", fgcolor: "#8c959f", size: 5 } },
      };
    };
    const first = ranked ? 1 : part.number[0];
    const count = part.number.length;
    const known = part.sigma.filter((value) => value !== null);
    const [low, high] = [Math.log10(Math.min(...known)), Math.log10(Math.max(...known))];
    const pad = Math.max(0.3, (high - low) * 0.06);
    const above = (share) => 10 ** (high + pad * share);
    const traces = [bars(true), bars(false)];
    const edge = part.edge.flatMap((cases, k) => (cases.length && part.sigma[k] ? [k] : []));
    if (edge.length) {
      traces.push({ x: edge.map((k) => along[k]), y: edge.map((k) => part.sigma[k] * 10 ** (pad * 0.6)), mode: "markers", name: "on the edge",
        text: edge.map(said), hovertemplate: "%{text}<extra></extra>", marker: { symbol: "diamond", size: 9, color: "#D55E00", line: { color: "#1f2328", width: 1 } } });
    }
    // Modes of a cluster are joined by a line over their bars.
    const clusters = [...new Set(part.cluster)].filter((number) => number > 0);
    clusters.forEach((number, nth) => {
      const at = part.cluster.flatMap((c, k) => (c === number ? [along[k]] : [])).sort((a, b) => a - b);
      traces.push({ x: at, y: at.map(() => above(1.6 + 0.7 * (nth % 2))), mode: "lines+markers", name: "clusters", legendgroup: "clusters", showlegend: nth === 0,
        line: { color: "#1f2328", width: 2 }, marker: { symbol: "line-ns", size: 8, line: { width: 2, color: "#1f2328" } },
        hovertemplate: `cluster ${number}: ${at.length} modes<extra></extra>` });
    });
    draw(target, traces, {
      barmode: "overlay", bargap: 0.25, showlegend: true,
      // A few modes are not blown up to slabs, and no tick stands between two modes.
      xaxis: titled(ranked ? "rank, by sigma" : "mode, by frequency", { domain: [0, Math.min(1, Math.max(count, 4) / 16)], range: [first - 0.7, first + count - 0.3],
        dtick: Math.ceil(count / 20) }),
      yaxis: titled("sigma", { type: "log", dtick: Math.max(1, Math.ceil((high - low) / 8)), exponentformat: "power", tickformat: high - low > 8 ? "" : "~g",
        range: [low - pad, high + pad * (clusters.length ? 3 : 1.5)] }),
    });
  }

  function effectiveMass(place) {
    const found = data.effective_mass[place];
    const target = document.getElementById("effective-" + place);
    const traces = MOTIONS.map((motion, m) => ({ x: found.hz, y: found.running[m], name: motion, legendgroup: motion, mode: "lines",
      line: { color: COLOURS[m], dash: DASHES[m], width: 2, shape: "hv" }, hovertemplate: `${motion}: %{y:.1f} % to %{x:.4~g} Hz<extra></extra>` }));
    if (found.kept_hz.length) {
      MOTIONS.forEach((motion, m) => traces.push({ x: [found.kept_hz[found.kept_hz.length - 1]], y: [found.kept[m][found.kept_hz.length - 1]], legendgroup: motion, showlegend: false,
        mode: "markers", marker: { color: COLOURS[m], size: 9, symbol: "circle-open", line: { width: 2 } }, hovertemplate: `${motion}, modes kept: %{y:.1f} %<extra></extra>` }));
    }
    draw(target, traces, {
      xaxis: titled("frequency with the interfaces held, Hz", decades(found.hz)),
      yaxis: titled("mass of the body, %", { range: [0, 104] }),
    });
  }

  function mac() {
    const found = data.settings[chosen("mac-configuration")].mac;
    const target = document.getElementById("mac");
    if (found === null) {
      Plotly.purge(target);
      target.replaceChildren(element("p", "The MAC of the modes was not stored.", "quiet"));
      return;
    }
    const flat = Arrays.read(found.mac);
    const wide = found.reduced.length;
    const z = found.full.map((_, f) => Array.from(flat.subarray(f * wide, (f + 1) * wide), (value) => value / 255));
    const ticks = (hz) => {
      const step = Math.ceil(hz.length / 16);
      const at = hz.map((_, k) => k).filter((k) => k % step === 0);
      return { tickmode: "array", tickvals: at, ticktext: at.map((k) => String(Number(hz[k].toPrecision(4)))) };
    };
    draw(target, [{ type: "heatmap", z, zmin: 0, zmax: 1, ...GREYS, xgap: wide > 60 ? 0 : 1, ygap: found.full.length > 60 ? 0 : 1,
      colorbar: { title: { text: "MAC", side: "right" }, thickness: 14 },
      customdata: found.full.map((full) => found.reduced.map((reduced) => [full, reduced])),
      hovertemplate: "full %{customdata[0]} Hz<br>reduced %{customdata[1]} Hz<br>MAC %{z:.3f}<extra></extra>" }], {
      xaxis: titled("modes of the reduced system, Hz", { ...ticks(found.reduced), showgrid: false, tickangle: -50 }),
      yaxis: titled("modes of the full system, Hz", { ...ticks(found.full), showgrid: false }),
    });
  }

  function gains() {
    const found = data.gains[chosen("gain-configuration")];
    const channel = chosen("gain-channel");
    const size = Arrays.read(found.scale)[channel];
    const row = data.drawn.indexOf(channel);
    const curve = (where, hz) => Array.from(Arrays.read(where).subarray(row * hz.length, (row + 1) * hz.length), (value) => size * value);
    const [own, whole] = [curve(found.running, found.hz), curve(found.whole, found.whole_hz)];
    const [total, all] = [Arrays.read(found.total)[channel], Arrays.read(found.whole_total)[channel]];
    const look = { mode: "lines+markers", hovertemplate: "%{x:.5~g} Hz: %{y:.4~g}" };
    const traces = [
      { ...look, x: found.whole_hz, y: whole, name: "all modes of the mode sets", line: { color: styles.full.colour, width: 3, shape: "hv" }, marker: { size: 5, color: styles.full.colour } },
      { ...look, x: found.hz, y: own, name: "modes kept", line: { color: styles.models[0].colour, width: 2, dash: "dash", shape: "hv" }, marker: { size: 7, symbol: "circle-open", color: styles.models[0].colour } },
    ];
    const [modes, of, shares] = ["mode", "channel", "share"].map((name) => Arrays.read(found.high[name]));
    const high = Array.from(of).flatMap((c, k) => (c === channel ? [k] : []));
    if (high.length) {
      traces.push({ x: high.map((k) => found.whole_hz[modes[k]]), y: high.map((k) => whole[modes[k]]), name: "a tenth or more of the gains, above the band", mode: "markers",
        marker: { symbol: "diamond", size: 12, color: "#D55E00", line: { width: 1, color: styles.ink } },
        text: high.map((k) => `${figure(100 * shares[k], 2)} % of the gains`), hovertemplate: "%{x:.5~g} Hz: %{text}<extra></extra>" });
    }
    const band = data.band[1];
    draw("gains", traces, {
      shapes: [{ type: "line", yref: "paper", y0: 0, y1: 1, x0: band, x1: band, line: { color: styles.limit, width: 1.2, dash: "dot" } },
        { type: "line", xref: "paper", x0: 0, x1: 1, y0: all, y1: all, line: { color: styles.limit, width: 1.2 } }],
      annotations: [{ yref: "paper", y: 1, yanchor: "top", x: Math.log10(band), xanchor: "left", text: "end of the band", showarrow: false },
        { xref: "paper", x: 0, xanchor: "left", y: all, yanchor: "bottom", text: "elastic static gain", showarrow: false }],
      xaxis: titled("frequency of the system's modes, Hz", decades([...found.hz, ...found.whole_hz])),
      yaxis: titled("running sum of modal gains", { exponentformat: "power", zeroline: true, zerolinecolor: "#8c959f" }),
    });
    const lost = all ? (100 * Math.abs(total - all)) / Math.abs(all) : 0;
    document.getElementById("gain-total").textContent = size === 0 ? "No mode reaches this pair."
      : `Static gain ${figure(total)} of the modes kept, ${figure(all)} of all modes: ${figure(lost, 2)} % is lost.`
      + (high.length ? ` Above the band, ${high.map((k) => `the mode at ${figure(found.whole_hz[modes[k]])} Hz is ${figure(100 * shares[k], 2)} %`).join(", ")} of the gains.`
        : " No mode above the band is a tenth of the gains.");
  }

  function completeness() {
    const axes = [...new Set(data.completeness.map((row) => row[0]))];
    const where = [...new Set(data.completeness.map((row) => row[1]))];
    // What is less is nothing that a motor feels.
    const floor = 1e-4;
    const lost = (row) => (row ? Math.max(row[2], floor) : null);
    const traces = axes.map((axis, a) => {
      const rows = where.map((name) => data.completeness.find((row) => row[0] === axis && row[1] === name));
      return { name: plain(axis), x: where.map(plain), y: rows.map(lost), mode: "lines+markers", line: { color: COLOURS[a % 6], dash: DASHES[a % 6], width: 1.2 },
        marker: { color: COLOURS[a % 6], symbol: SYMBOLS[a % 6], size: 10 }, hovertemplate: `%{x}, ${plain(axis)}: %{y:.3~g} %<extra></extra>` };
    });
    const values = [...traces.flatMap((trace) => trace.y), data.missing_inertia];
    draw("completeness", traces, {
      showlegend: true,
      shapes: [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: data.missing_inertia, y1: data.missing_inertia, line: { color: styles.limit, width: 1.5 } }],
      annotations: [{ xref: "paper", x: 1, xanchor: "right", y: Math.log10(data.missing_inertia), yanchor: "bottom", showarrow: false, text: `poor above ${data.missing_inertia} %` }],
      xaxis: { ...AXIS, type: "category", automargin: true },
      yaxis: titled("inertia that is lost, %", decades(values, 2)),
    });
  }

  function singular() {
    const bodies = Object.entries(data.projection.singular);
    const traces = bodies.map(([name, found], b) => {
      const at = found.values.map((_, k) => k + 1);
      return { x: at, y: found.values, name: plain(name), mode: "lines+markers", line: { color: COLOURS[b % 6], dash: DASHES[b % 6], width: 1.5 },
        marker: { color: found.values.map((_, k) => (k < found.rank ? COLOURS[b % 6] : "#fff")), line: { color: COLOURS[b % 6], width: 1.5 }, size: 8 },
        hovertemplate: "shape %{x}: %{y:.3~g}" };
    });
    draw("singular", traces, { showlegend: true,
      xaxis: titled("shape", {}), yaxis: titled("singular value, relative", { type: "log", exponentformat: "power", dtick: 2 }) });
  }

  function extraneous() {
    if (!document.getElementById("extraneous")) return;
    const groups = [["not of the system", true, "#D55E00", "x"], ["a mode of the system that was not chosen", false, "#0072B2", "circle-open"]];
    const traces = groups.flatMap(([name, spurious, colour, symbol]) => {
      const found = data.projection.extraneous.filter((mode) => mode.spurious === spurious);
      return found.length ? [{ x: found.map((mode) => mode.hz), y: found.map((mode) => mode.weight || 1e-16), name, mode: "markers", marker: { color: colour, symbol, size: 9, line: { width: spurious ? 0 : 2, color: colour } },
        text: found.map((mode) => plain(`${mode.configuration}: lives in ${mode.body}${mode.interface ? ", " + mode.interface : ""}`)), hovertemplate: "%{x:.4~g} Hz, weight %{y:.2~g}<br>%{text}" }] : [];
    });
    draw("extraneous", traces, { showlegend: true, xaxis: titled("frequency, Hz", decades(data.projection.extraneous.map((mode) => mode.hz), 1.3)),
      yaxis: titled("weight in the response", { type: "log", exponentformat: "power" }) });
  }

  function timings() {
    const { stages, bodies, seconds } = data.timings;
    const traces = stages.map((stage, s) => ({ type: "bar", orientation: "h", name: plain(stage), y: bodies.map(plain), x: seconds[s],
      marker: { color: COLOURS[s % 6], pattern: { shape: ["", "/", "x", ".", "\\", "-"][s % 6], bgcolor: COLOURS[s % 6], fgcolor: "#fff", solidity: 0.2 } },
      hovertemplate: `${plain(stage)}: %{x:.3~g} s<extra></extra>` }));
    draw("timing-bars", traces, { barmode: "stack", showlegend: true, legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", traceorder: "normal" }, yaxis: { ...AXIS, type: "category", autorange: "reversed", automargin: true }, xaxis: titled("wall time, s", {}) });
  }

  return { sigma, effectiveMass, mac, gains, completeness, singular, extraneous, timings };
})();
