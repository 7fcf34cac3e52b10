// Error against horizon: means of the run, and a person's own where one is chosen.
function curveOf(set, method, protocol, metric) {
  const found = method.errors[protocol];
  return { x: found.horizon, y: found[metric], n: found.n };
}

function personCurve(set, method, person, metric) {
  const found = set.people && set.people.methods[method.name];
  if (!found || person === null) return null;
  const kept = (found.errors ||= {})[person] || (found.errors[person] = errorsOf(set.people, set, found, person));
  return { x: Float32Array.from(kept[metric], (_, i) => (i + 1) * set.step), y: kept[metric] };
}

function at(curve, seconds) {
  if (!curve) return NaN;
  const i = curve.x.findIndex((one) => Math.abs(one - seconds) < 0.01);
  return i < 0 ? NaN : curve.y[i];
}

function drawChart(canvas, set, { shown, protocol, metric, person, seconds, colour }) {
  const context = sized(canvas),
    { wide, high } = context,
    left = 40,
    right = wide - 10,
    top = 8,
    bottom = high - 34;
  const curves = shown.map((method) => ({
    method,
    mean: curveOf(set, method, protocol, metric),
    own: personCurve(set, method, person, metric),
  }));
  const most =
    Math.max(1, ...curves.flatMap(({ mean, own }) => [...mean.y, ...(own ? own.y : [])]).filter(Number.isFinite)) *
    1.04;
  const px = (x) => left + (x / set.horizon) * (right - left),
    py = (y) => bottom - (y / most) * (bottom - top);
  const stride = [0.5, 1, 2, 5, 10, 20, 50].find((one) => most / one <= 6) || 100,
    along = [1, 2, 5, 10, 20].find((one) => set.horizon / one <= 7) || 60;
  context.font = "12px system-ui, sans-serif";
  context.fillStyle = css("--faint");
  context.strokeStyle = css("--line");
  context.lineWidth = 1;
  context.textAlign = "right";
  for (let y = 0; y <= most; y += stride) {
    context.beginPath();
    context.moveTo(left, py(y));
    context.lineTo(right, py(y));
    context.stroke();
    context.fillText(String(y), left - 5, py(y) + 4);
  }
  context.textAlign = "center";
  for (let x = 0; x <= set.horizon; x += along) context.fillText(String(x), px(x), bottom + 15);
  context.fillText("horizon, s", (left + right) / 2, high - 4);
  context.save();
  context.translate(11, (top + bottom) / 2);
  context.rotate(-Math.PI / 2);
  context.fillText(`${metric.toUpperCase()}, m`, 0, 0);
  context.restore();
  const trace = ({ x, y }) => {
    context.beginPath();
    x.forEach((one, i) => {
      if (Number.isFinite(y[i])) context.lineTo(px(one), py(y[i]));
    });
    context.stroke();
  };
  for (const { method, mean, own } of curves) {
    context.strokeStyle = colour(method);
    context.setLineDash(method.dash.map((part) => part * 1.8));
    context.lineWidth = own ? 1 : 1.8;
    context.globalAlpha = own ? 0.45 : 1;
    trace(mean);
    context.globalAlpha = 1;
    context.lineWidth = 2.6;
    if (own) trace(own);
    context.setLineDash([]);
  }
  context.strokeStyle = css("--now");
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(px(seconds), top);
  context.lineTo(px(seconds), bottom);
  context.stroke();
  return (x) => Math.min(Math.max(((x - left) / (right - left)) * set.horizon, 0), set.horizon);
}

// The legend: one box a method, with its line and its value at the horizon.
function fillLegend(box, methods, colour, changed) {
  box.replaceChildren(
    ...methods.map((method) => {
      const row = document.createElement("label"),
        input = Object.assign(document.createElement("input"), {
          type: "checkbox",
          checked: method.shown,
          value: method.name,
        });
      input.addEventListener("change", () => {
        method.shown = input.checked;
        changed();
      });
      const swatch = document.createElement("canvas");
      Object.assign(swatch, { width: 56, height: 12 });
      swatch.style.cssText = "width:28px;height:6px;flex:none";
      const value = element("span", ""),
        name = element("span", method.title);
      swatch.ariaHidden = "true";
    swatch.dataset.method = method.name;
      value.className = "value";
      name.className = "name";
      name.title = method.title;
      row.append(input, swatch, name, value);
      return row;
    }),
  );
  paintLegend(box, methods, colour);
}

function paintLegend(box, methods, colour) {
  box.querySelectorAll("canvas").forEach((swatch, i) => {
    const context = swatch.getContext("2d");
    context.clearRect(0, 0, 56, 12);
    context.strokeStyle = colour(methods[i]);
    context.lineWidth = 4;
    context.setLineDash(methods[i].dash.map((part) => part * 4));
    context.beginPath();
    context.moveTo(0, 6);
    context.lineTo(56, 6);
    context.stroke();
  });
}
