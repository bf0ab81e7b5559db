// node prepare.mjs IN.glb CLIP.csv OUT
// Writes OUT.glb with the weights that engines play, and OUT.plain.glb without targets.
import fs from 'node:fs';
import { parse, plain, prepare, write } from './web/scene.mjs';

const [input, csv, out] = process.argv.slice(2);
const bytes = fs.readFileSync(input);
const file = parse(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
const [names, ...rows] = fs.readFileSync(csv, 'utf8').trim().split(/\r?\n/).map(line => line.split(','));
const column = file.json.meshes[0].extras.targetNames.map(name => names.indexOf(name));
const made = prepare(file, rows.map(row => column.map(at => at < 0 ? 0 : Number(row[at]))));
fs.writeFileSync(`${out}.glb`, write(made));
fs.writeFileSync(`${out}.plain.glb`, write(plain(made)));
