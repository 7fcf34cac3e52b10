// What can be changed: map, hour, second, location, person, theme, dataset, run.
const HINTS = {
  cliff: "A dart is a component: as long as people walk in a second, coloured by heading, stronger the more it weighs.",
  stef: "Darts are the directions of a cell: longer and stronger the likelier. The map has no speed.",
  flow: "Cells are stronger the more people came; a dart is their mean velocity, as long as a second's walk.",
  exits: "Discs are larger the more people were last seen there, stronger the likelier that was within a time step.",
};

function setLayer(layer) {
  state.layer = layer;
  by("layers").querySelector(`[value=${layer}]`).checked = true;
  by("hint").textContent = HINTS[layer];
  ask("base", "over", "cards");
}
function setPeriod(period, panel = 0) {
  const { periods } = shownSet(panel),
    now = Math.min(Math.max(period, 0), periods.length - 1);
  state[panel ? "otherPeriod" : "period"] = now;
  by(panel ? "otherhour" : "hour").value = now;
  if (!panel) by("hour").setAttribute("aria-valuetext", clock(periods[now]));
  ask("base", "over", "cards");
}
function setStep(step) {
  state.step = Math.min(Math.max(step, 0), steps(shownSet()));
  by("second").value = state.step;
  ask("over", "cards");
}
function setPlace(place, pinned, panel = 0) {
  Object.assign(state, { place, panel, pinned: pinned && !!place });
  ask("over", "cards");
}
function setPerson(person) {
  state.person = person;
  by("chosen").hidden = by("seconds").hidden = person === null;
  ask("base");
  if (person === null) {
    if (state.playing === "walk") play(null);
    by("list").value = "";
  } else {
    by("list").value = person;
    viewOf().show(...startOf(shownSet().people, person));
    by("said").textContent = `person ${labelOf(shownSet().people, shownSet(), person)}`;
  }
  setStep(person === null ? state.step : 0);
}

function play(what) {
  state.playing = what;
  state.since = 0;
  for (const [id, name, text] of [
    ["play", "hours", "Play"],
    ["walk", "walk", "Walk"],
  ]) {
    by(id).setAttribute("aria-pressed", what === name);
    by(id).textContent = what === name ? "❚❚ Pause" : `▶ ${text}`;
  }
  ask("over");
}

function setTheme() {
  document.documentElement.toggleAttribute(
    "data-dark",
    state.theme === "dark" || (state.theme === "system" && night.matches),
  );
  by("theme").textContent = `Theme: ${state.theme}`;
  paint();
}

function paint() {
  document.documentElement.toggleAttribute("data-grey", state.grey);
  colours = hueColours(sets[0].colours, state.grey);
  paintLegend(by("legend"), shownSet().methods, methodColour);
  ask("base", "over", "cards");
}

const option = (value, text) => Object.assign(element("option", text), { value });

function setOther(number) {
  state.other = number;
  by("other").value = number;
  by("otherhour").replaceChildren(...shownSet(1).periods.map((hour, i) => option(i, clock(hour))));
  setPeriod(state.otherPeriod, 1);
  if (state.panel) setPlace(null, false);
}

function setOne(number) {
  Object.assign(state, { one: number, person: null, found: [], step: 0 });
  setPlace(null, false);
  play(null);
  const { set, run } = sets[number],
    some = set.people && set.people.names.length > 0;
  by("set").value = number;
  by("run").textContent = run;
  by("kind").textContent = set.demo
    ? "Demo data: made-up people. Nothing here is comparable with the paper."
    : set.people
      ? "Recorded people are shown one by one: the run's owner has said so."
      : `Aggregates only: nobody who was recorded is shown, nor anything made by fewer than ${set.least} people.`;
  by("kind").className = set.demo ? "demo" : "";
  for (const input of by("layers").querySelectorAll("input"))
    input.disabled = !(input.value === "flow" || input.value === "exits" ? set.flow : set[input.value]).some(
      (one) => one,
    );
  if (by("layers").querySelector(`[value=${state.layer}]`).disabled) state.layer = "flow";
  by("hours").hidden = set.periods.length < 2;
  by("hour").max = set.periods.length - 1;
  by("second").max = steps(set);
  by("source").textContent =
    `Run ${run}, ${set.title}${set.estimated ? " (clock estimated)" : ""}. ${set.citation}. Terms: ${set.terms}.`;
  by("somebody").hidden = !some;
  by("chosen").hidden = by("seconds").hidden = true;
  by("nobody").textContent = some
    ? set.people.of > set.people.names.length
      ? `${set.people.names.length} of ${set.people.of} people, taken evenly.`
      : ""
    : set.people
      ? "There is no test track that can be forecast."
      : "Not for this recording: its people are real, and the page shows aggregates only (config: explorer: {tracks: true}).";
  by("search").value = "";
  if (some) {
    state.found = fillList(by("list"), set.people, set, "", null);
    const named = set.methods.filter((one) => one.name in set.people.methods);
    by("method").replaceChildren(...named.map((one) => option(one.name, one.title)));
  }
  if (!state.compare) {
    state.otherPeriod = set.periods.length - 1;
    setOther(number);
  }
  fillLegend(by("legend"), set.methods, methodColour, () => ask("over", "cards"));
  shape();
  setLayer(state.layer);
  setPeriod(Math.min(state.period, set.periods.length - 1));
}

function addRun(data) {
  for (const set of data.sets) {
    const points = [...set.cliff, ...set.flow, ...set.stef].filter((one) => one),
      x = points.flatMap((one) => [...one.x]),
      y = points.flatMap((one) => [...one.y]);
    const least = (all) => all.reduce((a, b) => Math.min(a, b), Infinity),
      most = (all) => all.reduce((a, b) => Math.max(a, b), -Infinity);
    const box = x.length ? [least(x) - 1, least(y) - 1, most(x) + 1, most(y) + 1] : [0, 0, 10, 10];
    sets.push({ run: data.run, set, colours: data.colours, view: new View(box, set.flip) });
  }
  for (const id of ["set", "other"]) {
    const chosen = by(id).value;
    by(id).replaceChildren(
      ...sets.map(({ run, set }, i) =>
        option(i, data.run === sets[0].run && id === "set" ? set.title : `${set.title} (${run})`),
      ),
    );
    by(id).value = chosen || 0;
  }
}

async function drop(file) {
  try {
    const data = await dataOfPage(file),
      first = sets.length;
    addRun(data);
    by("dropped").textContent = `Run ${data.run} is added.`;
    setOther(first);
    compare(true);
  } catch (error) {
    by("dropped").textContent = `${file.name} cannot be added: ${error.message}`;
  }
}

function compare(on) {
  state.compare = on;
  by("compare").checked = on;
  document.querySelector('[data-panel="1"]').hidden = !on;
  if (!on && state.panel) setPlace(null, false);
  shape();
  ask("base", "over", "cards");
}

// Two wide places stand one above the other, as all do on a narrow screen.
function shape() {
  const [x0, y0, x1, y1] = viewOf().box,
    tall = (y1 - y0) / (x1 - x0),
    wide = by("panels").clientWidth;
  by("panels").style.setProperty("--tall", Math.min(tall, 1.2).toFixed(3));
  by("panels").classList.toggle("stack", state.compare && (tall < 0.6 || wide < 560));
  const beneath = !state.compare && wide > 700 && by("panels").offsetHeight + 430 < innerHeight + 80; // where there is room
  if (beneath !== (by("errors").parentElement === by("maps")))
    (beneath ? by("maps") : by("rest").parentElement).insertBefore(by("errors"), beneath ? null : by("rest"));
}
