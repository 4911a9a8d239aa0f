"use strict";
(() => {
  const figures = JSON.parse(document.getElementById("data").textContent);
  const options = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"] };
  const nodes = figures.map((figure, i) => {
    const node = document.getElementById("figure-" + i);
    if (!figure.layout.height) figure.layout.height = 300;
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
  // A printed page has one figure to a row; 670 px is the width of A4 between its margins.
  window.addEventListener("beforeprint", () => {
    document.querySelectorAll("details").forEach((d) => { d.open = true; });
    nodes.forEach((node) => Plotly.relayout(node, { autosize: false, width: 670 }));
  });
  window.addEventListener("afterprint", () => {
    nodes.forEach((node) => Plotly.relayout(node, { autosize: true, width: null }));
  });
  document.body.dataset.drawn = String(nodes.length);
})();
