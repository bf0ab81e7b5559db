// node lines.mjs ours|bevy SCENE
// Turns what `deltamorph bench --json -` or the example `heads` prints into lines of JSON.
import fs from 'node:fs';

const [who, scene] = process.argv.slice(2), text = fs.readFileSync(0, 'utf8');
const print = line => console.log(JSON.stringify({ scene, ...line }));
if (who === 'ours') {
  const { device, runs } = JSON.parse(text);
  // Of the formats of poses the one that takes least.
  const timed = runs.filter(run => run.workload !== 'random' && run.cpu_ms);
  const sorted = timed.sort((a, b) => b.cpu_ms.median - a.cpu_ms.median);
  const best = new Map(sorted.map(run => [run.workload, run]));
  const peer = `deltamorph, ${/swift/i.test(device.name) ? 'SwiftShader' : 'lavapipe'}`;
  for (const [work, { cpu_ms, max_error_rel: off, verified: right }] of best)
    print({ peer, device: device.name, work, ms: cpu_ms.median, without: 0, check: { off, right } });
} else {
  const frame = /^(.*): a frame ([\d.]+) ms by Bevy, ([\d.]+) by deltamorph .*, ([\d.]+) by nobody;/gm;
  const [, off] = text.match(/pictures differ by (\d+) of 255/) ?? [], [, device] = text.match(/^(.*): heads: \d/m) ?? [];
  const works = { 'its clip': 'clip', 'all change': 'all', '28 active, none changes': 'constant' };
  for (const [, name, bevy, ours, without] of text.matchAll(frame))
    for (const [peer, ms] of [['Bevy 0.20.1', bevy], ['deltamorph in Bevy', ours]])
      if (works[name])
        print({ peer, device, work: works[name], ms: +ms, without: +without, check: { off: +off, right: +off <= 2 } });
  if (off === undefined) print({ peer: 'Bevy 0.20.1', error: 'stops: see what it says' });
}
