// One person: observed, truth, and forecasts, second by second. Only where the page has people.
const RANKED = new Set(["ranked", "likeliest", "medoid"]);
const trackOf = (array, i, steps) => ({
  x: array.subarray(2 * i * steps, (2 * i + 1) * steps),
  y: array.subarray((2 * i + 1) * steps, (2 * i + 2) * steps),
});
const observedOf = (people, i) => trackOf(people.observed, i, people.rows);
const truthOf = (people, set, i) => trackOf(people.truth, i, Math.round(set.horizon / set.step));
const futureOf = (method, i, k) => trackOf(method.xy, i * method.futures + k, method.steps);
const livesOf = (method, i, k) => method.lives[i * method.futures + k];
const startOf = (people, i) => {
  const { x, y } = observedOf(people, i);
  return [x[x.length - 1], y[y.length - 1]];
};

// Which future is a method's result at a number of steps; of `mean` all are, in equal parts.
function resultsOf(method, i, step) {
  if (method.output === "mean") return Array.from({ length: method.futures }, (_, k) => k);
  return RANKED.has(method.output) || method.output === "modes"
    ? [method.best[i * method.steps + Math.max(step, 1) - 1]]
    : [0];
}

// ADE and FDE [m] of a person at every step of the truth, complete protocol: what ended is held where it did.
function errorsOf(people, set, method, i) {
  const truth = truthOf(people, set, i),
    length = people.length[i],
    ade = new Float32Array(length),
    fde = new Float32Array(length);
  for (let step = 1; step <= length; step++) {
    const results = resultsOf(method, i, step);
    for (const k of results) {
      const path = futureOf(method, i, k);
      let sum = 0,
        away = 0;
      for (let s = 0; s < step; s++) sum += away = Math.hypot(path.x[s] - truth.x[s], path.y[s] - truth.y[s]);
      ade[step - 1] += sum / step / results.length;
      fde[step - 1] += away / results.length;
    }
  }
  return { ade, fde };
}

const samplesOf = (method) => Array.from({ length: method.futures - method.results }, (_, k) => k + method.results);
const thereOf = (method, i, step) => samplesOf(method).filter((k) => livesOf(method, i, k) >= step);

function timeOf(hours) {
  const seconds = Math.round(hours * 3600) % 86400;
  return [seconds / 3600, (seconds / 60) % 60, seconds % 60]
    .map((one) => String(Math.floor(one)).padStart(2, "0"))
    .join(":");
}

const labelOf = (people, set, i) =>
  `${people.names[i]} · ${timeOf(people.clock[i])} · ${Math.round(people.length[i] * set.step)} s · ${people.recordings[i]}`;

function fillList(list, people, set, text, chosen) {
  const wanted = text.trim().toLowerCase();
  const found = people.names.map((_, i) => i).filter((i) => labelOf(people, set, i).toLowerCase().includes(wanted));
  list.replaceChildren(
    ...found.map((i) =>
      Object.assign(element("option", labelOf(people, set, i)), { value: i, selected: i === chosen }),
    ),
  );
  return found;
}

function line(context, view, start, path, until, from = 0) {
  context.beginPath();
  if (from === 0) context.moveTo(view.px(start[0]), view.py(start[1]));
  for (let s = Math.max(from - 1, 0); s < until; s++) context.lineTo(view.px(path.x[s]), view.py(path.y[s]));
  context.stroke();
}

function dot(context, view, x, y, radius, fill, edge) {
  context.beginPath();
  context.arc(view.px(x), view.py(y), radius, 0, 2 * Math.PI);
  context.fillStyle = fill;
  context.fill();
  if (edge) {
    context.strokeStyle = edge;
    context.lineWidth = 1.5;
    context.stroke();
  }
}

function label(context, text, x, y) {
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "left";
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeStyle = css("--card");
  context.strokeText(text, x + 6, y - 5);
  context.fillStyle = css("--ink");
  context.fillText(text, x + 6, y - 5);
}

