"use strict";
// Plots of a scenario of a sweep; `page`: what every scenario's plots share.
const sweepPlots = (page) => {
  const { about, number } = page;

  function draw(shown, sheet) {
    for (const name of ["spreads", "scatter"]) {
      const parent = sheet.part(name).querySelector(".panels");
      for (const chart of shown[name]) plot(sheet, parent, chart, name === "scatter");
    }
    sheet.part("worst").hidden = !sheet.part("worst").querySelector("table");
  }

  // Values over xs, which may repeat in a scatter plot, and the limit as a dashed line.
  function plot({ panel }, parent, chart, dots) {
    const series = [...chart.series];
    if (chart.limit != null) series.push({ dash: true, label: "limit", values: chart.xs.map(() => chart.limit) });
    panel(parent, {
      ...about(chart), xs: chart.xs, series, height: dots ? 300 : 360, readX: dots ? number : (share) => `${number(share)} %`,
      adapt: (o) => {
        if (!dots) return;
        // uPlot draws one point only of those that share the last x of the scale
        o.scales.x.range = (u, low, high) => [low - 0.04 * (high - low || 1), high + 0.04 * (high - low || 1)];
        o.series.slice(1).forEach((s, k) => {
          if (series[k].dash) return;
          s.paths = () => null;
          s.points = { show: true, size: 4, fill: s.stroke };
        });
      },
    });
  }

  return draw;
};
