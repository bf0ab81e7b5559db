import * as THREE from 'three';
import { webgl, webgpu } from './gl.mjs';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';

export async function start(canvas, gpu) {
  const make = gpu ? (await import('three/webgpu')).WebGPURenderer : THREE.WebGLRenderer;
  const renderer = new make({ canvas, antialias: false });
  await renderer.init?.();
  renderer.setClearColor(0, 1);
  const load = async (url, rows) => {
    const { scene } = await new GLTFLoader().loadAsync(url);
    let mesh;
    scene.traverse(object => { if (object.isMesh) mesh = object; });
    mesh.frustumCulled = false;
    const camera = new THREE.OrthographicCamera();
    return {
      set: (work, frame) => rows[work][frame].forEach((weight, k) => mesh.morphTargetInfluences[k] = weight),
      look({ middle: [x, y, z], half, depth }) {
        Object.assign(camera, { left: -half, right: half, top: half, bottom: -half, near: 0, far: 2 * depth });
        camera.position.set(x, y, z + depth);
        camera.updateProjectionMatrix();
      },
      draw: () => renderer.render(scene, camera),
    };
  };
  const api = gpu ? webgpu(renderer.backend.device) : webgl(renderer.getContext());
  return { name: `three.js r${THREE.REVISION}, ${gpu ? 'WebGPU' : 'WebGL2'}`, load, ...api };
}
