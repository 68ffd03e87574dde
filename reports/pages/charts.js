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
    // Plotly's own `responsive` would take the height of the place, which has none of its own.
    const style = getComputedStyle(place);
    const width = place.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
    const options = {
      displaylogo: false, displayModeBar: innerWidth < 600 ? false : "hover",
      modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
    };
    Plotly.react(place, figure.data, {...themed(figure.layout), width}, options);
  }

  const drawAll = () => charts.forEach(draw);

  // Plotly's script comes packed: as it is it would be most of the page.
  async function unpacked(element) {
    const bytes = Uint8Array.from(atob(element.textContent), (letter) => letter.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  }

  async function start() {
    const script = document.createElement("script");
    script.textContent = await unpacked(document.getElementById("plotly"));
    document.head.append(script);
    drawAll();
    dark.addEventListener("change", drawAll);
    for (const chooser of document.querySelectorAll("[data-chooses]")) chooser.addEventListener("change", drawAll);
    const widths = new Map(charts.map((place) => [place, place.clientWidth]));
    const watcher = new ResizeObserver((entries) => {
      for (const {target} of entries) {
        if (widths.get(target) === target.clientWidth) continue;
        widths.set(target, target.clientWidth);
        draw(target);
      }
    });
    charts.forEach((place) => watcher.observe(place));
  }

  start().catch(() => {
    for (const place of charts) place.textContent = "This browser cannot unpack the charts: use one of 2023 or later.";
  });

  const contents = document.getElementById("contents");
  for (const section of document.querySelectorAll("main section")) {
    const link = document.createElement("a");
    link.href = `#${section.id}`;
    link.textContent = section.querySelector("h2").textContent;
    contents.append(link);
  }
})();
