"use strict";
// Error of a sweep against a cost, both of which can be chosen, and its points as a table that can be sorted.
(async () => {
  const { data, styles, titled, DECADES, plain, draw, library, libraryNow, wired, watched } = Style;
  const place = (id) => document.getElementById(id);
  const target = place("sweep");

  function picture() {
    if (!globalThis.Plotly) return;
    const [error, cost] = [place("error").value, place("cost").value];
    const plane = data.planes.find((each) => each.error === error && each.cost === cost) || { points: [], x: [], y: [], front: [], steps: [] };
    const pick = (values, at) => at.map((k) => values[k]);
    const front = { x: pick(plane.x, plane.steps), y: pick(plane.y, plane.steps), mode: "lines", name: "Pareto front", hoverinfo: "skip",
      line: { color: styles.ink, width: 1, shape: "hv" } };
    const marks = data.groups.map((group, number) => {
      const at = plane.points.map((_, k) => k).filter((k) => data.group[plane.points[k]] === number);
      const best = pick(plane.front, at);
      return { x: pick(plane.x, at), y: pick(plane.y, at), mode: "markers", name: plain(group.name), hovertemplate: "%{text}<extra></extra>",
        text: at.map((k) => data.said[plane.points[k]]), customdata: at.map((k) => data.folders[plane.points[k]]),
        marker: { symbol: group.symbol, color: group.colour, size: best.map((b) => (b ? 12 : 8)), opacity: best.map((b) => (b ? 1 : data.faint)),
          line: { color: styles.ink, width: best.map((b) => (b ? 1 : 0)) } } };
    });
    const limit = data.limits[error];
    place("noise").textContent = plane.noise ? `Times within ${(100 * plane.noise).toFixed(0)} % of each other count as equal.` : "";
    draw(target, [front, ...marks], {
      showlegend: true,
      shapes: limit ? [{ type: "line", xref: "paper", x0: 0, x1: 1, y0: limit.value, y1: limit.value, line: { color: styles.limit, width: 1.5 } }] : [],
      annotations: limit ? [{ xref: "paper", x: 1, xanchor: "right", y: Math.log10(limit.value), yanchor: "bottom", showarrow: false, text: limit.text }] : [],
      xaxis: titled(data.labels[cost], { type: "log", exponentformat: "power" }), yaxis: titled(data.labels[error], DECADES),
    });
    target.removeAllListeners("plotly_click");
    target.on("plotly_click", ({ points }) => { if (points[0].customdata) location.href = points[0].customdata; });
  }

  // Numbers by size, with cells without a value last; other cells by their text.
  function sort(head, column) {
    const down = head.getAttribute("aria-sort") === "ascending";
    const body = place("points").tBodies[0];
    const value = (row) => row.cells[column].dataset.value;
    const compared = (a, b) => (value(a) === "" ? 1 : value(b) === "" ? -1
      : (down ? -1 : 1) * (head.className === "num" ? Number(value(a)) - Number(value(b)) : value(a).localeCompare(value(b), "en", { numeric: true })));
    for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    body.append(...[...body.rows].sort(compared));
  }

  [...place("points").tHead.rows[0].cells].forEach((head, column) => head.firstElementChild.addEventListener("click", () => sort(head, column)));
  document.querySelectorAll(".scroll").forEach(watched);
  for (const id of ["error", "cost"]) place(id).addEventListener("change", picture);
  wired({ again: picture });
  if (typeof DecompressionStream === "undefined") libraryNow(Arrays.inflatedNow("plotly"));
  else await library(await Arrays.inflated("plotly"));
  picture();
  document.documentElement.dataset.ready = "yes";
})();
