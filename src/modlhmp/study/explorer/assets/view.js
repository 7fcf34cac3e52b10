// What part of the floor a map shows, and how pointers, wheels and fingers change it. Positions in m, screen in px.
class View {
  constructor(box, flip) {
    Object.assign(this, { box, flip, x: 0, y: 0, scale: 0, width: 1, height: 1 });
  }

  size(width, height) {
    const first = !this.scale,
      all = this.scale === this.whole();
    Object.assign(this, { width, height });
    if (first || all) this.fit();
  }

  whole() {
    const [x0, y0, x1, y1] = this.box;
    return Math.max(Math.min((this.width - 24) / (x1 - x0), (this.height - 84) / (y1 - y0)), 0.5);
  }

  fit() {
    const [x0, y0, x1, y1] = this.box;
    Object.assign(this, { x: (x0 + x1) / 2, y: (y0 + y1) / 2, scale: this.whole() });
  }

  get up() {
    return this.flip ? 1 : -1;
  }
  px(x) {
    return (x - this.x) * this.scale + this.width / 2;
  }
  py(y) {
    return this.up * (y - this.y) * this.scale + this.height / 2;
  }
  at(px, py) {
    return [(px - this.width / 2) / this.scale + this.x, (this.up * (py - this.height / 2)) / this.scale + this.y];
  }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.at(px, py);
    this.scale = Math.min(Math.max(this.scale * factor, this.whole() / 2), 400);
    this.x = x - (px - this.width / 2) / this.scale;
    this.y = y - (this.up * (py - this.height / 2)) / this.scale;
  }

  move(px, py) {
    this.x -= px / this.scale;
    this.y -= (this.up * py) / this.scale;
  }

  show(x, y) {
    const px = this.px(x),
      py = this.py(y);
    if (px < 20 || py < 20 || px > this.width - 20 || py > this.height - 20) Object.assign(this, { x, y });
  }
}

// Dragging, wheel and two fingers change the view; moving points, tapping chooses.
function follow(canvas, view, { changed, pointed, tapped }) {
  const fingers = new Map();
  let moved = 0;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const apart = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  canvas.addEventListener("pointerdown", (event) => {
    fingers.set(event.pointerId, place(event));
    canvas.setPointerCapture(event.pointerId);
    if (fingers.size === 1) moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const now = place(event),
      before = fingers.get(event.pointerId);
    if (!before) return pointed(...now);
    const span = fingers.size === 2 ? apart() : 0;
    fingers.set(event.pointerId, now);
    moved += Math.hypot(now[0] - before[0], now[1] - before[1]);
    if (span) view().zoom(apart() / span, ...now);
    else if (moved > 5) view().move(now[0] - before[0], now[1] - before[1]);
    if (span || moved > 5) changed();
  });
  const lifted = (event) => {
    if (fingers.delete(event.pointerId) && moved <= 5 && event.type === "pointerup") tapped(...place(event));
  };
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, lifted);
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      view().zoom(1.0015 ** -event.deltaY, ...place(event));
      changed();
    },
    { passive: false },
  );
}

// A grid of values, its first row at the bottom (`down`: at the top), as a smooth shade: root of the share of the peak.
function drawHeat(context, grid, columns, x, y, width, height, strength, down) {
  const rows = grid.length / columns,
    image = new ImageData(columns, rows),
    ink = css("--density").split(",").map(Number);
  const peak = grid.reduce((a, b) => Math.max(a, b), 1e-9);
  grid.forEach((value, at) => {
    const row = Math.floor(at / columns),
      share = Math.sqrt(value / peak);
    image.data.set(
      [...ink, 255 * strength * (share < 0.04 ? 0 : share)],
      4 * ((down ? row : rows - 1 - row) * columns + (at % columns)),
    );
  });
  const canvas = Object.assign(document.createElement("canvas"), { width: columns, height: rows });
  canvas.getContext("2d").putImageData(image, 0, 0);
  context.drawImage(canvas, x, y, width, height);
}

// A canvas of its element's size in the screen's own pixels; returns its context, in px of the page.
function sized(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2),
    { width, height } = canvas.getBoundingClientRect();
  const wide = Math.round(width * ratio),
    high = Math.round(height * ratio);
  if (canvas.width !== wide || canvas.height !== high) Object.assign(canvas, { width: wide, height: high });
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return Object.assign(context, { wide: width, high: height });
}
