// One location: its mixture on the cylinder of headings and speeds, its directions, its counts, its hours.
const TURN = 2 * Math.PI;
const turned = (angle) => angle - TURN * Math.round(angle / TURN);
const ARROWS = ["→", "↗", "↑", "↖", "←", "↙", "↓", "↘"];
const arrowOf = (heading, flip) => ARROWS[(((Math.round((heading / TURN) * 8) * (flip ? -1 : 1)) % 8) + 8) % 8];
const clock = (hour) =>
  hour === null ? "whole day" : `${String(hour).padStart(2, "0")}:00–${String((hour + 1) % 24).padStart(2, "0")}:00`;
const whole = (number) => Math.round(number).toLocaleString("en").replaceAll(",", "\u202f");

// The points of a layer that can be chosen.
const pointsOf = (set, layer, period) => (layer === "flow" || layer === "exits" ? set.flow : set[layer])[period];

function nearest(points, x, y, reach) {
  let best = -1,
    least = reach * reach;
  if (points)
    for (let i = 0; i < points.x.length; i++) {
      const away = (points.x[i] - x) ** 2 + (points.y[i] - y) ** 2;
      if (away <= least) {
        least = away;
        best = i;
      }
    }
  return best;
}

// The next location in a direction: as near as may be, and as little aside.
function nextPlace(points, from, dx, dy) {
  if (!points) return null;
  if (!from) from = { x: points.x[0], y: points.y[0] };
  let best = null,
    least = Infinity;
  for (let i = 0; i < points.x.length; i++) {
    const x = points.x[i] - from.x,
      y = points.y[i] - from.y,
      along = x * dx + y * dy,
      aside = Math.abs(x * dy - y * dx);
    if (along < 0.2 || along + 3 * aside >= least) continue;
    least = along + 3 * aside;
    best = { x: points.x[i], y: points.y[i] };
  }
  return best || from;
}

function componentsAt(map, i) {
  const found = [];
  map.location.forEach((one, j) => {
    if (one === i)
      found.push({
        weight: map.weight[j],
        heading: map.mean_heading[j],
        speed: map.mean_speed[j],
        vtt: map.var_heading[j],
        vtr: map.cov_heading_speed[j],
        vrr: map.var_speed[j],
        by: map.by[j],
      });
  });
  return found.sort((a, b) => b.weight - a.weight);
}

// A semi-wrapped Gaussian mixture at a heading and speed.
function mixtureDensity(components, heading, speed) {
  let sum = 0;
  for (const { weight, heading: mean, speed: fast, vtt, vtr, vrr } of components) {
    const determinant = vtt * vrr - vtr * vtr,
      r = speed - fast;
    for (let lap = -1; lap <= 1; lap++) {
      const t = turned(heading - mean) + lap * TURN;
      sum +=
        (weight * Math.exp((-0.5 * (vrr * t * t - 2 * vtr * t * r + vtt * r * r)) / determinant)) /
        (TURN * Math.sqrt(determinant));
    }
  }
  return sum;
}

