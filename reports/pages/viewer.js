// Compares pictures: flipped in place with number keys or side by side, zoomed and moved together.
(() => {
  "use strict";
  const viewer = document.getElementById("viewer");
  if (!viewer) return;
  const {frames} = JSON.parse(document.getElementById("picture-data").textContent);
  const methods = [...new Set(frames.flatMap((entry) => Object.keys(entry.methods)))];
  const TITLES = {reference: "Reference", client: "Client", flip: "FLIP map", atlas: "Atlas"};
  const MOST_ZOOM = 64;
  // u, v: the picture's point in the middle of every pane, 0..1. zoom: over the size that fits. stops: exposure.
  const start = {zoom: 1, u: 0.5, v: 0.5, stops: 0};
  const state = {...start, frame: 0, method: 0, layer: 0, side: false};
  let panes = [];

  const element = (tag, properties = {}, ...children) => {
    const made = Object.assign(document.createElement(tag), properties);
    made.append(...children);
    return made;
  };
  const panesBox = element("div");
  const bar = element("div", {className: "bar"});
  const status = element("p", {className: "state"});
  const keys = [
    ["1–9", "picture"], ["m M", "next, previous method"], ["f F", "next, previous frame"], ["s", "side by side"],
    ["wheel + −", "zoom"], ["drag", "move"], ["e E", "darker, brighter"], ["0", "reset"], ["x", "full screen"],
  ];
  const help = element("p", {className: "help"});
  for (const [key, meaning] of keys) {
    const caps = key.split(" ").map((part) => element("kbd", {textContent: part}));
    help.append(element("span", {}, ...caps, ` ${meaning}`), " ");
  }
  viewer.append(bar, panesBox, status, help);

  function layers() {
    const entry = frames[state.frame];
    const own = entry.methods[methods[state.method]] ?? {};
    const all = entry.reference ? {reference: entry.reference, ...own} : own;
    return Object.entries(all).map(([name, url]) => ({name, url, title: TITLES[name] ?? name}));
  }

  // Panes are made anew when other pictures are chosen; all that moves them is in place().
  function build() {
    const found = layers();
    state.layer = Math.max(0, Math.min(state.layer, found.length - 1));
    panes = found.map(({name, url, title}, index) => {
      const image = element("img", {src: url, alt: `${title}, frame ${frames[state.frame].frame}`, draggable: false});
      const caption = element("figcaption", {textContent: `${index + 1}  ${title}`});
      const pane = element("figure", {className: "pane"}, image, caption);
      pane.dataset.name = name;
      image.decode().then(place, place);
      listen(pane);
      return {pane, image};
    });
    panesBox.replaceChildren(...panes.map(({pane}) => pane));
    choose();
    place();
  }

  function choose() {
    const group = (title, names, chosen, pick) => {
      const buttons = names.map((name, index) => {
        const button = element("button", {type: "button", textContent: name, onclick: () => pick(index)});
        button.dataset.name = `${title} ${name}`;
        button.setAttribute("aria-pressed", index === chosen);
        return button;
      });
      return element("div", {className: "group"}, element("span", {textContent: title}), ...buttons);
    };
    const change = (name) => (index) => { state[name] = index; build(); };
    const pictures = layers().map(({title}, index) => `${index + 1} ${title}`);
    const groups = [
      group("View", ["In place", "Side by side"], Number(state.side), (index) => { state.side = index === 1; build(); }),
      group("Zoom", ["−", "+", "Reset"], -1, (index) => [zoomOut, zoomIn, reset][index]()),
      group("Method", methods, state.method, change("method")),
      group("Frame", frames.map((entry) => entry.frame), state.frame, change("frame")),
    ];
    if (!state.side) groups.push(group("Picture", pictures, state.layer, (index) => { state.layer = index; show(); }));
    const focused = bar.contains(document.activeElement) ? document.activeElement.dataset.name : null;
    bar.replaceChildren(...groups.filter((made) => made.querySelectorAll("button").length > 1));
    if (focused) [...bar.querySelectorAll("button")].find((button) => button.dataset.name === focused)?.focus();
  }

  function show() {
    choose();
    place();
  }

  function place() {
    if (!panes.length) {
      status.textContent = "This method has no pictures of this frame.";
      return;
    }
    panesBox.className = `panes ${state.side ? "side" : "flip"}`;
    const {naturalWidth: width, naturalHeight: height} = panes[0].image;
    panes.forEach(({pane, image}, index) => {
      pane.classList.toggle("shown", index === state.layer);
      pane.classList.toggle("zoomed", state.zoom > 1);
      if (width) pane.style.aspectRatio = `${width} / ${height}`;
      const scale = scaleOf(pane, image);
      const x = pane.clientWidth / 2 - state.u * image.naturalWidth * scale;
      const y = pane.clientHeight / 2 - state.v * image.naturalHeight * scale;
      image.style.transform = `translate(${x}px, ${y}px) scale(${scale})`;
      image.classList.toggle("enlarged", scale * devicePixelRatio > 1.5);
    });
    for (const part of document.querySelectorAll("#exposure feComponentTransfer > *")) {
      part.setAttribute("slope", 2 ** state.stops);
    }
    const stops = `${state.stops > 0 ? "+" : ""}${state.stops}`;
    status.textContent = `Zoom ${state.zoom.toFixed(1)}x, exposure ${stops} stops, frame ${frames[state.frame].frame}`;
    if (methods.length) status.textContent += `, ${methods[state.method]}`;
  }

  function scaleOf(pane, image) {
    const fit = Math.min(pane.clientWidth / image.naturalWidth, pane.clientHeight / image.naturalHeight);
    return Number.isFinite(fit) ? fit * state.zoom : 1;
  }

  // Zooms about a point of the pane, so that what lies there stays there.
  function zoomBy(factor, pane, x, y) {
    const {image} = panes.find((other) => other.pane === pane);
    const before = scaleOf(pane, image);
    state.zoom = Math.min(MOST_ZOOM, Math.max(1, state.zoom * factor));
    const after = scaleOf(pane, image);
    moveBy(x * (1 / before - 1 / after) / image.naturalWidth, y * (1 / before - 1 / after) / image.naturalHeight);
  }

  function moveBy(du, dv) {
    const inside = (value) => Math.min(1, Math.max(0, value));
    [state.u, state.v] = state.zoom === 1 ? [0.5, 0.5] : [inside(state.u + du), inside(state.v + dv)];
    place();
  }

  const zoomMiddle = (factor) => { if (panes.length) zoomBy(factor, panes[state.layer].pane, 0, 0); };
  const zoomIn = () => zoomMiddle(1.5);
  const zoomOut = () => zoomMiddle(1 / 1.5);
  const reset = () => { Object.assign(state, start); place(); };
  const cycle = (name, count, step) => { state[name] = (state[name] + step + count) % count; build(); };

  function listen(pane) {
    pane.addEventListener("wheel", (event) => {
      if (state.zoom === 1 && event.deltaY > 0) return;  // nothing to zoom out of: the page scrolls on
      event.preventDefault();
      const box = pane.getBoundingClientRect();
      const x = event.clientX - box.left - box.width / 2, y = event.clientY - box.top - box.height / 2;
      zoomBy(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0016)), pane, x, y);
    }, {passive: false});
    pane.addEventListener("pointerdown", (event) => pane.setPointerCapture(event.pointerId));
    pane.addEventListener("pointermove", (event) => {
      if (!pane.hasPointerCapture(event.pointerId)) return;
      const {image} = panes.find((other) => other.pane === pane);
      const scale = scaleOf(pane, image);
      moveBy(-event.movementX / scale / image.naturalWidth, -event.movementY / scale / image.naturalHeight);
    });
    pane.addEventListener("dblclick", reset);
  }

  const actions = {
    m: () => cycle("method", methods.length, 1), M: () => cycle("method", methods.length, -1),
    f: () => cycle("frame", frames.length, 1), F: () => cycle("frame", frames.length, -1),
    s: () => { state.side = !state.side; build(); },
    e: () => { state.stops -= 0.5; place(); }, E: () => { state.stops += 0.5; place(); },
    "+": zoomIn, "=": zoomIn, "-": zoomOut, 0: reset,
    x: () => (document.fullscreenElement ? document.exitFullscreen() : viewer.requestFullscreen()),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.closest("select, input, textarea")) return;
    const layer = Number(event.key) - 1;
    if (layer >= 0 && layer < panes.length) {
      state.layer = layer;
      show();
    } else if (Object.hasOwn(actions, event.key)) {
      actions[event.key]();
    }
  });
  new ResizeObserver(place).observe(panesBox);
  build();
})();
