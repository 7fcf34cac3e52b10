// The maps as pictures: a floor, and darts (broad where they begin, pointed where they lead) or discs.
const HUES = 36,
  SHADES = 4,
  DART_S = 1; // a dart is as long as one walks in this time

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const dark = () => document.documentElement.hasAttribute("data-dark");
const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));

// Colours of headings: `HUES` of them, lighter in the dark; one for all in grey.
function hueColours(stops, grey) {
  if (grey) return Array(HUES).fill(rgb(dark() ? "#eceff3" : "#1a1d21"));
  return Array.from({ length: HUES }, (_, i) => {
    const at = (i / HUES) * (stops.length - 1),
      low = Math.floor(at);
    const [a, b] = [rgb(stops[low]), rgb(stops[low + 1])],
      lift = dark() ? 0.35 : 0;
    return a.map((one, k) => Math.round((one + (b[k] - one) * (at - low)) * (1 - lift) + 255 * lift));
  });
}

const hueOf = (heading) => ((Math.round((heading / (2 * Math.PI)) * HUES) % HUES) + HUES) % HUES;

// The darts of a map: x, y, vx, vy in m, and `bin`, hue and shade in one; sorted so that faint ones lie below.
function darts(x, y, heading, length, strength) {
  const order = Array.from(strength.keys())
    .filter((i) => length[i] > 0)
    .sort((a, b) => strength[a] - strength[b]);
  const found = {
    x: new Float32Array(order.length),
    y: new Float32Array(order.length),
    vx: new Float32Array(order.length),
    vy: new Float32Array(order.length),
    bins: [],
  };
  let last = -1;
  order.forEach((i, n) => {
    found.x[n] = x[i];
    found.y[n] = y[i];
    found.vx[n] = length[i] * Math.cos(heading[i]);
    found.vy[n] = length[i] * Math.sin(heading[i]);
    const shade = Math.min(Math.floor(strength[i] * SHADES), SHADES - 1),
      bin = shade * HUES + hueOf(heading[i]);
    (found.bins[bin] ||= []).push(n);
    last = Math.max(last, bin);
  });
  return found;
}

const BUILD = {
  cliff(set, period) {
    const map = set.cliff[period];
    if (!map) return null;
    const n = map.location.length,
      at = (name) => Float32Array.from({ length: n }, (_, i) => map[name][map.location[i]]);
    return darts(
      at("x"),
      at("y"),
      map.mean_heading,
      map.mean_speed.map((one) => Math.max(one, 0.12) * DART_S),
      map.weight.map((one) => Math.sqrt(one)),
    );
  },
  stef(set, period) {
    const map = set.stef[period];
    if (!map) return null;
    const parts = { x: [], y: [], heading: [], length: [], strength: [] },
      number = map.orientations;
    map.share.forEach((share, i) => {
      if (share < 0.05) return;
      const cell = Math.floor(i / number);
      parts.x.push(map.x[cell]);
      parts.y.push(map.y[cell]);
      parts.heading.push(((i % number) / number) * 2 * Math.PI);
      parts.length.push(map.size * (0.25 + 0.65 * share));
      parts.strength.push(Math.sqrt(share));
    });
    return darts(parts.x, parts.y, parts.heading, parts.length, parts.strength);
  },
  flow(set, period) {
    const map = set.flow[period];
    if (!map) return null;
    const most = map.people.reduce((a, b) => Math.max(a, b), 1);
    const speed = map.vx.map((vx, i) => Math.hypot(vx, map.vy[i])),
      heading = map.vx.map((vx, i) => Math.atan2(map.vy[i], vx));
    return {
      ...darts(
        map.x,
        map.y,
        heading,
        speed.map((one) => one * DART_S),
        speed.map(() => 1),
      ),
      cells: map,
      value: map.people.map((one) => Math.sqrt(one / most)),
      most,
    };
  },
  exits(set, period) {
    const map = set.flow[period];
    return map && { cells: map, discs: map.left, rate: map.left.map((left, i) => left / map.rows[i]) };
  },
};

// What is made once of a dataset; kept by the dataset itself, since those of two runs may have one name.
const kept = new Map();
function once(set, key, make) {
  const of = kept.get(set) || kept.set(set, {}).get(set);
  return key in of ? of[key] : (of[key] = make());
}

// The picture of a layer and period of a dataset; null where there is none.
const picture = (set, layer, period) => once(set, `${layer}/${period}`, () => BUILD[layer](set, period));