function drawCylinder(canvas, components, flip, colours) {
  const context = sized(canvas),
    { wide, high } = context,
    ink = css("--faint"),
    left = 30,
    bottom = high - 20,
    top = 6,
    width = wide - left - 6;
  const most = Math.max(
    2,
    Math.ceil(Math.max(0, ...components.map(({ speed, vrr }) => speed + 2 * Math.sqrt(vrr))) * 2) / 2,
  );
  const px = (heading) => left + ((heading + Math.PI) / TURN) * width,
    py = (speed) => bottom - (speed / most) * (bottom - top);
  const columns = 96,
    rows = 48,
    grid = new Float32Array(columns * rows);
  for (let j = 0; j < rows; j++)
    for (let i = 0; i < columns; i++)
      grid[j * columns + i] = mixtureDensity(
        components,
        ((i + 0.5) / columns) * TURN - Math.PI,
        ((j + 0.5) / rows) * most,
      );
  drawHeat(context, grid, columns, left, top, width, bottom - top, 0.75, false);
  context.strokeStyle = css("--line");
  context.lineWidth = 1;
  context.fillStyle = ink;
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "center";
  for (let quarter = -2; quarter <= 2; quarter++) {
    const x = px((quarter * Math.PI) / 2);
    context.beginPath();
    context.moveTo(x, top);
    context.lineTo(x, bottom);
    context.stroke();
    context.fillText(arrowOf((quarter * Math.PI) / 2, flip), Math.min(Math.max(x, left + 5), wide - 9), high - 5);
  }
  context.textAlign = "right";
  for (let speed = 0; speed <= most; speed += most > 3 ? 1 : 0.5)
    context.fillText(speed % 1 ? "" : String(speed), left - 5, py(speed) + 4);
  context.save();
  context.translate(10, (top + bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.textAlign = "center";
  context.fillText("speed, m/s", 0, 0);
  context.restore();
  context.save();
  context.beginPath();
  context.rect(left, top, width, bottom - top);
  context.clip();
  for (const { heading, speed, vtt, vtr, vrr, weight } of components) {
    context.strokeStyle = `rgb(${colours[hueOf(heading)].join()})`;
    context.lineWidth = 1.2 + 2 * weight;
    const a = Math.sqrt(vtt),
      b = vtr / a,
      c = Math.sqrt(Math.max(vrr - b * b, 0));
    for (const lap of [-TURN, 0, TURN]) {
      context.beginPath();
      for (let step = 0; step <= 40; step++) {
        const u = Math.cos((step / 40) * TURN),
          v = Math.sin((step / 40) * TURN);
        context.lineTo(px(heading + lap + a * u), py(speed + b * u + c * v));
      }
      context.stroke();
      context.beginPath();
      context.arc(px(heading + lap), py(speed), 2.5, 0, TURN);
      context.fillStyle = css("--ink");
      context.fill();
    }
  }
  context.restore();
}

function drawRose(canvas, map, cell, flip, colours) {
  const context = sized(canvas),
    { wide } = context,
    middle = wide / 2,
    number = map.orientations,
    reach = middle - 4;
  context.strokeStyle = css("--line");
  for (const share of [0.5, 1]) {
    context.beginPath();
    context.arc(middle, middle, reach * Math.sqrt(share), 0, TURN);
    context.stroke();
  }
  for (let i = 0; i < number; i++) {
    const share = map.share[cell * number + i],
      at = (flip ? 1 : -1) * (i / number) * TURN,
      half = Math.PI / number - 0.04;
    context.beginPath();
    context.moveTo(middle, middle);
    context.arc(middle, middle, reach * Math.sqrt(share), at - half, at + half);
    context.closePath();
    context.fillStyle = `rgb(${colours[hueOf((i / number) * TURN)].join()})`;
    context.fill();
  }
}

// Bars of the hours; returns which period a click at px is.
function drawBars(canvas, hours, values, now) {
  const context = sized(canvas),
    { wide, high } = context,
    width = wide / Math.max(hours.length, 1),
    most = Math.max(1, ...values),
    bottom = high - 16;
  context.textAlign = "center";
  context.font = "11px system-ui, sans-serif";
  hours.forEach((hour, i) => {
    const height = (values[i] / most) * (bottom - 14);
    context.fillStyle = i + 1 === now ? css("--focus") : css("--strong");
    context.fillRect(i * width + 2, bottom - height, width - 4, height);
    context.fillStyle = css("--faint");
    context.fillText(String(hour), (i + 0.5) * width, high - 4);
    if (width > 22) context.fillText(values[i] ? whole(values[i]) : "–", (i + 0.5) * width, bottom - height - 3);
  });
  return (px) => 1 + Math.min(Math.max(Math.floor(px / width), 0), hours.length - 1);
}

const element = (name, text) => Object.assign(document.createElement(name), { textContent: text });

// Fill the card, with the name of the place where there are two; returns what a screen reader says.
function showPlace(set, layer, period, place, colours, name) {
  const map = set.cliff[period],
    cell = set.flow[period],
    stef = set.stef[period],
    by = (id) => document.getElementById(id);
  const at = nearest(map, place.x, place.y, 0.8),
    in_ = nearest(cell, place.x, place.y, 0.8),
    rose = nearest(stef, place.x, place.y, 0.8);
  const components = at < 0 ? [] : componentsAt(map, at),
    least = set.least > 1 ? `fewer than ${set.least}` : "0";
  const title = `${name && `${name}, `}(${place.x.toFixed(1)}, ${place.y.toFixed(1)}) m, ${clock(set.periods[period])}`;
  by("where").textContent = title;
  by("found").hidden = false;
  drawCylinder(by("cylinder"), components, set.flip, colours);
  by("rosebox").hidden = rose < 0;
  if (rose >= 0) drawRose(by("rose"), stef, rose, set.flip, colours);
  const rows = [
    ["people within the CLiFF radius", at < 0 ? least : whole(map.people[at])],
    ["observations", at < 0 ? "–" : whole(map.count[at])],
    ["intensity p", at < 0 ? "–" : map.p[at].toFixed(3)],
    ["people in the cell", in_ < 0 ? least : whole(cell.people[in_])],
  ];
  if (in_ >= 0)
    rows.push(
      ["last seen there", Number.isNaN(cell.left[in_]) ? least : whole(cell.left[in_])],
      [
        "mean velocity",
        `${Math.hypot(cell.vx[in_], cell.vy[in_]).toFixed(2)} m/s ${arrowOf(Math.atan2(cell.vy[in_], cell.vx[in_]), set.flip)}`,
      ],
    );
  by("counts").replaceChildren(...rows.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
  const missing = 1 - components.reduce((sum, one) => sum + one.weight, 0),
    body = components.map((one) => {
      const line = document.createElement("tr"),
        first = element("td", ""),
        swatch = document.createElement("span");
      swatch.className = "swatch";
      swatch.style.background = `rgb(${colours[hueOf(one.heading)].join()})`;
      first.append(swatch, `${arrowOf(one.heading, set.flip)} ${Math.round((one.heading * 180) / Math.PI)}°`);
      line.append(
        first,
        ...[
          `${one.speed.toFixed(2)} m/s`,
          `${Math.round((Math.sqrt(one.vtt) * 180) / Math.PI)}°`,
          Math.sqrt(one.vrr).toFixed(2),
          `${Math.round(100 * one.weight)} %`,
          whole(one.by),
        ].map((text) => element("td", text)),
      );
      return line;
    });
  if (components.length && missing > 0.005) {
    const line = document.createElement("tr"),
      text = element(
        "td",
        `${Math.round(100 * missing)} % of the weight is of components of fewer than ${set.least} people, which are not shown`,
      );
    text.colSpan = 6;
    line.append(text);
    body.push(line);
  }
  if (!components.length) {
    const line = document.createElement("tr"),
      text = element("td", "no CLiFF location here at this time");
    text.colSpan = 6;
    line.append(text);
    body.push(line);
  }
  by("components").tBodies[0].replaceChildren(...body);
  const of = layer === "cliff" ? set.cliff : set.flow,
    hours = set.periods.slice(1);
  const values = hours.map((_, i) => {
    const found = nearest(of[i + 1], place.x, place.y, 0.5);
    return found < 0 ? 0 : of[i + 1].people[found];
  });
  by("byhour").parentElement.hidden = !hours.length;
  if (hours.length) by("byhour").pick = drawBars(by("byhour"), hours, values, period);
  by("byhour").nextElementSibling.textContent =
    `People ${layer === "cliff" ? "within the CLiFF radius" : "in the cell"} by hour${set.least > 1 ? ` (–: fewer than ${set.least})` : ""}. Click an hour to see it.`;
  return `${title}: ${components.length} components${components.length ? `, the heaviest ${components[0].speed.toFixed(1)} metres a second, ${Math.round(100 * components[0].weight)} per cent` : ""}`;
}
