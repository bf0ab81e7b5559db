import { script, webgl, webgpu } from './gl.mjs';

export async function start(canvas, gpu) {
  await script('node_modules/babylonjs/babylon.js');
  await script('node_modules/babylonjs-loaders/babylonjs.loaders.js');
  const engine = gpu ? new BABYLON.WebGPUEngine(canvas, { antialias: false }) : new BABYLON.Engine(canvas, false);
  await engine.initAsync?.();
  const load = async (url, rows) => {
    const scene = new BABYLON.Scene(engine);
    Object.assign(scene, { useRightHandedSystem: true, skipFrustumClipping: true });
    scene.clearColor = new BABYLON.Color4(0, 0, 0, 1);
    const camera = new BABYLON.FreeCamera('camera', BABYLON.Vector3.Zero(), scene);
    camera.mode = BABYLON.Camera.ORTHOGRAPHIC_CAMERA;
    await BABYLON.AppendSceneAsync(url, scene);
    scene.stopAllAnimations();
    const mesh = scene.meshes.find(mesh => mesh.getTotalVertices());
    const targets = mesh.morphTargetManager;
    // One shader whatever is active, and nothing for weights of zero.
    if (targets) Object.assign(targets, { numMaxInfluencers: targets.numTargets, optimizeInfluencers: true });
    mesh.alwaysSelectAsActiveMesh = true;
    scene.activeCamera = camera;
    await scene.whenReadyAsync();
    return {
      set(work, frame) {
        targets.areUpdatesFrozen = true;   // one update for all weights
        rows[work][frame].forEach((weight, k) => {
          const target = targets.getTarget(k);
          if (target.influence !== weight) target.influence = weight;
        });
        targets.areUpdatesFrozen = false;
      },
      look({ middle: [x, y, z], half, depth }) {
        camera.position.set(x, y, z + depth);
        camera.setTarget(new BABYLON.Vector3(x, y, z));
        Object.assign(camera, { orthoLeft: -half, orthoRight: half, orthoTop: half, orthoBottom: -half });
        Object.assign(camera, { minZ: 0, maxZ: 2 * depth });
      },
      draw() {
        engine.beginFrame();
        scene.render();
        engine.endFrame();
      },
    };
  };
  const api = gpu ? webgpu(engine._device) : webgl(engine._gl);
  return { name: `Babylon.js ${BABYLON.Engine.Version}, ${gpu ? 'WebGPU' : 'WebGL2'}`, load, ...api };
}
