import { script, webgl } from './gl.mjs';
import { RATE } from './scene.mjs';

export async function start(canvas) {
  await script('node_modules/filament/filament.js');
  await new Promise(resolve => Filament.init([], resolve));
  const engine = Filament.Engine.create(canvas, { antialias: false, preserveDrawingBuffer: true });
  const [chain, renderer] = [engine.createSwapChain(), engine.createRenderer()];
  renderer.setClearOptions({ clearColor: [0, 0, 0, 1], clear: true });
  const loader = engine.createAssetLoader();
  const entities = Filament.EntityManager.get();
  const load = async (url, rows) => {
    await new Promise(resolve => Filament.fetch([url], resolve));
    const scene = engine.createScene(), asset = loader.createAsset(url);
    await new Promise(resolve => asset.loadResources(resolve, null, null, 1));
    scene.addEntities(asset.getEntities());
    const sun = entities.create();
    Filament.LightManager.Builder(Filament.LightManager$Type.DIRECTIONAL).direction([0, 0, -1]).build(engine, sun);
    scene.addEntity(sun);
    const camera = engine.createCamera(entities.create()), view = engine.createView();
    view.setCamera(camera);
    view.setScene(scene);
    view.setViewport([0, 0, canvas.width, canvas.height]);
    view.setPostProcessingEnabled(false);
    const animator = asset.getInstance().getAnimator();
    return {
      // JavaScript can set four weights; animations set all.
      set: (work, frame) => animator.applyAnimation(Object.keys(rows).indexOf(work), frame / RATE),
      look({ middle: [x, y, z], half, depth }) {
        camera.setProjection(Filament.Camera$Projection.ORTHO, -half, half, -half, half, 0, 2 * depth);
        camera.lookAt([x, y, z + depth], [x, y, z], [0, 1, 0]);
      },
      draw() {
        const begun = renderer.beginFrame(chain);   // false: once more, later
        if (begun) {
          renderer.renderView(view);
          renderer.endFrame();
        }
        engine.execute();
        return begun;
      },
    };
  };
  return { name: 'Filament 1.53.4, WebGL2', load, ...webgl(canvas.getContext('webgl2')) };
}
