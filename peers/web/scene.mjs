// The glTF file that all engines load: reading it, and adding the weights that they play.

const SIZES = { SCALAR: 1, VEC3: 3 };
const ARRAYS = { 5121: Uint8Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
// Frames of a work. A frame takes a 32nd of a second, so that its time is exact.
export const FRAMES = 40, RATE = 32;

export function parse(buffer) {
  const view = new DataView(buffer), length = view.getUint32(12, true);
  const json = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, length)));
  return { json, bin: new Uint8Array(buffer, 28 + length) };
}

export function write({ json, bin }) {
  const text = new TextEncoder().encode(JSON.stringify(json)), length = (text.length + 3) & ~3;
  const out = new Uint8Array(28 + length + bin.length), view = new DataView(out.buffer);
  [0x46546c67, 2, out.length, length, 0x4e4f534a].forEach((word, i) => view.setUint32(4 * i, word, true));
  out.fill(32, 20, 20 + length).set(text, 20);
  view.setUint32(20 + length, bin.length, true);
  view.setUint32(24 + length, 0x004e4942, true);
  out.set(bin, 28 + length);
  return out;
}

function array({ json, bin }, { bufferView, byteOffset = 0, componentType }, count) {
  const start = bin.byteOffset + byteOffset + (json.bufferViews[bufferView].byteOffset ?? 0);
  const bytes = count * ARRAYS[componentType].BYTES_PER_ELEMENT;
  return new ARRAYS[componentType](bin.buffer.slice(start, start + bytes));
}

/** Returns the numbers of an accessor, dense or sparse; those of vertices are not interleaved here. */
export function numbers(file, index) {
  const accessor = file.json.accessors[index], size = SIZES[accessor.type], all = accessor.count * size;
  const found = accessor.bufferView === undefined ? new Float32Array(all) : array(file, accessor, all);
  if (accessor.sparse) {
    const { count, indices, values } = accessor.sparse;
    const at = array(file, indices, count);
    const to = array(file, { ...values, componentType: accessor.componentType }, count * size);
    at.forEach((vertex, i) => found.set(to.subarray(i * size, (i + 1) * size), vertex * size));
  }
  return found;
}

const primitive = file => file.json.meshes[0].primitives[0];

/** Returns rows of weights by work. */
export function works(file) {
  const targets = primitive(file).targets.length;
  return Object.fromEntries(file.json.animations.map(({ name, samplers }) => {
    const all = numbers(file, samplers[0].output);
    return [name, Array.from({ length: all.length / targets }, (_, i) => all.subarray(i * targets, (i + 1) * targets))];
  }));
}

/** Returns the least and the largest coordinates of a pose: a sum in float64. */
export function box(file, row) {
  const pose = Float64Array.from(numbers(file, primitive(file).attributes.POSITION));
  primitive(file).targets.forEach(({ POSITION }, k) => {
    if (row[k] && POSITION !== undefined) numbers(file, POSITION).forEach((delta, i) => pose[i] += row[k] * delta);
  });
  const low = [Infinity, Infinity, Infinity], high = low.map(x => -x);
  pose.forEach((x, i) => { low[i % 3] = Math.min(low[i % 3], x); high[i % 3] = Math.max(high[i % 3], x); });
  return { low, high };
}

/** Adds the works as animations, and one for the check, whose weights move the outline of the mesh. */
export function prepare(file, clip) {
  const { json } = file, targets = clip[0].length;
  let state = 1;
  const random = () => (state = (Math.imul(state, 1664525) + 1013904223) >>> 0) / 2 ** 32;
  const held = new Set(Array.from({ length: 28 }, (_, i) => Math.floor(i * targets / 28)));
  const rows = {
    clip: i => clip[i % clip.length],
    all: () => clip[0].map(() => 0.1 * (0.1 + random())),
    constant: () => clip[0].map((_, k) => held.has(k) ? 0.3 : 0),
  };
  const made = Object.entries(rows).map(([name, row]) => [name, Array.from({ length: FRAMES }, (_, i) => row(i))]);
  const base = box(file, []), size = Math.max(...[0, 1].map(c => base.high[c] - base.low[c]));
  const moved = pose => Math.max(...[0, 1].flatMap(c =>
    [Math.abs(pose.low[c] - base.low[c]), Math.abs(pose.high[c] - base.high[c])]));
  let weight = 0.5;
  while (weight < 64 && moved(box(file, clip[0].map(() => weight))) < 0.2 * size) weight *= 2;
  const one = clip[0].map(() => weight);
  made.push(['check', [one, one]]);

  const chunks = [{ at: 0, bytes: file.bin }];
  let length = file.bin.length;
  const add = values => {
    const bytes = new Uint8Array(Float32Array.from(values).buffer);
    chunks.push({ at: length, bytes });
    const view = { buffer: 0, byteOffset: length, byteLength: bytes.length };
    length += bytes.length;
    return json.bufferViews.push(view) - 1;
  };
  // Filament takes sparse targets for zero.
  json.accessors.forEach((accessor, i) => {
    if (!accessor.sparse && accessor.bufferView !== undefined) return;
    accessor.bufferView = add(numbers(file, i));
    delete accessor.sparse;
    delete accessor.byteOffset;
  });
  const scalars = (values, more) => {
    const accessor = { bufferView: add(values), componentType: 5126, type: 'SCALAR', count: values.length };
    return json.accessors.push({ ...accessor, ...more }) - 1;
  };
  json.animations = made.map(([name, rows]) => {
    const input = scalars(rows.map((_, i) => i / RATE), { min: [0], max: [(rows.length - 1) / RATE] });
    const output = scalars(rows.flatMap(row => [...row]));
    return { name, samplers: [{ input, output }], channels: [{ sampler: 0, target: { node: 0, path: 'weights' } }] };
  });
  file.bin = new Uint8Array(json.buffers[0].byteLength = length);
  chunks.forEach(({ at, bytes }) => file.bin.set(bytes, at));
  // White whatever the light is, so that the outline shows; normals are morphed as for any lit material.
  json.materials = [{ doubleSided: true, pbrMetallicRoughness: { metallicFactor: 0 }, emissiveFactor: [1, 1, 1] }];
  primitive(file).material = 0;
  return file;
}

/** Returns the file without targets. */
export function plain({ json, bin }) {
  json = structuredClone(json);
  delete json.animations;
  delete json.meshes[0].extras;   // names of targets: Filament reads one for each
  delete primitive({ json }).targets;
  return { json, bin };
}
