// node lines.mjs SCENE
// Turns what `deltamorph bench --json -` prints into lines of JSON.
import fs from 'node:fs';

const scene = process.argv[2], { device, runs } = JSON.parse(fs.readFileSync(0, 'utf8'));
// Of the formats of poses the one that takes least.
const timed = runs.filter(run => run.workload !== 'random' && run.cpu_ms);
const sorted = timed.sort((a, b) => b.cpu_ms.median - a.cpu_ms.median);
const best = new Map(sorted.map(run => [run.workload, run]));
const peer = `deltamorph, ${/swift/i.test(device.name) ? 'SwiftShader' : 'lavapipe'}`;
for (const [work, { cpu_ms, max_error_rel: off, verified: right }] of best)
  console.log(JSON.stringify({ scene, peer, device: device.name, work, ms: cpu_ms.median, without: 0, check: { off, right } }));
