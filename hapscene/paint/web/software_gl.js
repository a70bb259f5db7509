// Cheaper frames where no GPU draws: they would take all cores, and painting and sound would wait for them. Such a page
// draws without antialiasing, at a limited rate, and with fewer pixels until the scene has been at rest for a moment.
// viser itself draws for 0.25 s after each change.
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;
const MOVING_DPR = 0.6;  // canvas pixels per CSS pixel while the scene changes
const REST_MS = 300, FRAME_MS = 80;  // time until all pixels are drawn, and shortest time between frames

function softwareRenders() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const names = gl?.getExtension("WEBGL_debug_renderer_info");
  const found = !!gl && SOFTWARE.test(gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return found;
}

function omitAntialiasing() {
  const real = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return real.call(this, kind, kind.startsWith("webgl") ? { ...options, antialias: false } : options);
  };
}

function limitFrames(viewer, settings, invalidate) {
  let last_ms = -Infinity, next = null, rest = null, dpr = null;
  const draw = (wanted) => {
    if (wanted !== dpr) settings.set({ fixedDpr: (dpr = wanted) });
    clearTimeout(next);
    next = null;
    last_ms = performance.now();
    invalidate();
  };
  viewer.requestRender = () => {
    clearTimeout(rest);
    rest = setTimeout(draw, REST_MS, devicePixelRatio);
    const wait_ms = last_ms + FRAME_MS - performance.now();
    if (wait_ms <= 0) draw(MOVING_DPR);
    else next ??= setTimeout(draw, wait_ms, MOVING_DPR);
  };
  const turn = (event) => { if (event.type === "wheel" || event.buttons) viewer.requestRender(); };  // the camera moves
  for (const type of ["pointermove", "wheel"]) viewer.canvas?.addEventListener(type, turn, { passive: true });
  viewer.requestRender();
}

// Returns a function to call before each frame: it waits until viser has made its scene.
export function limitSoftwareGl() {
  if (!softwareRenders()) return () => {};
  omitAntialiasing();
  let done = false;
  return () => {
    const viewer = window.__viserMutable, settings = window.__viserTestpoints?.devSettings;
    const root = viewer?.scene?.__r3f?.root?.getState();
    if (done || !settings || !root?.invalidate) return;
    done = true;
    root.gl.debug.checkShaderErrors = false;  // would wait until a shader is compiled
    limitFrames(viewer, settings, root.invalidate);
  };
}
