// What pointers, keys and files do, and the beginning of it all.
function listen() {
  const on = (id, event, act) => by(id).addEventListener(event, act);
  on("layers", "change", (event) => setLayer(event.target.value));
  on("set", "change", () => setOne(+by("set").value));
  on("hour", "input", () => setPeriod(+by("hour").value));
  on("second", "input", () => setStep(+by("second").value));
  on("play", "click", () => play(state.playing === "hours" ? null : "hours"));
  on("walk", "click", () => play(state.playing === "walk" ? null : "walk"));
  on("compare", "change", () => compare(by("compare").checked));
  on("other", "change", () => setOther(+by("other").value));
  on("otherhour", "change", () => setPeriod(+by("otherhour").value, 1));
  on("file", "change", () => {
    const [file] = by("file").files;
    by("file").value = ""; // so that the same name can be chosen again
    if (file) drop(file);
  });
  on("search", "input", () => {
    state.found = fillList(by("list"), shownSet().people, shownSet(), by("search").value, state.person);
    ask("over");
  });
  on("list", "change", () => setPerson(by("list").value === "" ? null : +by("list").value));
  on("leave", "click", () => setPerson(null));
  for (const id of ["method", "futures", "modes", "density"]) on(id, "change", () => ask("over", "cards"));
  for (const id of ["metric", "protocol"]) on(id, "change", () => ask("cards"));
  on("grey", "change", () => {
    state.grey = by("grey").checked;
    paint();
  });
  on("theme", "click", () => {
    state.theme = { system: "light", light: "dark", dark: "system" }[state.theme];
    setTheme();
  });
  night.addEventListener("change", setTheme);
  on("byhour", "click", (event) => setPeriod(by("byhour").pick(event.offsetX), state.panel));
  const scrub = (event) => {
    if (event.type === "pointerdown" || event.buttons)
      setStep(Math.round(by("chart").pick(event.offsetX) / shownSet().step));
  };
  on("chart", "pointerdown", scrub);
  on("chart", "pointermove", scrub);
  new ResizeObserver(() => {
    shape();
    ask("base", "over", "cards");
  }).observe(document.body);
  for (const n of [0, 1]) {
    on(`in${n}`, "click", () => zoom(n, 1.5));
    on(`out${n}`, "click", () => zoom(n, 1 / 1.5));
    on(`fit${n}`, "click", () => zoom(n, null));
    follow(by(`map${n}`), () => viewOf(n), {
      changed: () => ask("base", "over"),
      pointed: (px, py) => {
        if (!state.pinned) setPlace(placeAt(n, px, py), false, n);
      },
      tapped: (px, py) => tap(n, px, py),
    });
  }
  document.addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dragging");
  });
  document.addEventListener("dragleave", () => document.body.classList.remove("dragging"));
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("dragging");
    if (event.dataTransfer.files[0]) drop(event.dataTransfer.files[0]);
  });
  document.addEventListener("keydown", key);
}

// By a factor, or to everything.
function zoom(n, factor) {
  if (factor) viewOf(n).zoom(factor);
  else viewOf(n).fit();
  ask("base", "over");
}

function placeAt(n, px, py) {
  const view = viewOf(n),
    points = pointsOf(shownSet(n), state.layer, shownPeriod(n)),
    [x, y] = view.at(px, py),
    i = nearest(points, x, y, Math.max(0.75, 14 / view.scale));
  return i < 0 ? null : { x: points.x[i], y: points.y[i] };
}

function tap(n, px, py) {
  const { people } = shownSet(n),
    drawn = people && shownSet(n) === shownSet() && state.person === null,
    near = drawn ? startNear(people, viewOf(n), state.found, px, py) : -1;
  if (near >= 0) return setPerson(near);
  return setPlace(placeAt(n, px, py), true, n);
}

function key(event) {
  const typing =
      /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName) && !/^(range|radio|checkbox)$/.test(event.target.type),
    map = event.target.classList.contains("over"),
    chart = event.target === by("chart");
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const act = keysOf(event.key, {
    map,
    panel: map ? +event.target.closest(".panel").dataset.panel : 0,
    chart,
    typing,
    button: /^(BUTTON|SUMMARY)$/.test(event.target.tagName),
    input: event.target.tagName === "INPUT",
  });
  if (act) {
    event.preventDefault();
    act();
  }
}

function keysOf(name, { map, panel, chart, typing, button, input }) {
  const set = shownSet(panel),
    walk = () => play(state.playing === "walk" ? null : "walk"),
    moves = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  if (name === "Escape") return () => (state.person !== null ? setPerson(null) : setPlace(null, false));
  if (typing) return null;
  if (map && moves[name])
    return () => {
      const [dx, dy] = moves[name],
        place = nextPlace(
          pointsOf(set, state.layer, shownPeriod(panel)),
          (viewOf(panel) === viewOf(state.panel) && state.place) || middle(panel),
          dx,
          (set.flip ? -1 : 1) * dy,
        );
      if (place) {
        setPlace(place, true, panel);
        viewOf(panel).show(place.x, place.y);
        ask("base");
      }
    };
  if (map && "+=-0".includes(name))
    return () => zoom(panel, name === "0" ? null : name === "-" ? 1 / 1.4 : 1.4);
  if (chart && (name === "ArrowLeft" || name === "ArrowRight"))
    return () => setStep(state.step + (name === "ArrowLeft" ? -1 : 1));
  if (name === " " && !button && !input)
    return state.person !== null ? walk : () => play(state.playing === "hours" ? null : "hours");
  const layer = ["cliff", "stef", "flow", "exits"][+name - 1];
  if (layer && !by("layers").querySelector(`[value=${layer}]`).disabled) return () => setLayer(layer);
  return {
    "[": () => setPeriod(shownPeriod(panel) - 1, panel),
    "]": () => setPeriod(shownPeriod(panel) + 1, panel),
    ",": () => setStep(state.step - 1),
    ".": () => setStep(state.step + 1),
    c: () => compare(!state.compare),
    "/": () => by("search").focus(),
  }[name];
}

function middle(panel) {
  const { x, y } = viewOf(panel),
    points = pointsOf(shownSet(panel), state.layer, shownPeriod(panel)),
    i = nearest(points, x, y, Infinity);
  return i < 0 ? null : { x: points.x[i], y: points.y[i] };
}

unpack(by("data").textContent)
  .then((data) => {
    by("data").textContent = "";
    addRun(data);
    setOne(0);
    listen();
    setTheme();
    window.explorer = { state, sets, frames }; // for tests and for the curious
    document.documentElement.dataset.ready = "yes";
  })
  .catch((error) => {
    by("kind").textContent = `This page cannot be shown: ${error.message}. It needs a browser of 2023 or later.`;
    throw error;
  });