function drawStarts(context, view, people, found) {
  for (const i of found) {
    const [x, y] = startOf(people, i);
    dot(context, view, x, y, 3.5, css("--card"), css("--observed"));
  }
}

function startNear(people, view, found, px, py) {
  let best = -1,
    least = 10;
  for (const i of found) {
    const [x, y] = startOf(people, i),
      away = Math.hypot(view.px(x) - px, view.py(y) - py);
    if (away < least) {
      least = away;
      best = i;
    }
  }
  return best;
}

// Where those samples may be that are still there: Gaussians about them, as wide as the samples are apart.
function drawDensity(context, view, method, i, step, start) {
  const there = thereOf(method, i, step);
  if (there.length < 3) return;
  const xs = there.map((k) => (step ? futureOf(method, i, k).x[step - 1] : start[0])),
    ys = there.map((k) => (step ? futureOf(method, i, k).y[step - 1] : start[1]));
  const sd = (all) => {
    const mean = all.reduce((a, b) => a + b) / all.length;
    return Math.sqrt(all.reduce((a, b) => a + (b - mean) ** 2, 0) / all.length);
  };
  const width = Math.max(0.4, 0.5 * ((sd(xs) + sd(ys)) / 2) * there.length ** (-1 / 6));
  const low = [Math.min(...xs) - 3 * width, Math.min(...ys) - 3 * width],
    high = [Math.max(...xs) + 3 * width, Math.max(...ys) + 3 * width];
  const cell = Math.max((high[0] - low[0]) / 70, (high[1] - low[1]) / 70, 0.15),
    columns = Math.ceil((high[0] - low[0]) / cell),
    rows = Math.ceil((high[1] - low[1]) / cell);
  const grid = new Float32Array(columns * rows);
  xs.forEach((x, n) => {
    for (let r = 0; r < rows; r++) {
      const dy = (low[1] + (r + 0.5) * cell - ys[n]) / width;
      if (Math.abs(dy) > 3) continue;
      for (let c = 0; c < columns; c++) {
        const dx = (low[0] + (c + 0.5) * cell - x) / width;
        if (Math.abs(dx) <= 3) grid[r * columns + c] += Math.exp(-0.5 * (dx * dx + dy * dy));
      }
    }
  });
  const top = view.py(low[1] + (view.flip ? 0 : rows * cell));
  drawHeat(
    context,
    grid,
    columns,
    view.px(low[0]),
    top,
    columns * cell * view.scale,
    rows * cell * view.scale,
    0.6,
    view.flip,
  );
}

function drawPerson(context, view, set, i, step, shown, detail, parts, methodColour) {
  const people = set.people,
    start = startOf(people, i),
    observed = observedOf(people, i),
    truth = truthOf(people, set, i),
    length = people.length[i];
  const method = people.methods[detail.name];
  context.lineCap = "round";
  context.lineJoin = "round";
  if (method && parts.density && !method.unequal) drawDensity(context, view, method, i, step, start);
  if (method && parts.futures && method.futures > 1)
    drawFutures(context, view, method, i, step, start, detail, methodColour);
  context.strokeStyle = css("--observed");
  context.lineWidth = 5;
  line(context, view, [observed.x[0], observed.y[0]], observed, people.rows);
  context.strokeStyle = css("--truth");
  context.globalAlpha = 0.35;
  context.lineWidth = 3;
  line(context, view, start, truth, length);
  context.globalAlpha = 1;
  context.lineWidth = 5;
  line(context, view, start, truth, Math.min(step, length));
  for (const one of shown) {
    const found = people.methods[one.name];
    if (!found) continue;
    const results = resultsOf(found, i, step || found.steps),
      thin = results.length > 1;
    context.strokeStyle = methodColour(one);
    for (const k of results) {
      const path = futureOf(found, i, k),
        lives = Math.min(livesOf(found, i, k), found.steps);
      context.lineWidth = thin ? 0.8 : 2;
      context.setLineDash(one.dash.map((part) => part * 2));
      context.globalAlpha = thin ? 0.5 : 0.6;
      line(context, view, start, path, lives);
      context.globalAlpha = 1;
      context.setLineDash([]);
      if (step && !thin)
        dot(
          context,
          view,
          path.x[step - 1],
          path.y[step - 1],
          lives >= step ? 5 : 3,
          lives >= step ? methodColour(one) : css("--card"),
          lives >= step ? css("--card") : methodColour(one),
        );
    }
  }
  if (method && parts.modes && method.modes) drawModes(context, view, method, i, start);
  const at = Math.min(step, length);
  dot(
    context,
    view,
    at ? truth.x[at - 1] : start[0],
    at ? truth.y[at - 1] : start[1],
    7,
    step > length ? css("--card") : css("--truth"),
    css("--now"),
  );
  if (step > length) label(context, "left", view.px(truth.x[length - 1]), view.py(truth.y[length - 1]));
}

