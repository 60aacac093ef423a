"use strict";
// Unpacks the page, and draws every plot when it comes into view.
(async () => {
  const { data, element, library, wired, watched } = Style;
  const jobs = new Map();
  const finished = new Set();
  const place = (id) => document.getElementById(id);

  if (typeof DecompressionStream === "undefined") {
    document.querySelector("header").append(element("p", "The plots need a browser of 2023 or later; the tables hold the same figures.", "no-script"));
    return;
  }

  // A plot is redrawn on a choice only if it has been drawn: one that nobody has seen costs nothing.
  function plot(id, draw, ...choices) {
    if (place(id) === null) return;
    jobs.set(id, draw);
    for (const choice of choices) place(choice).addEventListener("change", () => { if (finished.has(id)) draw(); });
  }

  function show(id) {
    if (finished.has(id)) return;
    finished.add(id);
    jobs.get(id)();
    document.documentElement.dataset.drawn = [...finished].join(" ");
  }

  document.querySelectorAll(".scroll").forEach(watched);
  if (data.scene) plot("sketch", Scene.sketch);
  if (data.channels.length && data.configurations.length) plot("response", Responses.response, "configuration", "channel", "error");
  plot("by-configuration", Responses.byConfiguration, "figure", "against");
  plot("speed", Responses.speed, "speed-figure", "speed-cost");
  data.components.forEach((_, k) => {
    plot("sigma-" + k, () => Modes.sigma(k), "order");
    plot("effective-" + k, () => Modes.effectiveMass(k));
  });
  plot("mac", Modes.mac, "mac-configuration");
  plot("gains", Modes.gains, "gain-configuration", "gain-channel");
  plot("completeness", Modes.completeness);
  plot("static-lack", Checks.statics);
  plot("zeros", Checks.zeros, "zero-configuration", "zero-channel");
  plot("steps", Checks.steps, "step-configuration", "step-channel");
  plot("controller-margin", Checks.controller, "margin-configuration");
  plot("singular", Modes.singular);
  plot("extraneous", Modes.extraneous);
  plot("timing-bars", Modes.timings);
  if (data.scene) {
    Scene.wire();
    plot("shapes", Scene.shapes);
  }

  wired({
    again: () => finished.forEach((id) => jobs.get(id)()),
    unpack: () => Arrays.openNow("report-arrays"),
    complete: () => [...jobs.keys()].forEach(show),
  });

  await Arrays.open("report-arrays");
  // What needs no library is there at once.
  if (jobs.has("sketch")) show("sketch");
  await new Promise((painted) => requestAnimationFrame(() => setTimeout(painted)));
  await library(await Arrays.inflated("plotly"));
  const seen = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting) show(entry.target.id);
  }, { rootMargin: "300px 0px" });
  for (const id of jobs.keys()) seen.observe(place(id));
  document.documentElement.dataset.ready = "yes";
})();
