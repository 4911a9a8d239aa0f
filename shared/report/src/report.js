"use strict";
(() => {
  const figures = JSON.parse(document.getElementById("data").textContent);
  const heights = figures.map((figure) => figure.layout.height || 300);
  const options = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
  const nodes = figures.map((figure, i) => {
    const node = document.getElementById("figure-" + i);
    figure.layout.height = heights[i];
    Plotly.newPlot(node, figure.data, figure.layout, options);
    return node;
  });
  // Figures over time zoom together: a look at one moment is a look at all of it.
  let linking = false;
  nodes.forEach((node, i) => {
    if (!figures[i].timed) return;
    node.on("plotly_relayout", (change) => {
      const all = change["xaxis.autorange"];
      const from = change["xaxis.range[0]"], to = change["xaxis.range[1]"];
      if (linking || (!all && from === undefined)) return;
      linking = true;
      const update = all ? { "xaxis.autorange": true } : { "xaxis.range": [from, to] };
      const others = nodes.filter((other, j) => j !== i && figures[j].timed);
      Promise.all(others.map((other) => Plotly.relayout(other, update))).finally(() => { linking = false; });
    });
  });
  // A printed page has three figures, one to a row; 670 px is the width of A4 between its margins.
  window.addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach((d) => { d.open = true; });
    nodes.forEach((node, i) => {
      Plotly.relayout(node, { autosize: false, width: 670, height: Math.max(heights[i] - 38, 262) });
    });
  });
  window.addEventListener("afterprint", () => {
    nodes.forEach((node, i) => Plotly.relayout(node, { autosize: true, width: null, height: heights[i] }));
  });
  document.body.dataset.drawn = String(nodes.length);
})();
