/** Loads a script that is not a module. */
export const script = src => new Promise((resolve, reject) =>
  document.head.append(Object.assign(document.createElement('script'), { src, onload: resolve, onerror: reject })));

/** What pages ask of a WebGL context: a pixel is there when all before it is drawn. */
export const webgl = gl => ({
  device: () => gl.getParameter(gl.getExtension('WEBGL_debug_renderer_info').UNMASKED_RENDERER_WEBGL),
  async wait() {
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  },
});

export const webgpu = device => ({
  device: () => [device.adapterInfo.vendor, device.adapterInfo.architecture].join(' '),
  wait: () => device.queue.onSubmittedWorkDone(),
});
