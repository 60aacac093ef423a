"use strict";
// Responses of the full and the reduced models, and their errors in each configuration, against angles and against cost.
const Responses = (() => {
  const { data, styles, AXIS, DECADES, decades, plain, line, titled, shown, chosen, draw, element, table } = Style;
  const { models } = data;
  // The two ways to show an error, in the order of the options. Below the floor, in the unit shown, is only the
  // rounding of the packed curves; what is less is drawn on it.
  const ERRORS = [
    { title: "|error|, dB", unit: "dB", floor: 1e-4, limit: (data.figures.find((figure) => figure.name === "db_error") || {}).limit ?? null,
      of: (apart, turned, full) => apart.map((value, at) => (Number.isNaN(full[at]) ? NaN : Math.abs(value))) },
    { title: "|error| / |full|, %", unit: "%", floor: 1e-3, limit: null,
      of: (apart, turned, full) => apart.map((value, at) => {
        if (Number.isNaN(full[at]) || Number.isNaN(value)) return Number.isNaN(full[at]) ? NaN : 100;
        const ratio = 10 ** (value / 20);
        return 100 * Math.hypot(ratio - 1, 2 * Math.sqrt(ratio) * Math.sin((turned[at] * Math.PI) / 360));
      }) },
  ];
  // Decades between the smallest and the largest magnitude.
  function decadesOf(levels) {
    const known = levels.filter((value) => !Number.isNaN(value));
    return known.length ? (known.reduce((a, b) => Math.max(a, b)) - known.reduce((a, b) => Math.min(a, b))) / 20 : 1;
  }
  // A gap where a phase leaves one end of the turn for the other.
  const broken = (values) => values.map((value, k) => (k && Math.abs(value - values[k - 1]) > 180 ? null : value));
  // Of the phases that are whole turns apart, the one next to that of the full system where it is on the axis.
  const near = (value) => (Math.abs(value) > 190 ? value - 360 * Math.sign(value) : value);

  function response() {
    const setting = data.settings[chosen("configuration")];
    const channel = chosen("channel");
    const curve = setting.curves[channel];
    const grid = Arrays.read(setting.hz);
    const hz = Array.from(Arrays.read(curve.at), (k) => grid[k]);
    const full = Arrays.read(curve.full);
    const name = data.channels[channel];
    // Values of a response whose unit is known; else decibels.
    const level = (values) => (name.unit ? Array.from(values, (value) => 10 ** (value / 20)) : values);
    const said = name.unit ? "%{y:.4~g} " + plain(name.unit) : "%{y:.2f} dB";
    const phase = Arrays.read(curve.phase);
    const whole = { x: hz, name: "full", legendgroup: "full", mode: "lines", line: line(styles.full) };
    const angle = { yaxis: "y3", showlegend: false, hovertemplate: "%{y:.1f}°" };
    const traces = [{ ...whole, y: level(full), hovertemplate: said }, { ...whole, ...angle, y: broken(Array.from(phase)) }];
    const shownError = ERRORS[chosen("error")];
    const { floor, limit } = shownError;
    let own = 0;
    let top = floor;
    models.forEach((model, k) => {
      if (curve.apart[k] === null) return;
      const [apart, turned] = [Arrays.read(curve.apart[k]), Arrays.read(curve.turned[k])];
      const y = apart.map((value, at) => value + (full[at] || 0));
      const error = shownError.of(apart, turned, full).map((value) => Math.max(value, floor));
      const largest = error.reduce((a, b) => (b > a ? b : a), floor);
      top = Math.max(top, largest);
      if (k === 0) own = largest;
      const common = { x: hz, name: plain(model), legendgroup: "model " + k, mode: "lines", zorder: models.length - k, line: line(styles.models[k]) };
      traces.push({ ...common, y: level(y), hovertemplate: said });
      traces.push({ ...common, ...angle, y: broken(Array.from(turned, (value, at) => near(value + (phase[at] || 0)))) });
      traces.push({ ...common, y: error, yaxis: "y2", showlegend: false, name: plain(model) + ", error", hovertemplate: "%{y:.3~g} " + shownError.unit,
        line: { ...line(styles.models[k]), width: 1.6 } });
    });
    if (limit !== null) {
      top = Math.max(top, limit);
      traces.push({ x: [hz[0], hz[hz.length - 1]], y: [limit, limit], yaxis: "y2", name: "limit " + limit + " dB", mode: "lines",
        line: { color: styles.limit, width: 1.2 }, hoverinfo: "skip" });
    }
    // Three decades below the run's own worst: the rest of the error is nothing anybody looks for.
    const bottom = Math.max(floor, Math.min(own, top) / 1e3) * 0.7;
    // Fixed margins: automatic ones draw the plot twice.
    const fixed = { automargin: false };
    draw("response", traces, {
      hovermode: "x unified", margin: { l: 84, r: 20, t: 10, b: 52 },
      xaxis: titled("frequency, Hz", { type: "log", ...fixed, anchor: "y2", hoverformat: ".5~g", uirevision: "kept", dtick: "D2", minor: { showgrid: false } }),
      yaxis: titled(name.unit ? "magnitude, " + plain(name.unit) : "magnitude, dB", { ...fixed, domain: [0.53, 1], ...(name.unit ? { type: "log", exponentformat: "power", dtick: Math.max(1, Math.ceil(decadesOf(full) / 5)) } : {}) }),
      yaxis3: titled("phase, °", { ...fixed, domain: [0.3, 0.48], range: [-190, 190], tickvals: [-180, -90, 0, 90, 180] }),
      yaxis2: titled(shownError.title, { ...fixed, domain: [0, 0.25], ...DECADES, range: [Math.log10(bottom), Math.log10(top * 1.6)] }),
      annotations: full.every(Number.isNaN) ? [{ text: "The full system is silent in this channel", xref: "paper", yref: "paper", x: 0.5, y: 0.75, showarrow: false }] : [],
    });
    document.getElementById("response").setAttribute("aria-label",
      `Magnitude and phase of the full and the reduced responses from ${name.input} to ${name.output}, and below them the error in ${shownError.unit === "dB" ? "decibels" : "per cent"}`);
    tables(setting, channel);
  }

  function tables(setting, channel) {
    const rows = models.map((model, k) => (setting.errors[k] === null ? null : [model, ...setting.errors[k], shown(setting.frac[k][channel])]));
    const sizes = element("p", `Full system: ${setting.full[0]} coordinates, ${setting.full[1]} elastic modes in the band. `
      + `Reduced system: ${setting.reduced[0]} coordinates, ${setting.reduced[1]} elastic modes in the band.`, "quiet");
    document.getElementById("selected-name").textContent = `${data.channels[channel].label}, ${data.configurations[chosen("configuration")]}, as chosen at the top of the page.`;
    document.getElementById("selected").replaceChildren(
      table(["model", ...data.figures.map((figure) => figure.label), "FRAC of this channel"], rows.filter(Boolean), 1), sizes);
    document.getElementById("pairs").replaceChildren(setting.pairs.length
      ? table(["full, Hz", models[0] + ", Hz", "shift, %", "MAC of the shapes"], setting.pairs.map((pair) => pair.map(shown)), 0)
      : element("p", "No mode of the reduced system lies in the band."));
    if (setting.damped !== null) {
      document.getElementById("damped").replaceChildren(setting.damped.length
        ? table(["full, Hz", models[0] + ", Hz", "full, damping ratio in %", models[0] + ", damping ratio in %", "MAC of the shapes"],
          setting.damped.map((pair) => pair.map(shown)), 0)
        : element("p", "No oscillating mode of the reduced system lies in the band."));
    }
  }

  const limitLine = (figure) => (figure.limit === null ? {} : {
    shapes: [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: figure.limit, y1: figure.limit, line: { color: styles.limit, width: 1.5 } }],
    annotations: [{ xref: "paper", x: 1, xanchor: "right", y: Math.log10(figure.limit), yanchor: "bottom", showarrow: false,
      text: "limit " + figure.limit + " " + figure.unit }],
  });

  const spanned = (values) => (values.length ? { range: [Math.log10(Math.min(...values) / 2), Math.log10(Math.max(...values) * 2)] } : {});

  function byConfiguration() {
    const figure = data.figures[chosen("figure")];
    const against = chosen("against");
    const axis = against < 0 ? null : data.axes[against];
    const traces = models.flatMap((model, k) => {
      const values = figure.values[k].map((value) => value || null);
      const look = { name: plain(model), marker: { color: styles.models[k].colour, symbol: styles.models[k].symbol, size: 10 } };
      const said = "%{customdata}: %{y:.3~g} " + figure.unit;
      const thin = { ...line(styles.models[k]), width: 1.2 };
      if (axis === null) {
        return [{ ...look, x: data.configurations.map(plain), customdata: data.configurations.map(plain), y: values, mode: "lines+markers", line: thin, hovertemplate: said }];
      }
      // The line joins the worst over all that is set otherwise.
      const angles = [...new Set(axis.values)].sort((a, b) => a - b);
      const worst = angles.map((angle) => Math.max(...values.filter((_, c) => axis.values[c] === angle)) || null);
      return [
        { ...look, x: axis.values, y: values, customdata: data.configurations.map(plain), mode: "markers", legendgroup: model, hovertemplate: said },
        { ...look, x: angles, y: worst, mode: "lines", line: thin, legendgroup: model, showlegend: false, hoverinfo: "skip" },
      ];
    });
    const known = [...traces.flatMap((trace) => trace.y), figure.limit].filter((value) => value);
    draw("by-configuration", traces, {
      ...limitLine(figure), showlegend: true,
      xaxis: axis === null ? { ...AXIS, type: "category", automargin: true } : titled(plain(axis.label) + (axis.unit ? ", " + axis.unit : ""), {}),
      yaxis: titled(figure.label + ", " + figure.unit, { ...DECADES, ...spanned(known) }),
    });
  }

  const COSTS = { seconds: "time of the responses, s", coordinates: "coordinates of the system", steps: "steps for a simulated second",
    operations: "operations for a simulated second", simulation: "computing for a simulated second, s" };

  function speed() {
    const figure = data.figures[chosen("speed-figure")];
    const by = document.getElementById("speed-cost").value;
    const costs = data.speed.models.map((row) => row[by]);
    const whole = data.speed.full[by];
    const traces = models.flatMap((model, k) => {
      const values = figure.values[k].filter((value) => value);
      if (!costs[k] || !values.length) return [];
      const [worst, best] = [Math.max(...values), Math.min(...values)];
      return [{ x: [costs[k]], y: [worst], name: plain(model), mode: "markers", error_y: { type: "data", symmetric: false, array: [0], arrayminus: [worst - best], color: styles.models[k].colour, thickness: 1.5 },
        marker: { color: styles.models[k].colour, symbol: k ? styles.models[k].symbol : "star", size: k ? 12 : 20, line: { color: styles.ink, width: k ? 0 : 1.2 } },
        hovertemplate: `%{x:.4~g}: worst %{y:.3~g} ${figure.unit}, least ${best} ${figure.unit}` }];
    });
    const known = [...traces.map((trace) => trace.y[0] - trace.error_y.arrayminus[0]), ...traces.map((trace) => trace.y[0]), figure.limit].filter((value) => value > 0);
    const limit = limitLine(figure);
    const across = costs.concat(whole).filter((value) => value);
    const own = traces.find((trace) => trace.name === plain(models[0]));
    const shapes = [...(limit.shapes || [])];
    const annotations = [...(limit.annotations || [])].map((each) => ({ ...each, x: 0, xanchor: "left" }));
    // On the side away from the limit, whose words would lie under it on a narrow screen.
    const side = figure.limit !== null && own && own.y[0] < figure.limit ? 30 : -30;
    if (own) annotations.push({ x: Math.log10(own.x[0]), y: Math.log10(own.y[0]), text: "<b>this model</b>", ax: 0, ay: side, standoff: 11, arrowcolor: styles.ink });
    if (whole) {
      shapes.push({ type: "line", yref: "paper", y0: 0, y1: 1, x0: whole, x1: whole, line: { color: styles.full.colour, width: 2, dash: "dot" } });
      annotations.push({ yref: "paper", y: 1, yanchor: "top", x: Math.log10(whole), xanchor: "right", text: "full system", showarrow: false, textangle: -90 });
    }
    draw("speed", traces, {
      shapes, annotations, showlegend: true, legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: { size: 12 } },
      xaxis: titled(COSTS[by], decades(across, 1.5)),
      yaxis: titled(figure.label + ", " + figure.unit, { ...DECADES, ...spanned(known) }),
    });
  }

  return { response, byConfiguration, speed };
})();
