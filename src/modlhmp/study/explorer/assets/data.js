// The packed data: the twin of pack.py's `unpacked`. What a dropped page holds is data, never markup or script.
const FORM = 1;

async function unpack(text) {
  const packed = Uint8Array.from(atob(text.trim()), (one) => one.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const size = new DataView(bytes.buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(bytes.subarray(4, 4 + size)));
  const data = revive(head, bytes.subarray(4 + size));
  if (data.form !== FORM)
    throw new Error(`it is of form ${data.form}, this page reads form ${FORM}: make both runs with the same version`);
  return data;
}

function revive(tree, body) {
  if (Array.isArray(tree)) return tree.map((one) => revive(one, body));
  if (tree === null || typeof tree !== "object") return tree;
  if ("$" in tree) return numbers(body, ...tree.$);
  return Object.fromEntries(Object.entries(tree).map(([key, one]) => [key, revive(one, body)]));
}

function numbers(body, at, count, width, step, row) {
  const found = new Float64Array(count),
    lowest = -(2 ** (8 * width - 1)),
    shift = 32 - 8 * width;
  for (let i = 0, sum = 0; i < count; i++) {
    let whole = 0;
    for (let part = 0; part < width; part++) whole |= body[at + part * count + i] << (8 * part);
    whole = (whole << shift) >> shift;
    if (row) found[i] = (sum = i % row ? sum + whole : whole) * step;
    else found[i] = whole === lowest ? NaN : whole * step;
  }
  return found;
}

// The data of another run's page, which is a text of ours or somebody's: only the packed part is looked at.
async function dataOfPage(file) {
  const found = /<script type="application\/gzip" id="data">([A-Za-z0-9+/=\s]+)<\/script>/.exec(await file.text());
  if (!found) throw new Error("it holds no data of an explorer");
  return unpack(found[1]);
}
