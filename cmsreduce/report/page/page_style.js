"use strict";
// What all plots of the page share.
const Style = (() => {
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const { styles } = data;
  // Colours of a light page, and those that stand for them on a dark one. Paper is light.
  const NIGHT = { "#fff": "#14181d", "#ffffff": "#14181d", "#1f2328": "#e6edf3", "#333333": "#f0f3f6", "#e4e8ec": "#2b323a", "#8c959f": "#8b949e", "#6e7781": "#9ba5b0",
    "#c4ccd4": "#4a545e", "#d0d7de": "#343b43", "#0072B2": "#58a6dd", "#D55E00": "#f0833a", "#009E73": "#2fbf94", "#CC79A7": "#e0a2c7",
    "#cfe1ef": "#1d3b55", "#5a9bc8": "#3d7fb3", "#08306b": "#cfe8ff", "rgba(255,255,255,.9)": "rgba(20,24,29,.9)" };
  // Width and largest height of a plot on a page of A4, in pixels.
  const PAPER = { width: 680, height: 440 };
  const preferred = matchMedia("(prefers-color-scheme: dark)");
  const able = CSS.supports("color", "light-dark(#000, #fff)");
  let printing = false;
  const dark = () => able && !printing && (document.documentElement.dataset.theme || (preferred.matches ? "dark" : "light")) === "dark";
  // Values in which each colour of a light page has become that of the page as it is.
  function tinted(value) {
    if (!dark()) return value;
    if (typeof value === "string") return NIGHT[value] || value;
    if (Array.isArray(value)) return typeof value[0] === "number" || value[0] === null ? value : value.map(tinted);
    if (value === null || typeof value !== "object" || ArrayBuffer.isView(value)) return value;
    return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, tinted(each)]));
  }

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
    font: FONT, paper_bgcolor: "#fff", plot_bgcolor: "#fff", margin: { l: 70, r: 20, t: 10, b: 50 }, hoverlabel: { font: FONT, bgcolor: "#fff" },
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
    const size = printing ? { width: PAPER.width, height: Math.min(place.clientHeight, PAPER.height) } : {};
    return Plotly.react(place, tinted(traces), { ...tinted(layout(more)), ...size }, config(place.id));
  };

  // The plotting library as a script of its own, which browsers compile beside the page's thread; its first line asks
  // them to do so with all functions at once. On that thread, function by function, opening takes half as long again.
  async function library(bytes) {
    const script = element("script");
    script.src = URL.createObjectURL(new Blob(["//# allFunctionsCalledOnLoad\n", bytes], { type: "text/javascript" }));
    const loaded = new Promise((resolve, reject) => { script.onload = resolve; script.onerror = reject; });
    document.head.append(script);
    await loaded.catch(() => libraryNow(bytes));
    URL.revokeObjectURL(script.src);
  }

  function libraryNow(bytes) {
    if (!globalThis.Plotly) document.head.append(element("script", new TextDecoder().decode(bytes)));
  }

  // Button of the theme, and printing: `again` draws anew what was drawn, `complete` draws the rest, `unpack` reads what
  // a page that is printed at once has not read yet.
  function wired({ again, unpack = () => {}, complete = () => {} }) {
    const button = document.getElementById("theme");
    const named = () => { button.textContent = dark() ? "Light" : "Dark"; };
    button.hidden = !able;
    button.addEventListener("click", () => {
      document.documentElement.dataset.theme = dark() ? "light" : "dark";
      named();
      again();
    });
    preferred.addEventListener("change", () => { named(); again(); });
    named();
    let opened = [];
    addEventListener("beforeprint", () => {
      opened = [...document.querySelectorAll("details:not([open])")];
      for (const part of opened) part.open = true;
      if (!globalThis.Plotly) {
        unpack();
        libraryNow(Arrays.inflatedNow("plotly"));
      }
      printing = true;
      again();
      complete();
    });
    addEventListener("afterprint", () => {
      for (const part of opened) part.open = false;
      printing = false;
      again();
    });
  }

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
    watched(frame);
    return frame;
  }

  // A table that is cut says so below it, with a button that shows all of it.
  function measured(frame) {
    const rows = [...frame.querySelectorAll("tbody tr")];
    const whole = frame.classList.contains("whole");
    const cut = frame.scrollHeight > frame.clientHeight + 4 && frame.clientHeight > 0;
    let line = frame.nextElementSibling;
    if (!line || !line.classList.contains("cut")) {
      if (!cut) return;
      line = element("p", undefined, "cut");
      const button = element("button");
      button.type = "button";
      button.addEventListener("click", () => { frame.classList.toggle("whole"); measured(frame); });
      line.append(element("span"), button);
      frame.after(line);
    }
    if (frame.clientHeight === 0) return;
    const low = frame.getBoundingClientRect().top + frame.clientHeight;
    const seen = rows.filter((row) => row.getBoundingClientRect().bottom <= low + 1).length;
    line.hidden = !cut && !whole;
    line.firstChild.textContent = whole ? `all ${rows.length} rows` : `${seen} of ${rows.length} rows fit here`;
    line.lastChild.textContent = whole ? "Show fewer" : "Show all";
  }
  const sizes = new ResizeObserver((entries) => entries.forEach(({ target }) => measured(target)));
  const watched = (frame) => { if (!frame.classList.contains("whole")) sizes.observe(frame); };

  return { data, styles, tinted, library, libraryNow, wired, FONT, AXIS, DECADES, decades, figure, COLOURS, DASHES, plain, line, titled, shown, chosen, draw, element, table, watched };
})();
