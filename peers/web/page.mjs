// Checks an engine's pose, and times its frames with and without targets, in turns.
import { box, parse, works, FRAMES } from './scene.mjs';

const { peer, scene, gpu, seconds } = Object.fromEntries(new URLSearchParams(location.search));
const canvas = document.getElementById('canvas'), EDGE = canvas.width;

/** Returns an orthographic view of a box: half its width and height, middle and depth. */
function view({ low, high }, margin) {
  const middle = low.map((x, c) => (x + high[c]) / 2);
  const half = margin * Math.max(high[0] - low[0], high[1] - low[1]) / 2;
  return { middle, half, depth: 2 * (high[2] - low[2]) + half };
}

/** Records a frame, and returns when it began. */
async function frame(mesh, work, row) {
  for (;;) {
    const begin = performance.now();
    if (work) mesh.set(work, row);
    if (mesh.draw() !== false) return begin;
    await new Promise(resolve => setTimeout(resolve));   // no engine else, since the browser shows the canvas in between
  }
}

/** Draws the pose of the check, and returns how far its outline is from where its vertices are, in pixels. */
async function check(engine, mesh, file) {
  const expected = box(file, works(file).check[0]), base = box(file, []), seen = view(expected, 1.25);
  mesh.look(seen);
  let pixels;
  for (let i = 0; i < 3; i++) {   // shaders may compile in the background
    await frame(mesh, 'check', 0);
    const copy = new OffscreenCanvas(EDGE, EDGE).getContext('2d');
    copy.drawImage(canvas, 0, 0);
    await engine.wait();
    pixels = copy.getImageData(0, 0, EDGE, EDGE).data;
  }
  const sides = { left: EDGE, right: -1, top: EDGE, bottom: -1 };
  for (let i = 0; i < EDGE * EDGE; i++) {
    if (pixels[4 * i] + pixels[4 * i + 1] + pixels[4 * i + 2] < 60) continue;
    const x = i % EDGE, y = Math.floor(i / EDGE);
    Object.assign(sides, { left: Math.min(sides.left, x), right: Math.max(sides.right, x + 1) });
    Object.assign(sides, { top: Math.min(sides.top, y), bottom: Math.max(sides.bottom, y + 1) });
  }
  const found = [sides.left, sides.right, sides.bottom, sides.top];
  const outline = ({ low, high }) => [low[0], high[0], low[1], high[1]].map((x, i) =>
    EDGE / 2 * (1 + (i < 2 ? 1 : -1) * (x - seen.middle[i >> 1]) / seen.half));
  const [to, from] = [outline(expected), outline(base)];
  const furthest = (a, b) => Math.max(...a.map((x, i) => Math.abs(x - b[i])));
  const [off, moved] = [furthest(found, to), furthest(from, to)];
  return { off, moved, right: off < 2 && moved > 20 };
}

const median = times => times.toSorted((a, b) => a - b)[times.length >> 1];

async function main() {
  const { start } = await import(`./${peer}.mjs`);
  const file = parse(await (await fetch(`files/${scene}.glb`)).arrayBuffer()), rows = works(file);
  const engine = await start(canvas, gpu === 'webgpu');
  const mesh = await engine.load(`files/${scene}.glb`, rows), bare = await engine.load(`files/${scene}.plain.glb`);
  const checked = await check(engine, mesh, file);
  if (!checked.right) {
    const { off, moved } = checked;
    const error = `draws another pose: off by ${off.toFixed()} pixels, where ${moved.toFixed()} are moved`;
    return report({ peer: engine.name, scene, error });
  }
  const small = view(box(file, []), 4);   // 64 × 64 pixels: frames are mostly vertices
  [mesh, bare].forEach(one => one.look(small));

  let next = 0;
  const time = async (one, work, frames, times) => {
    for (let i = -1; i < frames; i++) {
      const begin = await frame(one, work, next++ % FRAMES);
      await engine.wait();
      if (i >= 0) times.push(performance.now() - begin);
    }
  };
  for (const work of ['clip', 'all', 'constant']) {
    const times = [[], []], end = performance.now() + 1000 * seconds;
    await time(mesh, work, 2, []);
    await time(bare, null, 2, []);
    do {
      await time(mesh, work, 4, times[0]);
      await time(bare, null, 4, times[1]);
    } while (performance.now() < end && times[0].length < 10 * FRAMES);
    const [ms, without] = times.map(median);
    const what = { peer: engine.name, device: engine.device(), scene, work };
    await report({ ...what, ms, without, frames: times[0].length, check: checked });
  }
}

await main().catch(error => report({ peer, scene, error: String(error) }));
done();
