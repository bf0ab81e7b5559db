// node table.mjs FOLDER: makes the page of all FOLDER/RUN.jsonl, a run each.
import fs from 'node:fs';
import path from 'node:path';
import { parse, works } from './web/scene.mjs';

const folder = process.argv[2];
const files = fs.readdirSync(folder).filter(name => /^[1-9]\d*\.jsonl$/.test(name));
// By run; the last line of a peer, scene and work stands.
const runs = files.map(name => {
  const lines = fs.readFileSync(path.join(folder, name), 'utf8').trim().split('\n').map(line => JSON.parse(line));
  return new Map(lines.map(line => [[line.scene, line.peer, line.work].join(), line]));
});
// What fails its check is not timed.
for (const line of runs.flatMap(run => [...run.values()]).filter(line => line.check && !line.check.right)) {
  line.error = `its image differs by ${line.check.off} of 255; 2 are allowed`;
}
for (const run of runs) for (const [key, line] of run) if (line.error) run.set(key, { ...line, ms: undefined });
const lines = runs.flatMap(run => [...run.values()]);

const unique = list => [...new Set(list)];
// What a peer is compared with: the same work on the same driver, in the same run.
const beside = peer => /^deltamorph/.test(peer) ? null : /^Bevy/.test(peer) ? 'deltamorph in Bevy'
  : /^plain/.test(peer) ? 'deltamorph, cpu' : /WebGPU/.test(peer) ? 'deltamorph, SwiftShader' : 'deltamorph, lavapipe';
const short = x => Number(x.toPrecision(x < 10 ? 2 : 3)).toString();
const range = values => {
  const [low, high] = [Math.min(...values), Math.max(...values)].map(short);
  return low === high ? low : `${low}-${high}`;
};
const faster = [];

function cell(scene, peer, work) {
  const found = runs.flatMap(run => {
    const of = name => run.get([scene, name, work].join());
    return of(peer) && !of(peer).error ? [{ line: of(peer), ours: of(beside(peer)) }] : [];
  });
  if (!found.length) return '';
  const morph = line => line.ms - line.without, text = `${range(found.map(({ line }) => morph(line)))} ms`;
  const both = found.filter(({ ours }) => ours && morph(ours) > 0.01 * ours.without);
  if (!both.length) return text;
  const ratio = range(both.map(({ line, ours }) => morph(line) / morph(ours)));
  if (both.some(({ line, ours }) => morph(line) < morph(ours))) faster.push(`${peer}, ${scene}, ${work}: ${ratio}`);
  const frames = peer.startsWith('Bevy') ? `; frames ${range(both.map(({ line, ours }) => line.ms / ours.ms))}` : '';
  return `${text} (**${ratio}**${frames})`;
}

const TITLES = { clip: 'its clip', all: 'all change', constant: '28 active, none changes' };
const devices = unique(lines.filter(line => line.device && !line.error).map(line => `- ${line.peer}: ${line.device.split('\n').at(-1)}`)).sort();
console.log(`# Other engines

The cost of morphing in other engines, and in deltamorph in the same run: milliseconds of a frame minus the same frame
without targets, each waited for: the lowest to the highest median of a scene's runs, all on one machine. In brackets:
the ratio to deltamorph in the same run. Vertices include those doubled at seams of texture coordinates.
[peers/README.md](../../peers/README.md) has the commands, and how poses are checked: only correct poses are timed.
Software drivers on two cores.

${devices.join('\n')}
`);

/** Returns what a mesh and its clip are. */
function about(scene) {
  const bytes = fs.readFileSync(path.join(folder, `${scene}.glb`)), file = parse(new Uint8Array(bytes).buffer);
  const { attributes, targets } = file.json.meshes[0].primitives[0], { clip } = works(file);
  const mean = count => short(clip.reduce((sum, row, i) => sum + count(row, clip[i - 1] ?? row), 0) / clip.length);
  const active = mean(row => row.filter(x => x).length);
  const changed = mean((row, old) => row.filter((x, k) => x !== old[k]).length);
  const vertices = file.json.accessors[attributes.POSITION].count.toLocaleString('en');
  const frame = `${active} are active in a frame of its clip, and ${changed} change`;
  return `${vertices} vertices × ${targets.length} targets. ${frame}.`;
}

for (const scene of unique(lines.map(line => line.scene))) {
  const mine = lines.filter(line => line.scene === scene);
  const text = scene.endsWith('-20k') ? 'The built-in head with 20,000 vertices.' : about(scene);
  const count = runs.filter(run => [...run.values()].some(line => line.scene === scene)).length;
  console.log(`## ${scene}\n\n${text} ${count} runs.\n\n| | ${Object.values(TITLES).join(' | ')} |\n|---|---|---|---|`);
  for (const peer of unique(mine.filter(line => !line.error).map(line => line.peer)))
    console.log(`| ${peer} | ${Object.keys(TITLES).map(work => cell(scene, peer, work)).join(' | ')} |`);
  const reason = ({ error, said }) => said ? `${error}: ${said}` : error;
  const errors = mine.filter(line => line.error).map(line => [line.peer, reason(line)]);
  for (const [peer, error] of new Map(errors)) console.log(`| ${peer} | not timed: ${error} | | |`);
  console.log();
}
console.log(`## Where another takes less\n\nTheir time, relative to deltamorph's:\n\n${faster.map(line => `- ${line}`).join('\n') || 'Nowhere here.'}`);
