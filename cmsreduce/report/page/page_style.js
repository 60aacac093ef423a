"use strict";
// What all plots of the page share.
const Style = (() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const { styles } = data;
  const FONT = { family: "system-ui, -apple-system, Segoe UI, sans-serif", size: 13, color: styles.ink };
  const AXIS = { gridcolor: "#e4e8ec", linecolor: "#8c959f", showline: true, ticks: "outside", tickcolor: "#8c959f", zeroline: false };
  const DECADES = { type: "log", dtick: 1, tickformat: "~g" };
  // A logarithmic axis over some values, with every label written out; close ones are spared where it spans decades.
  function decades(values, room = 1.1) {
    const known = values.filter((value) => value > 0);
    if (!known.length) return { type: "log" };
    const [low, high] = [Math.min(...known) / room, Math.max(...known) * room];
    const span = Math.log10(high / low);
    const leads = span > 4 ? [1] : span > 0.7 ? [1, 2, 5] : [1, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 9];
    const at = [];
    for (let decade = Math.floor(Math.log10(low)); decade <= Math.log10(high); decade += 1) {
      for (const lead of leads) at.push(Number((lead * 10 ** decade).toPrecision(3)));
    }
    const tickvals = at.filter((value) => value >= low && value <= high);
    return { type: "log", range: [Math.log10(low), Math.log10(high)], tickmode: "array", tickvals, ticktext: tickvals.map((value) => figure(value)) };
  }

  // A number as a person writes it.
  const figure = (value, digits = 4) => (value !== 0 && (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e6)
    ? Number(value).toExponential(digits - 1).replace(/\.?0+e/, "e") : String(Number(Number(value).toPrecision(digits))));

  const COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"];
  const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"];

  const plain = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");
  const line = (style) => ({ color: style.colour, dash: style.dash, width: style.width });
  const titled = (text, more) => ({ ...AXIS, title: { text, standoff: 10 }, automargin: true, ...more });
  const layout = (more) => ({
    font: FONT, paper_bgcolor: "#fff", plot_bgcolor: "#fff", margin: { l: 70, r: 20, t: 10, b: 50 }, hoverlabel: { font: FONT },
    legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom" }, ...more,
  });
  const shown = (value) => (value === null ? "–" : String(value));
  const chosen = (id) => Number(document.getElementById(id).value);

  // Buttons are named one by one: the default bar offers to send the data to a server.
  function config(name) {
    const svg = { name: "svg", title: "Save as SVG", icon: Plotly.Icons.disk,
      click: (plot) => Plotly.downloadImage(plot, { format: "svg", filename: name, width: plot.clientWidth, height: plot.clientHeight }) };
    const png = { name: "png", title: "Save as PNG", icon: Plotly.Icons.camera,
      click: (plot) => Plotly.downloadImage(plot, { format: "png", filename: name, scale: 2, width: plot.clientWidth, height: plot.clientHeight }) };
    return { displaylogo: false, responsive: true, showSendToCloud: false, plotlyServerURL: "",
      modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"], [png, svg]] };
  }

  const draw = (target, traces, more) => {
    const place = typeof target === "string" ? document.getElementById(target) : target;
    return Plotly.react(place, traces, layout(more), config(place.id));
  };

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

  return { data, styles, FONT, AXIS, DECADES, decades, figure, COLOURS, DASHES, plain, line, titled, shown, chosen, draw, element, table };
})();