function drawFutures(context, view, method, i, step, start, detail, methodColour) {
  const ranks = RANKED.has(method.output) && method.futures <= 10;
  for (let place = method.futures - 1; place >= 0; place--) {
    const k = ranks ? method.order[i * method.futures + place] : place;
    if (k < method.results) continue;
    const path = futureOf(method, i, k),
      lives = livesOf(method, i, k),
      there = lives >= step;
    context.strokeStyle = methodColour(detail);
    context.lineWidth = ranks ? 1.4 : 0.9;
    context.globalAlpha = ranks ? 1 - (0.75 * place) / method.futures : 0.35;
    line(context, view, start, path, Math.min(lives, method.steps));
    context.globalAlpha = 1;
    if (step && there) dot(context, view, path.x[step - 1], path.y[step - 1], ranks ? 3.5 : 2.5, methodColour(detail));
    const end = Math.min(step || method.steps, lives);
    if (ranks && end > 0) label(context, String(place + 1), view.px(path.x[end - 1]), view.py(path.y[end - 1]));
  }
}

function drawModes(context, view, method, i, start) {
  for (let m = method.modes - 1; m >= 0; m--) {
    const chance = method.chance[i * method.modes + m],
      k = method.mode[i * method.modes + m];
    if (!(chance > 0)) continue;
    const path = futureOf(method, i, k),
      lives = Math.min(livesOf(method, i, k), method.steps);
    context.strokeStyle = css("--now");
    context.lineWidth = 0.8 + 4 * chance;
    context.setLineDash([7, 4]);
    line(context, view, start, path, lives);
    context.setLineDash([]);
    if (lives) label(context, `${Math.round(100 * chance)} %`, view.px(path.x[lives - 1]), view.py(path.y[lives - 1]));
  }
}

// What the card says of a moment.
function tellPerson(set, i, step, detail) {
  const people = set.people,
    method = people.methods[detail.name],
    seconds = +(step * set.step).toFixed(2),
    length = people.length[i];
  const so =
    step > length ? `This person had left, after ${+(length * set.step).toFixed(2)} s.` : "This person is there.";
  if (!method) return `After ${seconds} s. ${so} ${detail.title} has no forecast.`;
  const samples = samplesOf(method),
    gone = samples.length - thereOf(method, i, step).length;
  const ends = method.unequal
    ? ` ${detail.title}: no modes, density or chances, as the futures shown are a choice of its samples, or have probabilities of their own.`
    : samples.length > 1
      ? ` ${detail.title}: chance of having left ${Math.round((100 * gone) / samples.length)} % (${gone} of ${samples.length} futures have ended, at an exit or where the map does).`
      : ` ${detail.title} has one path and no chances.`;
  const ranks = RANKED.has(method.output) && method.futures <= 10 ? ` Numbers: ranks at ${set.horizon} s.` : "";
  return `After ${seconds} s. ${so}${ends}${ranks}`;
}
