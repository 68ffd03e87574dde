// Draws the charts in the colours of the page, light or dark, and fills the list of contents.
(() => {
  "use strict";
  const figures = JSON.parse(document.getElementById("figures").textContent);
  const charts = [...document.querySelectorAll(".chart")];
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  function themed(layout) {
    const axis = {gridcolor: colour("--line"), linecolor: colour("--line"), tickcolor: colour("--line")};
    const narrow = innerWidth < 600;
    return {
      ...layout,
      paper_bgcolor: "transparent", plot_bgcolor: "transparent",
      font: {family: getComputedStyle(document.body).fontFamily, size: narrow ? 11 : 13, color: colour("--ink")},
      hoverlabel: {bgcolor: colour("--card"), bordercolor: colour("--line"), font: {color: colour("--ink")}, namelength: -1},
      modebar: {bgcolor: "transparent", color: colour("--soft"), activecolor: colour("--accent")},
      margin: narrow ? {...layout.margin, l: 44, r: 8} : layout.margin,
      xaxis: {...layout.xaxis, ...axis}, yaxis: {...layout.yaxis, ...axis},
    };
  }

  function draw(place) {
    const choosers = [...document.querySelectorAll(`[data-chooses="${place.dataset.figure}"]`)];
    const entry = figures[place.dataset.figure];
    const figure = choosers.length ? entry[choosers.map((chooser) => chooser.value).join("/")] : entry;
    const words = document.querySelector(`[data-says="${place.dataset.figure}"]`);
    if (words) words.innerHTML = figure?.says ?? "";
    if (!figure) {
      if (place.data) Plotly.purge(place);
      place.textContent = "No values for this chart.";
      return;
    }
    if (!place.data) place.textContent = "";
    const options = {
      responsive: true, displaylogo: false, displayModeBar: innerWidth < 600 ? false : "hover",
      modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
    };
    Plotly.react(place, figure.data, themed(figure.layout), options);
  }

  const drawAll = () => charts.forEach(draw);
  drawAll();
  dark.addEventListener("change", drawAll);
  for (const chooser of document.querySelectorAll("[data-chooses]")) chooser.addEventListener("change", drawAll);

  const contents = document.getElementById("contents");
  for (const section of document.querySelectorAll("main section")) {
    const link = document.createElement("a");
    link.href = `#${section.id}`;
    link.textContent = section.querySelector("h2").textContent;
    contents.append(link);
  }
})();
