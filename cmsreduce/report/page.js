"use strict";
(() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const { styles, models } = data;
  // The two ways to show an error, in the order of the options. Below the floor, in the unit shown, is only the
  // rounding of the packed curves; what is less is drawn on it.
  const ERRORS = [
    { title: "|error|, dB", unit: "dB", floor: 1e-4, limit: data.figures[1].limit, of: (curve, k) => {
      const full = unpack(curve.full);
      return unpack(curve.reduced[k]).map((value, at) => Math.abs(value - full[at]));
    } },
    { title: "|error| / |full|, %", unit: "%", floor: 1e-3, limit: null,
      of: (curve, k) => unpack(curve.missed[k]).map((value) => 100 * 10 ** (value / 20)) },
  ];
  // Buttons are named one by one: the default bar offers to send the data to a server.
  const CONFIG = { displaylogo: false, responsive: true, showSendToCloud: false, plotlyServerURL: "",
    modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"], ["toImage"]] };
  const FONT = { family: "system-ui, sans-serif", size: 13, color: styles.ink };
  const AXIS = { gridcolor: "#e4e8ec", linecolor: "#8c959f", showline: true, ticks: "outside", tickcolor: "#8c959f", zeroline: false };

  const plain = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const unpack = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const line = (style) => ({ color: style.colour, dash: style.dash, width: style.width });
  const DECADES = { type: "log", dtick: 1, tickformat: "~g" };
  const titled = (text, more) => ({ ...AXIS, title: { text, standoff: 10 }, automargin: true, ...more });
  const layout = (more) => ({
    font: FONT, paper_bgcolor: "#fff", plot_bgcolor: "#fff", margin: { l: 70, r: 20, t: 10, b: 50 },
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" }, ...more,
  });

  function element(name, text, className) {
    const made = document.createElement(name);
    if (text !== undefined) made.textContent = text;
    if (className) made.className = className;
    return made;
  }

  function table(heads, rows, labels) {
    const made = element("table");
    const head = made.createTHead().insertRow();
    heads.forEach((text, column) => {
      const cell = element("th", text, column < labels ? "" : "num");
      cell.scope = "col";
      head.append(cell);
    });
    const body = made.createTBody();
    for (const values of rows) {
      const row = body.insertRow();
      values.forEach((text, column) => row.append(element("td", text, column < labels ? "" : "num")));
    }
    const frame = element("div", undefined, "scroll");
    frame.tabIndex = 0;
    frame.append(made);
    return frame;
  }

  const chosen = (id) => Number(document.getElementById(id).value);
  const shown = (value) => (value === null ? "–" : String(value));

  function drawResponse() {
    const setting = data.settings[chosen("configuration")];
    const channel = chosen("channel");
    const curve = setting.curves[channel];
    const hz = unpack(curve.hz);
    const full = unpack(curve.full);
    const traces = [{ x: hz, y: full, name: "full", legendgroup: "full", mode: "lines", line: line(styles.full), hovertemplate: "%{y:.2f} dB" }];
    const shownError = ERRORS[chosen("error")];
    const floor = shownError.floor;
    let own = 0;
    let top = floor;
    models.forEach((model, k) => {
      if (curve.reduced[k] === null) return;
      const y = unpack(curve.reduced[k]);
      const error = shownError.of(curve, k).map((value) => Math.max(value, floor));
      const largest = error.reduce((a, b) => (b > a ? b : a), floor);
      top = Math.max(top, largest);
      if (k === 0) own = largest;
      const common = { x: hz, name: plain(model), legendgroup: "model " + k, mode: "lines", zorder: models.length - k, line: line(styles.models[k]) };
      traces.push({ ...common, y, hovertemplate: "%{y:.2f} dB" });
      traces.push({ ...common, y: error, yaxis: "y2", showlegend: false, name: plain(model) + ", error", hovertemplate: "%{y:.3~g} " + shownError.unit,
        line: { ...line(styles.models[k]), width: 1.6 } });
    });
    const limit = shownError.limit;
    if (limit !== null) {
      top = Math.max(top, limit);
      traces.push({ x: [hz[0], hz[hz.length - 1]], y: [limit, limit], yaxis: "y2", name: "limit " + limit + " dB", mode: "lines",
        line: { color: styles.limit, width: 1.2 }, hoverinfo: "skip" });
    }
    // Three decades below the run's own worst: the rest of the error is nothing anybody looks for.
    const bottom = Math.max(floor, Math.min(own, top) / 1e3) * 0.7;
    const name = data.channels[channel];
    Plotly.react("response", traces, layout({
      hovermode: "x unified",
      xaxis: titled("frequency, Hz", { type: "log", anchor: "y2", hoverformat: ".5~g", uirevision: "kept", dtick: "D2", minor: { showgrid: false } }),
      yaxis: titled("magnitude, dB re 1", { domain: [0.36, 1] }),
      yaxis2: titled(shownError.title, { domain: [0, 0.3], ...DECADES, range: [Math.log10(bottom), Math.log10(top * 1.6)] }),
      annotations: full.every(Number.isNaN) ? [{ text: "The full system is silent in this channel", xref: "paper", yref: "paper", x: 0.5, y: 0.7, showarrow: false }] : [],
    }), CONFIG);
    document.getElementById("response").setAttribute("aria-label",
      `Magnitude of the full and the reduced responses from ${name.input} to ${name.output}, and below it the error in ${shownError.unit === "dB" ? "decibels" : "per cent"}`);
    const rows = models.map((model, k) => (setting.errors[k] === null ? null : [model, ...setting.errors[k], shown(setting.frac[k][channel])]));
    const sizes = element("p", `Full system: ${setting.full[0]} coordinates, ${setting.full[1]} elastic modes in the band. `
      + `Reduced system: ${setting.reduced[0]} coordinates, ${setting.reduced[1]} elastic modes in the band.`, "quiet");
    document.getElementById("selected").replaceChildren(
      table(["model", ...data.figures.map((figure) => figure.label), "FRAC of this channel"], rows.filter(Boolean), 1), sizes);
    document.getElementById("pairs").replaceChildren(setting.pairs.length
      ? table(["full, Hz", models[0] + ", Hz", "shift, %", "likeness of shapes (MAC)"], setting.pairs.map((pair) => pair.map(shown)), 0)
      : element("p", "No mode of the reduced system lies in the band."));
    if (setting.damped !== null) {
      document.getElementById("damped").replaceChildren(setting.damped.length
        ? table(["full, Hz", models[0] + ", Hz", "full, damping ratio in %", models[0] + ", damping ratio in %", "likeness of shapes (MAC)"],
          setting.damped.map((pair) => pair.map(shown)), 0)
        : element("p", "No oscillating mode of the reduced system lies in the band."));
    }
  }

  function drawByConfiguration() {
    const figure = data.figures[chosen("figure")];
    const names = data.configurations.map(plain);
    const traces = models.map((model, k) => ({
      x: names, y: figure.values[k].map((value) => value || null), name: plain(model), mode: "lines+markers",
      line: { ...line(styles.models[k]), width: 1.2 }, marker: { color: styles.models[k].colour, symbol: styles.models[k].symbol, size: 10 },
      hovertemplate: "%{x}: %{y:.3~g} " + figure.unit,
    }));
    const shapes = [];
    const annotations = [];
    if (figure.limit !== null) {
      shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, y0: figure.limit, y1: figure.limit, line: { color: styles.limit, width: 1.5 } });
      annotations.push({ xref: "paper", x: 1, xanchor: "right", y: Math.log10(figure.limit), yanchor: "bottom", showarrow: false,
        text: "limit " + figure.limit + " " + figure.unit });
    }
    const known = [...traces.flatMap((trace) => trace.y), figure.limit].filter((value) => value);
    const span = known.length ? { range: [Math.log10(Math.min(...known) / 2), Math.log10(Math.max(...known) * 2)] } : {};
    Plotly.react("by-configuration", traces, layout({
      shapes, annotations, showlegend: true,
      xaxis: { ...AXIS, type: "category", automargin: true },
      yaxis: titled(figure.label + ", " + figure.unit, { ...DECADES, ...span }),
    }), CONFIG);
  }

  function drawSigma(part, place) {
    const target = document.getElementById("sigma-" + place);
    // It gave way to a sentence when the page was opened.
    if (target === null) return;
    if (part.sigma.every((value) => value === null)) {
      target.replaceWith(element("p", "The modes of this body were not ranked.", "quiet"));
      return;
    }
    const ranked = chosen("order") === 1;
    const rank = [];
    part.sigma.map((_, k) => k).sort((a, b) => part.sigma[b] - part.sigma[a]).forEach((k, place) => { rank[k] = place + 1; });
    const along = ranked ? rank : part.number;
    const bars = (kept) => {
      const at = part.kept.flatMap((flag, k) => (flag === kept ? [k] : []));
      return {
        type: "bar", name: kept ? "kept" : "left out", x: at.map((k) => along[k]), y: at.map((k) => part.sigma[k]),
        text: at.map((k) => `mode ${part.number[k]}, ${part.hz[k]} Hz, ${part.kind[k]}`), textposition: "none",
        hovertemplate: "%{text}<br>sigma %{y:.4~g}<extra></extra>",
        marker: kept ? { color: "#0072B2" } : { color: "#fff", line: { color: "#8c959f", width: 1 }, pattern: { shape: "/", fgcolor: "#8c959f", size: 5 } },
      };
    };
    const first = ranked ? 1 : part.number[0];
    const count = part.number.length;
    const known = part.sigma.filter((value) => value !== null);
    const decades = Math.log10(Math.max(...known) / Math.min(...known));
    Plotly.react(target, [bars(true), bars(false)], layout({
      barmode: "overlay", bargap: 0.25, showlegend: true,
      // A few modes are not blown up to slabs, and no tick stands between two modes.
      xaxis: titled(ranked ? "rank, by sigma" : "mode, by frequency", { domain: [0, Math.min(1, count / 16)], range: [first - 0.7, first + count - 0.3],
        dtick: Math.ceil(count / 20) }),
      yaxis: titled("sigma", { type: "log", dtick: Math.ceil(decades / 8), exponentformat: "power", tickformat: decades > 8 ? "" : "~g" }),
    }), CONFIG);
  }

  if (data.configurations.length) {
    if (data.channels.length) {
      for (const id of ["configuration", "channel", "error"]) document.getElementById(id).addEventListener("change", drawResponse);
      drawResponse();
    }
    document.getElementById("figure").addEventListener("change", drawByConfiguration);
    drawByConfiguration();
  }
  data.components.forEach(drawSigma);
  if (data.components.length) document.getElementById("order").addEventListener("change", () => data.components.forEach(drawSigma));

  const closed = () => document.querySelectorAll("details:not([open])");
  let opened = [];
  addEventListener("beforeprint", () => {
    opened = [...closed()];
    for (const part of opened) part.open = true;
  });
  addEventListener("afterprint", () => {
    for (const part of opened) part.open = false;
  });
})();
