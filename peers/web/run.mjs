// node run.mjs FOLDER PEER SCENE [webgl|webgpu] [SECONDS]
// Runs an engine in headless Chromium, and prints a line of JSON for each work.
import http from 'node:http';
import fs from 'node:fs';
import os from 'node:os';
import path from 'node:path';
import puppeteer from 'puppeteer-core';

const [folder, peer, scene, gpu = 'webgl', seconds = '1.5'] = process.argv.slice(2);
const TYPES = { '.html': 'text/html', '.js': 'text/javascript', '.mjs': 'text/javascript', '.wasm': 'application/wasm' };
const server = http.createServer((request, response) => {
  const { pathname } = new URL(request.url, 'http://localhost'), name = path.basename(pathname);
  const file = path.join(...pathname.startsWith('/files/') ? [folder, name] : [import.meta.dirname, pathname]);
  if (!fs.existsSync(file)) return response.writeHead(404).end();
  // Isolated pages have clocks of 5 µs.
  const isolated = { 'Cross-Origin-Opener-Policy': 'same-origin', 'Cross-Origin-Embedder-Policy': 'require-corp' };
  const type = TYPES[path.extname(name)] ?? 'application/octet-stream';
  response.writeHead(200, { 'Content-Type': type, ...isolated });
  fs.createReadStream(file).pipe(response);
});
await new Promise(resolve => server.listen(0, '127.0.0.1', resolve));

// WebGL on Mesa's llvmpipe; WebGPU on the SwiftShader that Chromium has, since it does not offer lavapipe.
const drivers = ['--use-gl=angle', '--use-angle=gl-egl', '--enable-unsafe-webgpu', '--ignore-gpu-blocklist'];
const profile = fs.mkdtempSync(path.join(os.tmpdir(), 'peers-'));
const browser = await puppeteer.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  userDataDir: profile,
  args: ['--no-sandbox', '--disable-gpu-watchdog', '--disable-background-networking', ...drivers],
  env: { ...process.env, LIBGL_ALWAYS_SOFTWARE: '1', GALLIUM_DRIVER: 'llvmpipe', EGL_PLATFORM: 'surfaceless' },
});
const page = await browser.newPage();
const said = [];
page.on('console', message => ['error', 'warn'].includes(message.type()) && said.push(message.text().split('\n')[0]));
page.on('pageerror', error => said.push(error.message));
const report = line => console.log(JSON.stringify(line.error && said.length ? { ...line, said: said[0] } : line));
await page.exposeFunction('report', report);
const done = new Promise(resolve => page.exposeFunction('done', resolve));
const query = new URLSearchParams({ peer, scene, gpu, seconds });
await page.goto(`http://127.0.0.1:${server.address().port}/page.html?${query}`);
const late = new Promise(resolve => setTimeout(resolve, 110_000, 'late').unref());
if (await Promise.race([done, late]) === 'late') report({ peer, scene, error: 'not done after 110 s' });
await browser.close();
fs.rmSync(profile, { recursive: true, force: true });
process.exit();
