// What is shown, and how a frame is drawn of it.
const by = (id) => document.getElementById(id),
  KEPT_FRAMES = 1200,
  HOUR_MS = 1500,
  STEPS_A_SECOND = 4;
const calm = matchMedia("(prefers-reduced-motion: reduce)"),
  night = matchMedia("(prefers-color-scheme: dark)");
const sets = []; // every dataset of this page and of dropped ones: { run, set, view }
const state = {
  one: 0,
  layer: "cliff",
  period: 0,
  compare: false,
  other: 0,
  otherPeriod: 0,
  place: null,
  panel: 0, // of the map that `place` is on
  pinned: false,
  person: null,
  found: [],
  step: 0,
  grey: false,
  theme: "system",
  playing: null,
  since: 0,
  walked: 0,
};
const frames = [];
let colours = [],
  asked = 0;
const wanted = { base: true, over: true, cards: true };

const shownSet = (panel = 0) => sets[panel ? state.other : state.one].set;
const shownPeriod = (panel = 0) => (panel ? state.otherPeriod : state.period);
const viewOf = (panel = 0) => {
  const mine = sets[panel ? state.other : state.one],
    first = sets[state.one];
  return panel && mine.set.name === first.set.name ? first.view : mine.view;
};
const steps = (set) => Math.round(set.horizon / set.step);
// In grey all methods are of one colour, told apart by their dashes; in the dark they are lighter, black ones most.
const methodColour = (method) => {
  if (state.grey || (method.colour === "#000000" && dark())) return css("--ink");
  return dark() ? `rgb(${rgb(method.colour).map((one) => Math.round(0.55 * one + 0.45 * 255))})` : method.colour;
};
const detail = () => {
  const methods = shownSet().methods;
  return methods.find((one) => one.name === by("method").value) || methods[0];
};

function ask(...parts) {
  for (const part of parts) wanted[part] = true;
  if (!asked) asked = requestAnimationFrame(frame);
}

function frame(now) {
  const begun = performance.now();
  asked = 0;
  if (state.playing) advance(now);
  document.querySelectorAll(".panel").forEach((panel, n) => {
    if (!panel.hidden) drawPanel(panel, n);
  });
  if (wanted.cards) cards();
  wanted.base = wanted.over = wanted.cards = false;
  frames.push(performance.now() - begun);
  if (frames.length > KEPT_FRAMES) frames.shift();
  if (state.playing) ask();
}

function advance(now) {
  const passed = now - (state.since || now),
    set = shownSet();
  state.since ||= now;
  state.walked = now / 1000;
  wanted.over = true;
  if (state.playing === "hours" && passed >= HOUR_MS) {
    state.since = now;
    setPeriod(state.period + 1 < set.periods.length ? state.period + 1 : Math.min(1, set.periods.length - 1));
  }
  if (state.playing === "walk" && passed >= 1000 / STEPS_A_SECOND) {
    state.since = now;
    setStep(state.step < steps(set) ? state.step + 1 : 0);
  }
}

function drawPanel(panel, n) {
  const set = shownSet(n),
    view = viewOf(n),
    [base, over] = panel.querySelectorAll("canvas"),
    { width, height } = panel.getBoundingClientRect();
  if (view.width !== width || view.height !== height) {
    view.size(width, height);
    wanted.base = wanted.over = true;
  }
  if (wanted.base) {
    const context = sized(base);
    drawFloor(context, view, set);
    context.globalAlpha = state.person !== null && set === shownSet() ? 0.3 : 1; // the person stands out
    const drawn = drawLayer(context, view, set, state.layer, shownPeriod(n), colours);
    context.globalAlpha = 1;
    drawKeys(context, view, colours, state.layer);
    const name = by("layers").querySelector(`[value=${state.layer}]`).nextElementSibling.textContent;
    panel.querySelector("figcaption").textContent =
      `${state.compare && sets.length ? `${set.title}, ` : ""}${name}, ${clock(set.periods[shownPeriod(n)])}${drawn ? "" : ": there is no map"}`;
  }
  if (!wanted.over) return;
  const context = sized(over);
  if (state.playing === "hours" && !calm.matches)
    drawWalkers(context, view, set, state.layer, shownPeriod(n), state.walked, css("--now"));
  if (set.people && set === shownSet()) {
    if (state.person !== null)
      drawPerson(
        context,
        view,
        set,
        state.person,
        state.step,
        set.methods.filter((one) => one.shown),
        detail(),
        { futures: by("futures").checked, modes: by("modes").checked, density: by("density").checked },
        methodColour,
      );
    else if (state.playing !== "hours") drawStarts(context, view, set.people, state.found);
  }
  if (state.place && view === viewOf(state.panel)) {
    context.strokeStyle = css("--focus");
    context.lineWidth = state.pinned ? 3 : 2;
    context.beginPath();
    context.arc(view.px(state.place.x), view.py(state.place.y), Math.max(0.5 * view.scale, 6), 0, 7);
    context.stroke();
  }
}

function cards() {
  const set = shownSet(),
    shown = set.methods.filter((one) => one.shown),
    metric = by("metric").value,
    protocol = by("protocol").value,
    seconds = state.step * set.step;
  by("found").hidden = !state.place;
  if (state.place) {
    const [there, period] = [shownSet(state.panel), shownPeriod(state.panel)],
      name = state.compare ? by(state.panel ? "other" : "set").selectedOptions[0].textContent : "";
    const text = showPlace(there, state.layer, period, state.place, colours, name);
    if (state.pinned) by("said").textContent = text;
  } else by("where").textContent = "Point at a location of the map, tap it, or use the arrow keys on the map.";
  by("chart").pick = drawChart(by("chart"), set, {
    shown,
    protocol,
    metric,
    person: state.person,
    seconds,
    colour: methodColour,
  });
  by("legend")
    .querySelectorAll("label")
    .forEach((row, i) => {
      const method = set.methods[i],
        own = personCurve(set, method, state.person, metric),
        value = at(own || curveOf(set, method, protocol, metric), seconds);
      row.querySelector(".value").textContent = Number.isFinite(value) ? `${value.toFixed(2)} m` : "";
    });
  const first = set.methods[0] && curveOf(set, set.methods[0], protocol, metric),
    number = first && first.n[first.x.findIndex((one) => Math.abs(one - seconds) < 0.01)];
  by("about").textContent =
    `${state.person === null ? "Means" : "Thick: this person, complete protocol; thin: means"} over the run's test tracks${number ? `, ${whole(number)} of ${set.methods[0].title} at ${+seconds.toFixed(2)} s` : ""}.`;
  if (state.person !== null) by("now").textContent = tellPerson(set, state.person, state.step, detail());
  by("secondname").textContent = `${+seconds.toFixed(2)} s`;
  by("hourname").textContent = clock(set.periods[state.period]);
}
