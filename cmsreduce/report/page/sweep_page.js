"use strict";
// Unpacks the plotting library, and draws the error of a sweep against a cost; both can be chosen.
(async () => {
  const place = (id) => document.getElementById(id);
  const target = place("sweep");
  if (typeof DecompressionStream === "undefined") {
    target.textContent = "The picture needs a browser of 2023 or later; sweep.svg beside it shows its main part.";
    return;
  }
  const data = JSON.parse(place("sweep-data").textContent);
  const library = document.createElement("script");
  library.textContent = new TextDecoder().decode(await Arrays.inflated("plotly"));
  document.head.append(library);
  // Buttons are named one by one: the default bar offers to send the data to a server.
  const save = (format, title, icon) => ({ name: format, title, icon, click: (plot) => Plotly.downloadImage(plot,
    { format, filename: "sweep", scale: format === "png" ? 2 : 1, width: plot.clientWidth, height: plot.clientHeight }) });
  const axis = (name) => ({ title: { text: data.labels[name] }, type: "log", gridcolor: "#e4e8ec", exponentformat: "power" });

  function draw() {
    const [error, cost] = [place("error").value, place("cost").value];
    const plane = data.planes.find((each) => each.error === error && each.cost === cost);
    if (!plane) return Plotly.react(target, [], { xaxis: axis(cost), yaxis: axis(error) });
    const pick = (values, at) => at.map((k) => values[k]);
    const front = { x: pick(plane.x, plane.steps), y: pick(plane.y, plane.steps), mode: "lines", name: "Pareto front", hoverinfo: "skip",
      line: { color: data.ink, width: 1, shape: "hv" } };
    const marks = data.groups.map((group, number) => {
      const at = plane.points.map((_, k) => k).filter((k) => data.group[plane.points[k]] === number);
      const best = pick(plane.front, at);
      return { x: pick(plane.x, at), y: pick(plane.y, at), mode: "markers", name: group.name, hovertemplate: "%{text}<extra></extra>",
        text: at.map((k) => data.said[plane.points[k]]),
        marker: { symbol: group.symbol, color: group.colour, size: best.map((b) => (b ? 11 : 7)), opacity: best.map((b) => (b ? 1 : data.faint)),
          line: { color: data.ink, width: best.map((b) => (b ? 1 : 0)) } } };
    });
    place("noise").textContent = plane.noise ? `Times within ${(100 * plane.noise).toFixed(0)} % of each other count as equal.` : "";
    return Plotly.react(target, [front, ...marks], { font: { color: data.ink }, legend: { orientation: "h", y: -0.2 }, xaxis: axis(cost), yaxis: axis(error),
      paper_bgcolor: "#fff", plot_bgcolor: "#fff" }, { displaylogo: false, responsive: true, showSendToCloud: false, plotlyServerURL: "",
      modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"],
        [save("png", "Save as PNG", Plotly.Icons.camera), save("svg", "Save as SVG", Plotly.Icons.disk)]] });
  }

  for (const id of ["error", "cost"]) place(id).addEventListener("change", draw);
  await draw();
  document.documentElement.dataset.ready = "yes";
})();