// A floor plan as an image of its cells, in the colours of the theme.
function planImage(plan) {
  const rows = plan.cells.length / plan.columns,
    image = new ImageData(plan.columns, rows);
  const colours = ["--free", "--unknown", "--wall"].map((name) => rgb(css(name)));
  plan.cells.forEach((cell, i) =>
    image.data.set(
      [...colours[cell], 255],
      4 * ((rows - 1 - Math.floor(i / plan.columns)) * plan.columns + (i % plan.columns)),
    ),
  );
  const canvas = Object.assign(document.createElement("canvas"), { width: plan.columns, height: rows });
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

function drawFloor(context, view, set) {
  if (set.plan) {
    const plan = set.plan,
      image = once(set, `plan/${dark()}`, () => planImage(plan));
    context.save();
    context.translate(view.px(plan.x), view.py(plan.y));
    context.scale(1, -view.up);
    context.rotate(-plan.yaw);
    context.imageSmoothingEnabled = false;
    context.drawImage(
      image,
      0,
      -image.height * plan.size * view.scale,
      image.width * plan.size * view.scale,
      image.height * plan.size * view.scale,
    );
    context.restore();
  } else if (set.flow[0]) {
    context.fillStyle = css("--free");
    context.fillRect(0, 0, view.width, view.height);
    context.fillStyle = css("--seen");
    squares(context, view, set.flow[0], set.cell);
  }
}

function squares(context, view, cells, size) {
  const side = size * view.scale + 0.5;
  for (let i = 0; i < cells.x.length; i++)
    context.fillRect(view.px(cells.x[i] - size / 2), view.py(cells.y[i]) - side / 2, side, side);
}

function drawLayer(context, view, set, layer, period, colours) {
  const found = picture(set, layer, period);
  if (!found) return false;
  if (found.value) shade(context, view, set, found);
  if (found.discs) discs(context, view, found);
  else paths(context, view, found, colours);
  return true;
}

function shade(context, view, set, found) {
  const side = set.cell * view.scale + 0.5,
    ink = css("--density"),
    groups = Array.from({ length: 8 }, () => []);
  found.value.forEach((one, i) => groups[Math.min(Math.floor(one * 8), 7)].push(i));
  groups.forEach((group, level) => {
    context.fillStyle = `rgba(${ink}, ${0.06 + 0.07 * level})`;
    for (const i of group)
      context.fillRect(view.px(found.cells.x[i]) - side / 2, view.py(found.cells.y[i]) - side / 2, side, side);
  });
}

function discs(context, view, { cells, discs: left, rate }) {
  const ink = css("--density"),
    edge = css("--ink");
  const most = left.reduce((a, b) => (b > a ? b : a), 1);
  for (let i = 0; i < left.length; i++) {
    if (!(left[i] > 0)) continue;
    context.beginPath();
    context.arc(
      view.px(cells.x[i]),
      view.py(cells.y[i]),
      Math.max(1.2 * view.scale * Math.sqrt(left[i] / most), 1.5),
      0,
      2 * Math.PI,
    );
    context.fillStyle = `rgba(${ink}, ${0.15 + 0.75 * Math.min(rate[i] * 3, 1)})`;
    context.fill();
    context.lineWidth = 0.7;
    context.strokeStyle = edge;
    context.stroke();
  }
}

// Darts bin by bin: one path a colour and shade.
function paths(context, view, { x, y, vx, vy, bins }, colours) {
  const { scale, up } = view,
    wide = Math.min(Math.max(0.11 * scale, 0.9), 7);
  const left = view.at(-60, 0)[0],
    right = view.at(view.width + 60, 0)[0];
  bins.forEach((group, bin) => {
    context.fillStyle = `rgba(${colours[bin % HUES].join()}, ${[0.22, 0.45, 0.72, 1][Math.floor(bin / HUES)]})`;
    context.beginPath();
    for (const i of group) {
      if (x[i] < left || x[i] > right) continue;
      const px = view.px(x[i]),
        py = view.py(y[i]),
        dx = vx[i] * scale,
        dy = up * vy[i] * scale;
      const length = Math.hypot(dx, dy) || 1,
        nx = (-dy / length) * wide,
        ny = (dx / length) * wide;
      context.moveTo(px + nx, py + ny);
      context.lineTo(px + dx, py + dy);
      context.lineTo(px - nx, py - ny);
      context.closePath();
    }
    context.fill();
  });
}

// While playing, a mark walks along every dart as fast as people do there.
function drawWalkers(context, view, set, layer, period, seconds, colour) {
  const found = picture(set, layer, period);
  if (!found || found.discs) return;
  const { x, y, vx, vy } = found,
    side = Math.min(Math.max(view.scale * 0.14, 1.6), 5);
  context.fillStyle = colour;
  for (let i = 0; i < x.length; i++) {
    const along = (seconds + i * 0.381966) % 1;
    context.fillRect(view.px(x[i] + along * vx[i]) - side / 2, view.py(y[i] + along * vy[i]) - side / 2, side, side);
  }
}

// A bar of round length, and the key of colours: the four directions as darts.
function drawKeys(context, view, colours, layer) {
  const lengths = [1, 2, 5, 10, 20, 50, 100],
    metres = lengths.find((one) => one * view.scale > 60) || 100,
    ink = css("--ink");
  const bottom = view.height - 14,
    long = metres * view.scale;
  context.fillStyle = css("--card");
  context.globalAlpha = 0.85;
  context.fillRect(6, bottom - 18, long + 16, 26);
  context.globalAlpha = 1;
  context.fillStyle = ink;
  context.fillRect(14, bottom, long, 3);
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "left";
  context.fillText(`${metres} m`, 14, bottom - 5);
  if (layer === "exits") return;
  const cx = view.width - 34,
    cy = view.height - 34,
    one = { scale: 20, up: view.up, width: 0, height: 0, px: () => cx, py: () => cy, at: () => [0, 0] };
  context.fillStyle = css("--card");
  context.globalAlpha = 0.85;
  context.beginPath();
  context.arc(cx, cy, 29, 0, 7);
  context.fill();
  context.globalAlpha = 1;
  const turn = Array.from({ length: 12 }, (_, i) => (i / 12) * 2 * Math.PI);
  paths(
    context,
    { ...one, at: (px) => [px < 0 ? -1 : 1] },
    darts(
      turn.map(() => 0),
      turn.map(() => 0),
      turn,
      turn.map(() => 1.2),
      turn.map(() => 1),
    ),
    colours,
  );
}
