"use strict";
// Unpacks the plotting library, and draws the sweep.
(async () => {
  const target = document.getElementById("sweep");
  if (typeof DecompressionStream === "undefined") {
    target.textContent = "The picture needs a browser of 2023 or later; sweep.svg beside it shows the same.";
    return;
  }
  const figure = JSON.parse(document.getElementById("sweep-data").textContent);
  const library = document.createElement("script");
  library.textContent = new TextDecoder().decode(await Arrays.inflated("plotly"));
  document.head.append(library);
  // Buttons are named one by one: the default bar offers to send the data to a server.
  const save = (format, title, icon) => ({ name: format, title, icon, click: (plot) => Plotly.downloadImage(plot,
    { format, filename: "sweep", scale: format === "png" ? 2 : 1, width: plot.clientWidth, height: plot.clientHeight }) });
  await Plotly.newPlot(target, figure.data, figure.layout, { displaylogo: false, responsive: true, showSendToCloud: false, plotlyServerURL: "",
    modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"],
      [save("png", "Save as PNG", Plotly.Icons.camera), save("svg", "Save as SVG", Plotly.Icons.disk)]] });
  document.documentElement.dataset.ready = "yes";
})();
